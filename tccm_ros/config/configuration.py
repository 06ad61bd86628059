"""All groups of parameters in one configuration, and all parameters in one list."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from tccm_ros.config.approach import ApproachConfig
from tccm_ros.config.mapping import (
    CenterCoreConfig,
    CycleConfig,
    MapConfig,
    ObjectsConfig,
    PlanesConfig,
)
from tccm_ros.config.node import MarkersConfig, QosConfig, SaveConfig, ScanHereConfig, TfConfig
from tccm_ros.config.parameter import Group, Parameter, param, parameters_of
from tccm_ros.config.sensors import FramesConfig, RigConfig, ScanFilterConfig, SensorsConfig
from tccm_ros.config.signs import SignsConfig
from tccm_ros.config.slam import (
    GraphConfig,
    LinesConfig,
    LocalisationConfig,
    LoopsConfig,
    MatchingConfig,
    OdometryConfig,
    WallsConfig,
)
from tccm_ros.config.surfaces import LabelsConfig, SurfacesConfig, ViewsConfig


class Config(Group):
    """All parameters: the groups, and three that are in no group.

    Attributes
    ----------
    clock_jump, sync_timeout, reorder_window
        s, of message time.
    frames, rig, ...
        The groups of parameters.
    """

    frames: FramesConfig = Field(default_factory=FramesConfig)
    rig: RigConfig = Field(default_factory=RigConfig)
    scan: ScanFilterConfig = Field(default_factory=ScanFilterConfig)
    sensors: SensorsConfig = Field(default_factory=SensorsConfig)
    cycle: CycleConfig = Field(default_factory=CycleConfig)
    map: MapConfig = Field(default_factory=MapConfig)
    planes: PlanesConfig = Field(default_factory=PlanesConfig)
    center_core: CenterCoreConfig = Field(default_factory=CenterCoreConfig)
    objects: ObjectsConfig = Field(default_factory=ObjectsConfig)
    signs: SignsConfig = Field(default_factory=SignsConfig)
    lines: LinesConfig = Field(default_factory=LinesConfig)
    matching: MatchingConfig = Field(default_factory=MatchingConfig)
    odometry: OdometryConfig = Field(default_factory=OdometryConfig)
    walls: WallsConfig = Field(default_factory=WallsConfig)
    localisation: LocalisationConfig = Field(default_factory=LocalisationConfig)
    graph: GraphConfig = Field(default_factory=GraphConfig)
    loops: LoopsConfig = Field(default_factory=LoopsConfig)
    views: ViewsConfig = Field(default_factory=ViewsConfig)
    surfaces: SurfacesConfig = Field(default_factory=SurfacesConfig)
    labels: LabelsConfig = Field(default_factory=LabelsConfig)
    qos: QosConfig = Field(default_factory=QosConfig)
    tf: TfConfig = Field(default_factory=TfConfig)
    save: SaveConfig = Field(default_factory=SaveConfig)
    scan_here: ScanHereConfig = Field(default_factory=ScanHereConfig)
    markers: MarkersConfig = Field(default_factory=MarkersConfig)
    approach: ApproachConfig = Field(default_factory=ApproachConfig)
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
        "after a gap in its stamps, a sensor waits this long, by its stamps, for late records; 0 "
        "for none",
        unit="s",
        ge=0.0,
        le=1.0,
        read_only=True,
    )


def parameters() -> Iterator[Parameter]:
    """Yield every parameter in the order of declaration, named ``group.key``."""
    yield from parameters_of(Config)
