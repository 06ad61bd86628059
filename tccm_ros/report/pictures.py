"""Draw and write map.png and map3d.png of a result folder."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from tccm_ros.atomic import write_output
from tccm_ros.report.map3d_picture import map3d_png
from tccm_ros.report.map_picture import map_png
from tccm_ros.results.folder_reader import Results


class Pictures(NamedTuple):
    """Pictures of a map as PNG files.

    Attributes
    ----------
    above
        The map from above (map.png).
    perspective
        The map in perspective (map3d.png).
    """

    above: bytes
    perspective: bytes


def draw_pictures(results: Results) -> Pictures:
    """Draw both pictures; the same results give the same bytes."""
    return Pictures(map_png(results), map3d_png(results))


def write_pictures(results: Results, folder: Path | str) -> Pictures:
    """Draw map.png and map3d.png into a folder, and return them.

    Raises
    ------
    OutputError
        If a picture cannot be written.
    """
    pictures = draw_pictures(results)
    for name, content in zip(("map.png", "map3d.png"), pictures, strict=True):
        write_output(Path(folder) / name, content)
    return pictures
