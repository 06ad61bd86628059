"""The two pictures of a result folder."""

from __future__ import annotations

from pathlib import Path

from tccm_ros.pipeline.report.map3d_picture import write_map3d
from tccm_ros.pipeline.report.map_picture import write_map
from tccm_ros.results.folder_reader import load_results

__all__ = ["write_pictures"]


def write_pictures(folder: Path | str, truth: Path | str | None = None) -> tuple[Path, Path]:
    """Draw map.png and map3d.png into a result folder.

    Parameters
    ----------
    folder
        What ``tccm replay --out`` wrote.
    truth
        A truth.json whose outlines are drawn dashed; the folder's own, if any, when None.

    Returns
    -------
    tuple
        The paths of map.png and map3d.png.

    Raises
    ------
    MapError
        If a file is missing or damaged.
    OutputError
        If a picture cannot be written.
    """
    results = load_results(folder, truth)
    above, perspective = Path(folder) / "map.png", Path(folder) / "map3d.png"
    write_map(results, above)
    write_map3d(results, perspective)
    return above, perspective
