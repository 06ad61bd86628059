"""Parts of the kernels of each processor, which synthetic recordings compile in similar times.

A part is a module of this subpackage with a function `warm_up`.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module

from tccm_ros.config import Config

PARTS = {"tccm": ("tilt", "outlines"), "slam": ("drive",)}
"""Parts of each processor (`Stream.processor`), in the order in which they are started.

`tilt` calls the kernels of outlines as well. These take longest after those of planes, so they are
compiled in parallel and are on disk when `tilt` needs them."""


LOADED = {"tccm": "tilt", "slam": "tracking"}
"""Part called by a node itself: slam_node only tracks, as another process solves."""


def warm_up(processor_name: str, config: Config) -> None:
    """Compile or load the kernels that a processor uses in its node.

    Parameters
    ----------
    processor_name
        A key of `PARTS`.
    config
        Configuration of the processor.
    """
    run_part(LOADED[processor_name], config)


def run_part(part: str, config: Config) -> None:
    """Compile or load the kernels of a part, once per process for equal settings.

    Parameters
    ----------
    part
        One of `PARTS` or `LOADED`.
    config
        Configuration of the processor.
    """
    _run_once(part, config.model_dump_json())


@cache
def _run_once(part: str, config_json: str) -> None:
    """Run the module of a part, without importing those of other parts."""
    module = import_module(f"tccm_ros.warm_up.{part}")
    module.warm_up(Config.model_validate_json(config_json))
