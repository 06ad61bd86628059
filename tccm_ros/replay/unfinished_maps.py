"""Maps of a replay that is still running, for `tccm view`.

A replay writes into a hidden folder that becomes the output folder at its end (`atomic`). While
somebody holds a lock of its subfolder `MAPS`, the replay writes its newest map there; otherwise it
solves for no map before its end.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path

from tccm_ros.atomic import folders_in_progress, is_locked, output_folder
from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.results.exports import write_solution
from tccm_ros.results.folder_reader import Results, load_results

MAPS = "maps"
"""Subfolder with the newest map, in a folder of its number."""

MIN_PERIOD_S = 1.0
"""Minimum time between two maps, s."""

MAX_FRACTION = 0.5
"""Maximum fraction of the time of a replay that its maps take."""


class UnfinishedMaps:
    """Writes the newest map of a running replay while somebody looks at it.

    Parameters
    ----------
    folder
        The hidden folder of the replay's results.
    config
        Configuration of the replay.
    """

    def __init__(self, folder: Path, config: Config):
        self._maps, self._config = folder / MAPS, config
        self._number, self._next_s = 0, 0.0
        self._maps.mkdir()

    def offer(self, slam: SurfaceSlam) -> None:
        """Write the map if it is looked at and the last one is old enough."""
        begin_s = time.monotonic()
        if begin_s < self._next_s or not is_locked(self._maps):
            return
        with output_folder(self._maps / str(self._number + 1)) as made:
            write_solution(made, slam.solve(), self._config)
        shutil.rmtree(self._maps / str(self._number), ignore_errors=True)
        self._number += 1
        end_s = time.monotonic()
        self._next_s = end_s + max(MIN_PERIOD_S, (end_s - begin_s) * (1.0 / MAX_FRACTION - 1.0))

    def close(self) -> None:
        """Remove the maps."""
        shutil.rmtree(self._maps)


def running_replay(out: Path | str) -> Path | None:
    """Return the folder of the maps of a replay that is writing `out`; None if there is none."""
    found = (folder / MAPS for folder in folders_in_progress(out))
    return next((maps for maps in found if maps.is_dir()), None)


def is_running(maps: Path) -> bool:
    """Return whether the replay with this folder of maps is still running."""
    return maps.is_dir() and is_locked(maps.parent)


def newest_map(maps: Path, after: int) -> tuple[int, Results] | None:
    """Return the newest map of a running replay with its number; None if it is not newer.

    Parameters
    ----------
    maps
        The folder of `running_replay`.
    after
        Number of the newest map that is known.
    """
    numbers = [int(path.name) for path in maps.glob("*") if path.name.isdecimal()]
    newest = max(numbers, default=0)
    if newest <= after:
        return None
    try:
        return newest, load_results(maps / str(newest))
    except MapError:  # the replay has just written a newer one and removed this one
        return None
