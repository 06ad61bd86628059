"""Write a calibration: rig.yaml, with calibration.json and a picture in the same folder.

The picture shows the room from the side and its floor, before and after.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from tccm_ros.arrays import Bool, Float64
from tccm_ros.atomic import output_folder
from tccm_ros.calibrate.calibration import Calibration
from tccm_ros.calibrate.model import RigValues
from tccm_ros.calibrate.quality import HitMasks
from tccm_ros.calibrate.room import hits_of_bag
from tccm_ros.report.drawing import canvas, png

MAX_DRAWN, MAX_RANGE = 25_000, 9.0
"""Maximum number of drawn hits, and their maximum range, m."""

ROOM, FLOOR, CEILING = "#9aa3ad", "#d55e00", "#0072b2"


def write_calibration(calibration: Calibration, out: Path | str) -> tuple[Path, Path, Path]:
    """Write all files, or none.

    Parameters
    ----------
    calibration
        The result to write.
    out
        The parameter file; its folder is created if needed.

    Returns
    -------
    tuple of Path
        The parameter file, the result with covariances, and the picture.

    Raises
    ------
    OutputError
        Where a file cannot be written.
    """
    out = Path(out)
    with output_folder(out.absolute().parent) as made:
        (made / out.name).write_text(calibration.yaml(), encoding="utf-8")
        content = json.dumps(calibration.to_json(), indent=1)
        (made / "calibration.json").write_text(content + "\n", encoding="utf-8")
        _write_picture(calibration, made / "calibration.png")
    return out, out.parent / "calibration.json", out.parent / "calibration.png"


def _write_picture(calibration: Calibration, path: Path) -> None:
    """Draw the first place from the side, before and after, with floor and ceiling in colour."""
    found, recording = calibration.observability.estimate, calibration.recording
    model, first = found.problem.model, slice(0, int((recording.places == 0).sum()))
    beams, seen = hits_of_bag(calibration.observability, recording, 0, first)
    some = np.arange(0, len(beams.cycle), max(len(beams.cycle) // MAX_DRAWN, 1))
    beams, seen = beams.take(some), HitMasks(seen.floor[some], seen.ceiling[some])
    near = np.linalg.norm(beams.points, axis=1) < MAX_RANGE
    with canvas(10.0, 6.4) as (figure, _):
        for row, (title, values) in enumerate(
            (("before", found.configured), ("after", found.values))
        ):
            points = model.transform_points(beams, values)
            side = figure.add_axes((0.06, 0.56 - 0.49 * row, 0.58, 0.38))
            _draw_side(side, points, near, seen)
            side.set_title(f"{calibration.bags[0]}, {title}: {_settings(values)}", fontsize=9)
            bend = figure.add_axes((0.72, 0.56 - 0.49 * row, 0.26, 0.38))
            _draw_floor(bend, points[seen.floor & near])
            bend.set_title("floor by distance", fontsize=9)
        path.write_bytes(png(figure))


def _settings(values: RigValues) -> str:
    zero, roll = np.rad2deg([values.tilt_offset, values.roll])
    return f"zero {zero:.2f} deg, scale {values.tilt_scale:.4f}, roll {roll:.2f} deg"


def _draw_side(axes: Axes, points: Float64, near: Bool, seen: HitMasks) -> None:
    for rows, color in (
        (near & ~seen.floor & ~seen.ceiling, ROOM),
        (near & seen.floor, FLOOR),
        (near & seen.ceiling, CEILING),
    ):
        axes.scatter(points[rows, 0], points[rows, 2], s=0.5, c=color, linewidths=0.0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x in base, m", fontsize=8)
    axes.set_ylabel("z, m", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(lw=0.3)


def _draw_floor(axes: Axes, points: Float64) -> None:
    """Plot the height of the floor over the distance from the base."""
    if len(points) == 0:
        return
    distance = np.hypot(points[:, 0], points[:, 1])
    middle = float(np.median(points[:, 2]))
    axes.scatter(distance, 1e3 * (points[:, 2] - middle), s=0.5, c=FLOOR, linewidths=0.0)
    axes.axhline(0.0, color="#15181c", lw=0.6)
    axes.set_xlabel("distance, m", fontsize=8)
    axes.set_ylabel("height less median, mm", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.grid(lw=0.3)
