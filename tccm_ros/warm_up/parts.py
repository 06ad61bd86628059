"""What compiles the kernels of each processor: made-up recordings, in parts of like length."""

from __future__ import annotations

from tccm_ros.config import Config

PARTS = {"tccm": ("tilt", "outlines"), "slam": ("drive",)}
"""The parts of each processor (`Stream.processor`), in the order in which they are begun.

`tilt` calls the kernels of outlines as well. They take longest after those of the planes, so that
they are compiled beside these: when `tilt` comes to them they are on disk."""


LOADED = {"tccm": "tilt", "slam": "tracking"}
"""What a node calls itself: slam_node tracks, and has another process solve."""


def warm_up(processor_name: str, config: Config) -> None:
    """Compile or load the kernels that a processor has in its node.

    Parameters
    ----------
    processor_name
        A key of `PARTS`.
    config
        Of the processor.
    """
    run_part(LOADED[processor_name], config)


def run_part(part: str, config: Config) -> None:
    """Compile or load the kernels of a part; what the others need is not even imported.

    Parameters
    ----------
    part
        One of `PARTS` or `LOADED`.
    config
        Of the processor.
    """
    if part == "tilt":
        from tccm_ros.warm_up.tilt import warm_up_tccm

        warm_up_tccm(config)
    elif part == "outlines":
        from tccm_ros.warm_up.outlines import warm_up_outlines

        warm_up_outlines()
    elif part == "tracking":
        from tccm_ros.warm_up.tracking import warm_up_tracking

        warm_up_tracking(config)
    else:
        from tccm_ros.warm_up.drive import warm_up_slam

        warm_up_slam(config)
