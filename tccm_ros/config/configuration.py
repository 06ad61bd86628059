"""All groups of parameters in one configuration, and all parameters in one list."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from tccm_ros.config.approach import Approach
from tccm_ros.config.mapping import CenterCore, Cycle, Map, Objects, Planes
from tccm_ros.config.node import Markers, Qos, Save, ScanHere, Tf
from tccm_ros.config.parameter import Group, Parameter, param, parameters_of
from tccm_ros.config.sensors import Frames, Rig, ScanFilter, Sensors
from tccm_ros.config.signs import Signs
from tccm_ros.config.slam import Graph, Lines, Localisation, Loops, Matching, Odometry, Walls
from tccm_ros.config.surfaces import Labels, Surfaces, Views


class Config(Group):
    """All parameters: the groups, and three that are in no group.

    Attributes
    ----------
    clock_jump, sync_timeout, reorder_window
        s, of message time.
    frames, rig, ...
        The groups of parameters.
    """

    frames: Frames = Field(default_factory=Frames)
    rig: Rig = Field(default_factory=Rig)
    scan: ScanFilter = Field(default_factory=ScanFilter)
    sensors: Sensors = Field(default_factory=Sensors)
    cycle: Cycle = Field(default_factory=Cycle)
    map: Map = Field(default_factory=Map)
    planes: Planes = Field(default_factory=Planes)
    center_core: CenterCore = Field(default_factory=CenterCore)
    objects: Objects = Field(default_factory=Objects)
    signs: Signs = Field(default_factory=Signs)
    lines: Lines = Field(default_factory=Lines)
    matching: Matching = Field(default_factory=Matching)
    odometry: Odometry = Field(default_factory=Odometry)
    walls: Walls = Field(default_factory=Walls)
    localisation: Localisation = Field(default_factory=Localisation)
    graph: Graph = Field(default_factory=Graph)
    loops: Loops = Field(default_factory=Loops)
    views: Views = Field(default_factory=Views)
    surfaces: Surfaces = Field(default_factory=Surfaces)
    labels: Labels = Field(default_factory=Labels)
    qos: Qos = Field(default_factory=Qos)
    tf: Tf = Field(default_factory=Tf)
    save: Save = Field(default_factory=Save)
    scan_here: ScanHere = Field(default_factory=ScanHere)
    markers: Markers = Field(default_factory=Markers)
    approach: Approach = Field(default_factory=Approach)
    clock_jump: float = param(
        2.0,
        "a backward step of time beyond this resets the map",
        unit="s",
        gt=0.0,
        le=3600.0,
        read_only=True,
    )
    sync_timeout: float = param(
        0.5,
        "longest wait for samples that bracket a scan, in message time",
        unit="s",
        gt=0.0,
        le=60.0,
        read_only=True,
    )
    reorder_window: float = param(
        0.05,
        "after a gap in its stamps a sensor waits so long, in its own time, for a record that was "
        "overtaken; 0 for none",
        unit="s",
        ge=0.0,
        le=1.0,
        read_only=True,
    )


def parameters() -> Iterator[Parameter]:
    """Yield every parameter in the order of declaration, named ``group.key``."""
    yield from parameters_of(Config)
