"""A simulator of robots with lasers, with its own geometry."""

from tccm_ros.pipeline.sim.engine import Message, Simulation
from tccm_ros.pipeline.sim.options import Options, options_from_settings
from tccm_ros.pipeline.sim.recording import run, simulate
from tccm_ros.pipeline.sim.worlds import WORLDS, build_world

__all__ = [
    "WORLDS",
    "Message",
    "Options",
    "Simulation",
    "build_world",
    "options_from_settings",
    "run",
    "simulate",
]
