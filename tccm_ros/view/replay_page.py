"""The live page of a running replay, for `tccm view`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tccm_ros.atomic import shared_lock
from tccm_ros.errors import RequestError
from tccm_ros.geometry import planar
from tccm_ros.replay.unfinished_maps import is_running, newest_map
from tccm_ros.report.array_pack import PlainArrays
from tccm_ros.report.entities import rounded
from tccm_ros.report.scene import build_scene
from tccm_ros.results.folder_reader import Results
from tccm_ros.view.live_page import LivePage
from tccm_ros.view.live_state import Entities, LiveState, path_entity

POLL_S = 0.2
"""Period of the check for a newer map, s, as that of messages to the page."""

KINDS = {
    "surfaces": "surface",
    "walls": "wall",
    "objects": "object",
    "signs": "sign",
    "free": "free",
    "racks": "compartment",
}
"""Kind of the entities of `LiveState`, by list of the report's scene."""


def show_replay(maps: Path, open_page: Callable[[str], object]) -> None:
    """Serve the growing map of a replay on the live page until the replay ends.

    Parameters
    ----------
    maps
        Folder of the maps of a running replay (`replay.unfinished_maps`).
    open_page
        Called with the address of the page.

    Raises
    ------
    OSError
        If the replay has ended before the page is open.
    """
    with shared_lock(maps):
        page, number = LivePage(_refuse, frozenset(), "127.0.0.1", 0), 0
        try:
            open_page(page.url)
            while is_running(maps):
                newer = newest_map(maps, number)
                if newer is not None:
                    number, results = newer
                    page.update(state_change(results))
                time.sleep(POLL_S)
        finally:
            page.close()


def state_change(results: Results) -> Callable[[LiveState], None]:
    """Return the change of a page's state that shows the map of a running replay."""
    entities, path = entities_of_results(results), results.trajectory
    last = float(path.stamps[-1]) if len(path.stamps) else results.start
    status = {"is_replay": True, "localisation": f"replay at {last - results.start:.1f} s"}

    def change(state: LiveState) -> None:
        state.entities, state.status = entities, status
        if len(path.stamps):
            state.pose = rounded(planar(path.T_map_base[-1]))

    return change


def entities_of_results(results: Results) -> Entities:
    """Return the map of a result folder as entities of the live page."""
    scene = build_scene(results, PlainArrays())
    found: Entities = {}
    for plural, kind in KINDS.items():
        for k, value in enumerate(scene[plural]):
            found[f"{kind}/{value.get('id', k)}"] = value
    found["path"] = path_entity(results.trajectory.positions[:, :2])
    found["world"] = {name: scene[name] for name in ("ground", "start", "extent")}
    return found


async def _refuse(name: str, values: Mapping[str, Any]) -> Any:
    raise RequestError("a running replay answers no questions")
