"""Open a result folder, a saved map or a bag in the Rerun viewer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.progress import Bars
from tccm_ros.replay.replay import replay
from tccm_ros.results.map_file import is_map, load_map
from tccm_ros.view.rerun_log import rerun_file


def rerun_of(target: Path | str, config: Config, bars: Bars | None = None) -> Path:
    """Write the .rrd of a result folder, a saved map or a bag into the working directory.

    Parameters
    ----------
    target
        A result folder or a map, which shows only the map, or a bag, which is replayed and shows
        its measurements too.
    config
        Configuration for a map or a bag.
    bars
        Progress bars.

    Returns
    -------
    Path
        The file, named after the target.

    Raises
    ------
    TccmError
        If the target is missing, of another kind, or damaged.
    """
    target, bars = Path(target), bars or Bars()
    saved = target / "map.mcap"
    if not target.exists():
        raise MapError(f"{target}: no such result folder, map or bag")
    out = Path(f"{target.resolve().stem}.rrd")
    if saved.is_file() or (target.is_file() and is_map(target)):
        bars.start("solve", 1.0)
        solution = SurfaceSlam.from_saved(
            config, load_map(saved if saved.is_file() else target)
        ).solve()
        with rerun_file(out, config) as log:
            log.add_map(solution)
        return out
    with TemporaryDirectory() as folder, rerun_file(out, config) as log:
        replay(target, Path(folder) / "out", config, pictures=False, watcher=log, bars=bars)
    return out


def open_rerun(recording: Path) -> Path:
    """Open an .rrd in rerun-sdk's viewer as an independent process, and return its path.

    Raises
    ------
    OutputError
        If the viewer cannot be started; the message names the file.
    """
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        raise OutputError(f"{recording}: there is no display here; open this file on a desktop")
    program = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if program is None:
        raise OutputError(f"{recording}: there is no program 'rerun' here; open this file in it")
    subprocess.Popen([program, "--bind", "127.0.0.1", str(recording)], start_new_session=True)
    return recording
