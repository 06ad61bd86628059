"""Compare two maps of the same rooms: surfaces that came, went or moved, walls and paths.

Two replays of a bag, or a map and its continuation, have the same map frame. Other recordings have
their own frames, and the second map is searched for in the first as a new session is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.records import Wall
from tccm_ros.report.align import find_alignment, moved_results, pose_text
from tccm_ros.report.changes import Item, Kind, MapDifference, surface_changes, wall_changes
from tccm_ros.report.tables import text_table
from tccm_ros.results.folder_reader import Results, load_results
from tccm_ros.results.labels_file import MAP_FILE
from tccm_ros.results.map_file import load_map
from tccm_ros.results.models import SurfaceEntry
from tccm_ros.results.trajectory import Trajectory

MAX_STAMP_DIFFERENCE_S = 0.05
"""Maximum time between compared poses of two trajectories, s. Chosen: a scan at 20 Hz."""


@dataclass(frozen=True, slots=True)
class PathDifference:
    """Distance between poses at the same times.

    Attributes
    ----------
    length_before, length_after
        Path lengths, m.
    poses
        Number of compared poses.
    rms, largest
        RMS and maximum distance, m; None if no poses are compared.
    """

    length_before: float
    length_after: float
    poses: int
    rms: float | None
    largest: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Differences between two maps.

    Attributes
    ----------
    before, after
        The maps, both in the first one's frame.
    surfaces, walls, path
        Their differences.
    laid_over
        Planar pose (x, y, yaw) of the second map's frame in the first's, m and rad, found by
        `find_alignment`; None if both have the same frame.
    """

    before: Results
    after: Results
    surfaces: tuple[MapDifference[SurfaceEntry], ...]
    walls: tuple[MapDifference[Wall], ...]
    path: PathDifference
    laid_over: tuple[float, float, float] | None = None

    def counts(self, changes: Sequence[MapDifference[Item]]) -> str:
        """Return the number of changes of each kind, as text."""
        counts = Counter(change.kind for change in changes)
        return ", ".join(f"{counts[kind]} {kind}" for kind in Kind)

    def surface_rows(self) -> Iterator[tuple[str, ...]]:
        """Yield kind, label, ids, heights over the floor, areas and shift of each surface."""
        for change in self.surfaces:
            sides = ((change.before, self.before.ground), (change.after, self.after.ground))
            found = [(surface, ground) for surface, ground in sides if surface is not None]
            shift = ""
            if change.before is not None and change.after is not None:
                moved = change.after.centroid[:2] - change.before.centroid[:2]
                shift = f"{np.linalg.norm(moved):.3f}"
            yield (
                change.kind,
                _old_and_new([s.label for s, _ in found]),
                _old_and_new([str(s.id) for s, _ in found]),
                _old_and_new([f"{s.height - ground:.3f}" for s, ground in found]),
                _old_and_new([f"{s.area:.2f}" for s, _ in found]),
                shift,
            )

    def text(self) -> str:
        """Return the comparison as lines for a terminal."""
        head = ("", "label", "id", "height, m", "area, m2", "shift, m")
        return "\n".join([text_table([head, *self.surface_rows()]), *self.notes()])

    def notes(self) -> Iterator[str]:
        """Yield the counts, the paths and the alignment, a sentence each."""
        yield f"surfaces: {self.counts(self.surfaces)}"
        yield f"walls: {self.counts(self.walls)}"
        yield f"paths: {self.path_text()}"
        if self.laid_over is not None:
            yield f"the second map was laid over the first: {pose_text(self.laid_over)}"

    def path_text(self) -> str:
        """Return the lengths and the difference of the paths, as text."""
        path = self.path
        text = f"{path.length_before:.2f} m and {path.length_after:.2f} m"
        if path.rms is None:
            return text + ", at different times"
        distance = f"distance {path.rms:.3f} m rms of {path.poses} poses, {path.largest:.3f} m max"
        return f"{text}, {distance}"


def _old_and_new(shown: Sequence[str]) -> str:
    """Return the value of one or two maps, ``old -> new`` if they differ."""
    return shown[0] if len(set(shown)) == 1 else " -> ".join(shown)


def compare(folder_a: Path | str, folder_b: Path | str, *, lay_over: bool = False) -> Comparison:
    """Compare two result folders; the first has the older map.

    Parameters
    ----------
    folder_a, folder_b
        Output folders of ``tccm replay --out``.
    lay_over
        Whether the second map has another frame and must be aligned to the first.

    Raises
    ------
    MapError
        If a folder or one of its files is missing or damaged, or if one map is not found in the
        other.
    """
    before, after = load_results(folder_a), load_results(folder_b)
    if not lay_over:
        return compare_results(before, after)
    one, other = (load_map(Path(folder) / MAP_FILE) for folder in (folder_a, folder_b))
    pose = find_alignment(one, other, Config())
    if pose is None:
        raise MapError(
            f"{folder_b}: not found in the map of {folder_a}; expected two maps of the same rooms"
        )
    comparison = compare_results(before, moved_results(after, pose))
    x, y, yaw = (round(float(value), 6) for value in pose)
    return replace(comparison, laid_over=(x, y, yaw))


def compare_results(before: Results, after: Results) -> Comparison:
    """Compare two maps in one frame."""
    return Comparison(
        before,
        after,
        tuple(surface_changes(before, after)),
        tuple(wall_changes(before.walls, after.walls)),
        _path_difference(before.trajectory, after.trajectory),
    )


def _path_difference(before: Trajectory, after: Trajectory) -> PathDifference:
    lengths = before.length, after.length
    if len(before.stamps) == 0 or len(after.stamps) == 0:
        return PathDifference(*lengths, 0, None, None)
    nearest = before.nearest(after.stamps)
    near = np.abs(before.stamps[nearest] - after.stamps) <= MAX_STAMP_DIFFERENCE_S
    if not near.any():
        return PathDifference(*lengths, 0, None, None)
    distances = np.linalg.norm((before.positions[nearest] - after.positions)[near, :2], axis=1)
    rms = float(np.sqrt(np.mean(distances**2)))
    return PathDifference(*lengths, int(near.sum()), rms, float(distances.max()))
