"""Named maps of slam_node: ~/save_named_map, ~/load_named_map and ~/list_maps.

A map is a folder of its name in `save.directory`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.task import Future

from tccm_ros.errors import MapError, TccmError
from tccm_ros.nodes.interfaces import offer_service
from tccm_ros.nodes.saving.map_folder import PREVIOUS
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.results.labels_file import MAP_FILE
from tccm_ros.results.map_file import read_content
from tccm_ros.ros.surface_messages import PACKAGE, message_of
from tccm_ros.ros.types import stamp_message

NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}")
"""Valid map names: they cannot leave the folder, and are not hidden in it."""


class MapServices:
    """Services that save, load and list maps by name.

    Parameters
    ----------
    node
        Node of the services.
    begin_save, load
        As in `ClientApi`.
    """

    def __init__(
        self,
        node: SensorNode,
        begin_save: Callable[[Path], Future],
        load: Callable[[Path, str], str],
    ):
        self._node, self._begin_save, self._load_folder = node, begin_save, load
        offer_service(node, "SaveMap", "~/save_named_map", self._save)
        offer_service(node, "LoadMap", "~/load_named_map", self._load)
        offer_service(node, "ListMaps", "~/list_maps", self._list)

    async def _save(self, request: Any, response: Any) -> str:
        folder = named_folder(self._node.save_folder(), request.name)
        if (folder / MAP_FILE).exists() and not request.overwrite:
            raise MapError(
                f"there is a map called '{request.name}'; set overwrite, or take another name"
            )
        with self._node.robot.lock:
            self._node.robot.flush()
            job = self._begin_save(folder)
        message: str = await job
        response.map = self._info(folder)
        return message

    async def _load(self, request: Any, response: Any) -> str:
        folder = named_folder(self._node.save_folder(), request.name)
        if not (folder / MAP_FILE).exists():
            raise MapError(f"there is no map called '{request.name}'; ~/list_maps has them")
        await self._node.worker.call(lambda: self._load_folder(folder, folder.name), self._node)
        response.map = self._info(folder)
        return ""

    def _list(self, _: Any, response: Any) -> str:
        maps = []
        for folder in saved_folders(self._node.save_folder()):
            with suppress(TccmError):  # a damaged map cannot be loaded
                maps.append(self._info(folder))
        response.maps = maps
        return ""

    def _info(self, folder: Path) -> Any:
        """Return the tccm_interfaces/MapInfo of a folder."""
        saved_ns = (folder / MAP_FILE).stat().st_mtime_ns
        size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file())
        return message_of(
            self._node.types,
            PACKAGE + "MapInfo",
            read_content(folder / MAP_FILE),
            name=folder.name,
            saved=stamp_message(self._node.types, saved_ns),
            size=size,
        )


def named_folder(root: Path, name: str) -> Path:
    """Return the folder of a map.

    Raises
    ------
    MapError
        If the name is invalid, or its folder is a link to another place.
    """
    if not NAME.fullmatch(name) or name.endswith(PREVIOUS):
        raise MapError(
            f"{name!r} cannot be the name of a map; expected up to 100 letters, digits, '.', '-' "
            f"and '_', not beginning with a dot, nor ending with '{PREVIOUS}'"
        )
    folder = root / name
    if folder.resolve() != root.resolve() / name:
        raise MapError(f"{folder}: leads out of {root}")
    return folder


def saved_folders(root: Path) -> list[Path]:
    """Return the folders of maps, sorted by name; none if the root does not exist."""
    if not root.exists():
        return []
    found = []
    for name in sorted(path.name for path in root.iterdir()):
        with suppress(MapError):
            folder = named_folder(root, name)
            found += [folder] if (folder / MAP_FILE).is_file() else []
    return found
