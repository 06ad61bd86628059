"""A simulator whose geometry is written down independently of the mapping code."""

from tccm_ros.pipeline.sim.engine import Published, Simulation
from tccm_ros.pipeline.sim.options import Options, options_from_settings
from tccm_ros.pipeline.sim.recording import run, simulate
from tccm_ros.pipeline.sim.worlds import WORLDS, build_world

__all__ = [
    "WORLDS",
    "Options",
    "Published",
    "Simulation",
    "build_world",
    "options_from_settings",
    "run",
    "simulate",
]
