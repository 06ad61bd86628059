"""`tccm info` of a saved map: numbers of sessions, views and keyframes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tccm_ros.results.map_file import load_map


@dataclass(frozen=True, slots=True)
class MapInfo:
    """Size and counts of a saved map.

    Attributes
    ----------
    path
        The file.
    size
        Size of the file, bytes.
    sessions, views, keyframes
        Numbers of each.
    first, last
        Stamps of the first and the last view, s; None if there is none.
    """

    path: Path
    size: int
    sessions: int
    views: int
    keyframes: int
    first: float | None
    last: float | None

    def to_json(self) -> dict[str, Any]:
        """Return all values as plain data."""
        return {**asdict(self), "path": str(self.path)}

    def text(self) -> str:
        """Return all values as lines for a terminal."""
        counts = (
            f"{self.views} views of {self.sessions} session{'' if self.sessions == 1 else 's'}, "
            f"{self.keyframes} keyframes"
        )
        size = f"{1e-6 * self.size:.1f} MB"
        head = f"{self.path}: a saved map, {size}"
        return f"{head}\n{counts}"


def map_info(path: Path | str) -> MapInfo:
    """Return the size and counts of a saved map.

    Raises
    ------
    MapError
        If the map is missing, damaged or of another version.
    """
    path = Path(path)
    saved = load_map(path)
    stamps = [view.view.stamp_ns for view in saved.views]
    return MapInfo(
        path,
        path.stat().st_size,
        len({view.view.session for view in saved.views}),
        len(saved.views),
        saved.keyframe_count,
        1e-9 * min(stamps) if stamps else None,
        1e-9 * max(stamps) if stamps else None,
    )
