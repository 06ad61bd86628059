"""The two pictures of a result folder."""

from __future__ import annotations

import io
from pathlib import Path
from typing import NamedTuple

from tccm_ros.atomic import output_file
from tccm_ros.pipeline.report.map3d_picture import write_map3d
from tccm_ros.pipeline.report.map_picture import write_map
from tccm_ros.results.folder_reader import Results

__all__ = ["Pictures", "draw_pictures", "write_pictures"]


class Pictures(NamedTuple):
    """PNG files: the map from above, and in perspective."""

    above: bytes
    perspective: bytes


def draw_pictures(results: Results) -> Pictures:
    """Draw both pictures; the same results give the same bytes."""
    above, perspective = io.BytesIO(), io.BytesIO()
    write_map(results, above)
    write_map3d(results, perspective)
    return Pictures(above.getvalue(), perspective.getvalue())


def write_pictures(results: Results, folder: Path | str) -> Pictures:
    """Draw map.png and map3d.png into a folder, and return them.

    Raises
    ------
    OutputError
        If a picture cannot be written.
    """
    pictures = draw_pictures(results)
    for name, content in zip(("map.png", "map3d.png"), pictures, strict=True):
        with output_file(Path(folder) / name) as made:
            made.write_bytes(content)
    return pictures
