"""Write a calibration: rig.yaml, with calibration.json and calibration.png in the same folder."""

from __future__ import annotations

import json
from pathlib import Path

from tccm_ros.atomic import output_folder
from tccm_ros.calibrate.calibration import Calibration
from tccm_ros.calibrate.picture import write_picture


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
        write_picture(calibration, made / "calibration.png")
    return out, out.parent / "calibration.json", out.parent / "calibration.png"
