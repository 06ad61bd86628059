"""The configuration: every parameter with its unit, range and meaning.

One set of classes serves the command line (``--set group.key=value``), the YAML files and the
nodes' ROS parameters (``group.key``). A parameter is declared once, by `param`; the shipped YAML,
the nodes' declarations and the README's table are made from it and a test holds them together.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

__all__ = ["Config", "Parameter", "parameters"]


def param(
    default: Any,
    meaning: str,
    *,
    unit: str = "",
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    read_only: bool = False,
) -> Any:
    """Declare one parameter.

    Parameters
    ----------
    default
        Value when nothing is set.
    meaning
        One line for the YAML file, the node's descriptor and the README.
    unit
        SI unit, or empty for a pure number or a name.
    ge, gt, le
        Limits, in `unit`.
    read_only
        Whether a running node refuses to change it (frames, sizes and structure).
    """
    return Field(
        default,
        description=meaning,
        ge=ge,
        gt=gt,
        le=le,
        json_schema_extra={"unit": unit, "read_only": read_only},
    )


class Group(BaseModel):
    """Base of all groups: unknown keys are errors, assignments are checked, numbers are finite."""

    model_config = ConfigDict(extra="forbid", validate_assignment=True, allow_inf_nan=False)


Pose6 = tuple[float, float, float, float, float, float]
Box = tuple[float, float, float, float, float, float]


class Frames(Group):
    """Names that are found from the data unless they are set (DESIGN section 3)."""

    base: str = param("", "base frame; empty: child frame of the odometry", read_only=True)
    odom: str = param("odom", "odometry frame when there is no odometry", read_only=True)
    map: str = param("map", "map frame", read_only=True)
    tilt_joint: str = param(
        "", "tilting joint; empty: the moving joint nearest to the laser", read_only=True
    )
    prefix: str = param(
        "", "put before map and odom frame names, for several robots", read_only=True
    )

    @property
    def map_name(self) -> str:
        """Name of the map frame, with the prefix."""
        return self.prefix + self.map

    @property
    def odom_name(self) -> str:
        """Name of the odometry frame where nothing else names it, with the prefix."""
        return self.prefix + self.odom


class Rig(Group):
    """Where the lasers are when no robot description says so, and corrections of a real rig."""

    kinematics: Literal["auto", "urdf", "tf", "rig"] = param(
        "auto", "where the lasers are: robot description, recorded tf or this group", read_only=True
    )
    tilt_laser: Pose6 | None = param(
        None,
        "tilting laser in base at joint zero: x y z roll pitch yaw (m, rad); the joint turns about "
        "tilt_axis through tilt_center",
        unit="m, rad",
        read_only=True,
    )
    tilt_center: tuple[float, float, float] | None = param(
        None,
        "a point of the tilt axis in base; empty: the laser's own place",
        unit="m",
        read_only=True,
    )
    tilt_axis: tuple[float, float, float] = param(
        (0.0, 1.0, 0.0), "tilt axis in base; +y tilts down with growing angle", read_only=True
    )
    level_laser: Pose6 | None = param(
        None, "level laser in base: x y z roll pitch yaw", unit="m, rad", read_only=True
    )
    tilt_offset: float = param(
        0.0, "added to the measured tilt angle", unit="rad", ge=-3.2, le=3.2, read_only=True
    )
    tilt_scale: float = param(
        1.0, "multiplies the measured tilt angle before the offset", ge=0.5, le=2.0, read_only=True
    )
    joint_time_offset: float = param(
        0.0, "added to the stamps of the joint samples", unit="s", ge=-1.0, le=1.0, read_only=True
    )
    mount_correction: Pose6 = param(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "correction of the tilting laser's mount, x y z roll pitch yaw, applied in base before "
        "the chain: T_base_laser = T_correction * T_chain",
        unit="m, rad",
        read_only=True,
    )
    level_correction: Pose6 = param(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "correction of the level laser's pose, as mount_correction",
        unit="m, rad",
        read_only=True,
    )


class ScanFilter(Group):
    """From ranges to points."""

    shadow_angle: float = param(
        0.14,
        "a beam whose line to its neighbour's hit lies within this angle of the beam is a mixed "
        "pixel and is dropped, unless it is in line with its neighbours; 0 turns the filter off",
        unit="rad",
        ge=0.0,
        le=1.0,
    )
    shadow_jump: float = param(
        0.03,
        "smaller steps in range between neighbours are noise, not mixed pixels",
        unit="m",
        ge=0.0,
        le=1.0,
    )
    min_range: float = param(0.0, "ranges below this are dropped", unit="m", ge=0.0)
    max_range: float = param(30.0, "ranges above this are dropped", unit="m", gt=0.0)
    self_filter: bool = param(
        True, "drop points inside the robot's own collision boxes, spheres and cylinders"
    )
    self_padding: float = param(0.02, "margin around the robot's links", unit="m", ge=0.0, le=0.5)


class Cycle(Group):
    """Tilt cycles from the joint alone."""

    dead_band: float = param(
        0.010, "reversals smaller than this are encoder jitter", unit="rad", gt=0.0, le=0.5
    )
    min_sweep: float = param(
        0.10, "a sweep shorter than this is joined to the next", unit="rad", gt=0.0, le=3.0
    )
    rest_time: float = param(
        0.5, "a cycle closes when the joint rests this long", unit="s", gt=0.0, le=60.0
    )
    max_gap: float = param(
        0.5, "a gap in the joint samples longer than this closes a cycle", unit="s", gt=0.0, le=60.0
    )
    max_time: float = param(30.0, "a cycle is closed after this time", unit="s", gt=0.0, le=600.0)


class Map(Group):
    """The part maps and the integration map."""

    cell_size: float = param(0.02, "edge of a cell", unit="m", ge=0.002, le=1.0, read_only=True)
    window_cycles: int = param(
        10, "part maps in the integration map", ge=1, le=1000, read_only=True
    )
    cuboid_depth: float = param(
        0.03,
        "depth d0 below a point that its cuboid covers",
        unit="m",
        gt=0.0,
        le=1.0,
        read_only=True,
    )
    gap: Literal["fixed", "adaptive"] = param(
        "adaptive", "adaptive: d0 grows with range x angular step", read_only=True
    )
    gap_factor: float = param(
        1.5,
        "adaptive gap: depth in units of range x the larger of the angles between beams and "
        "between scan lines",
        ge=0.0,
        le=10.0,
        read_only=True,
    )
    max_depth: float = param(
        0.30, "adaptive gap: the largest depth", unit="m", gt=0.0, le=3.0, read_only=True
    )
    mode: Literal["union", "paper"] = param(
        "union", "paper: Eq. (1) as printed, as a baseline", read_only=True
    )
    region: Box | None = param(
        None,
        "region of interest in region_frame: x_min x_max y_min y_max z_min z_max; empty: all",
        unit="m",
    )
    region_frame: Literal["base", "odom"] = param(
        "base", "base: the region follows the robot", read_only=True
    )
    clear_seen_through: bool = param(
        False, "a beam of the newest cycle that passed through a cuboid removes it"
    )
    retain_points: bool = param(
        False, "keep the points of the window so that it can be rebuilt", read_only=True
    )


class Planes(Group):
    """The pooled-moment plane detector and the tracking of planes."""

    source: Literal["map", "part"] = param("map", "detect in the integration map or the part map")
    height_threshold: float = param(
        0.010, "largest step in height between neighbours of one surface", unit="m", gt=0.0, le=0.2
    )
    horizontal_angle: float = param(
        0.10, "a plane within this angle of level is horizontal", unit="rad", gt=0.0, le=0.8
    )
    min_points: int = param(50, "points that support a plane", ge=4)
    min_area: float = param(0.02, "area of a plane", unit="m2", ge=0.0)
    max_rms: float = param(
        0.015, "largest standard deviation of the points across a plane", unit="m", gt=0.0, le=0.2
    )
    flatness: float = param(
        0.15, "largest ratio of the standard deviations across and along a plane", gt=0.0, le=0.5
    )
    track_distance: float = param(
        0.03, "a plane that moved less across itself is the same plane", unit="m", gt=0.0, le=1.0
    )
    track_angle: float = param(
        0.15, "a plane that turned less is the same plane", unit="rad", gt=0.0, le=1.0
    )
    track_cycles: int = param(3, "cycles that a hidden plane keeps its id", ge=0, le=1000)


class CenterCore(Group):
    """The paper's center-core detector, a baseline."""

    trials: int = param(50, "random trials", ge=1, le=10000)
    cores: int = param(3, "center cores drawn in a trial (l)", ge=2, le=100)
    min_quality: float = param(0.15, "least val of Eq. (8)", unit="m2", ge=0.0)
    angle_threshold: float = param(0.30, "Eq. (7) and belonging", unit="rad", gt=0.0, le=1.5)
    distance_threshold: float = param(0.02, "belonging", unit="m", gt=0.0, le=0.5)


class Objects(Group):
    """What stands on a surface, and where there is room."""

    min_height: float = param(0.02, "an object rises at least this", unit="m", gt=0.0, le=1.0)
    max_height: float = param(0.60, "only what is lower is an object", unit="m", gt=0.0, le=3.0)
    cluster_distance: float = param(0.05, "gap that separates objects", unit="m", gt=0.0, le=1.0)
    min_points: int = param(8, "points of an object", ge=1)
    track_distance: float = param(
        0.15, "an object that moved less is the same", unit="m", gt=0.0, le=2.0
    )
    place_size: tuple[float, float] = param(
        (0.15, 0.15), "width and depth of what should be put down", unit="m"
    )


class Lines(Group):
    """Line extraction from level scans."""

    extractor: Literal["split_merge", "ransac"] = param("split_merge", "line extractor")
    min_length: float = param(0.50, "shortest line", unit="m", gt=0.0)
    min_points: int = param(8, "least beams on a line", ge=3)
    distance: float = param(0.03, "largest distance of an inlier", unit="m", gt=0.0, le=0.5)
    max_gap: float = param(
        0.60, "largest distance between neighbours of a line", unit="m", gt=0.0, le=5.0
    )
    trials: int = param(60, "ransac: pairs drawn for each line", ge=1, le=10000)


class Matching(Group):
    """Scan-to-submap matching between level scans."""

    enabled: bool = param(True, "match level scans; off: odometry alone")
    range_sigma: float = param(0.02, "noise of one range", unit="m", gt=0.0, le=0.5)
    search_distance: float = param(
        0.15, "least half width of the correlative search", unit="m", gt=0.0, le=2.0
    )
    search_angle: float = param(
        0.06, "least half width of the correlative search", unit="rad", gt=0.0, le=1.0
    )
    submap_keyframes: int = param(20, "newest keyframes in the local map", ge=1, le=500)
    correlated_beams: float = param(
        4.0, "beams that carry as much information as one independent beam", ge=1.0, le=100.0
    )


class Odometry(Group):
    """How far odometry is trusted."""

    sigma_per_m: float = param(0.05, "translation noise per metre", gt=0.0, le=2.0)
    sigma_rad_per_rad: float = param(0.05, "rotation noise per radian", gt=0.0, le=2.0)
    sigma_rad_per_m: float = param(0.02, "rotation noise per metre", unit="rad/m", gt=0.0, le=2.0)


class Walls(Group):
    """Wall landmarks."""

    enabled: bool = param(True, "use walls as landmarks")
    min_observations: int = param(3, "keyframes that confirm a wall", ge=2, le=1000)
    gate_distance: float = param(
        0.06, "a line further from a wall is another wall", unit="m", gt=0.0, le=2.0
    )
    gate_angle: float = param(
        0.04, "a line that differs more from a wall is another wall", unit="rad", gt=0.0, le=0.5
    )
    max_gap: float = param(
        0.50, "a line further along from a wall's extent is another wall", unit="m", ge=0.0, le=50.0
    )
    flatness: float = param(
        0.01, "how far real walls stray from a plane, added to a line's noise", unit="m", ge=0.0
    )
    discount: float = param(
        2.0, "factor on the covariance of a line whose beams matching has used too", ge=1.0, le=100
    )
    structure_prior: bool = param(
        False, "soft prior on parallel and right-angled walls where the data support it"
    )


class Graph(Group):
    """Keyframes and optimisation."""

    mode: Literal["mapping", "localisation"] = param(
        "mapping", "localisation: a loaded map stays as it is", read_only=True
    )
    keyframe_distance: float = param(0.30, "a keyframe each", unit="m", gt=0.0, le=10.0)
    keyframe_angle: float = param(0.35, "a keyframe each", unit="rad", gt=0.0, le=3.2)


class Loops(Group):
    """Loop closures."""

    enabled: bool = param(True, "search for loop closures")
    min_path: float = param(
        6.0, "least path between two keyframes of a loop closure", unit="m", gt=0.0
    )
    max_window: float = param(
        10.0, "largest half width of a search, whatever the drift", unit="m", gt=0.0, le=50.0
    )
    drift: float = param(
        0.04, "how fast the search window grows with the path", unit="m/m", gt=0.0, le=1.0
    )
    drift_angle: float = param(
        0.006, "how fast the search window turns with the path", unit="rad/m", gt=0.0, le=1.0
    )
    min_score: float = param(0.45, "least mean likelihood of a match", ge=0.0, le=1.0)
    min_inliers: float = param(0.45, "least share of matched points", ge=0.0, le=1.0)
    max_contradiction: float = param(
        0.12, "largest share of points where beams of the submap passed", ge=0.0, le=1.0
    )
    ambiguity: float = param(
        0.9, "a match is ambiguous when another place scores this share of it", gt=0.0, le=1.0
    )
    confirmations: int = param(
        3, "mutually consistent matches that make a loop closure", ge=1, le=100
    )


class Views(Group):
    """Views of surfaces."""

    when: Literal["always", "still"] = param(
        "always", "still: only sweeps in which the base stood still"
    )
    cell_size: float = param(
        0.10, "column of the seen-through view", unit="m", gt=0.01, le=1.0, read_only=True
    )
    reach: float = param(
        5.0, "distance up to which a sweep tells what it saw through", unit="m", gt=0.0, le=50.0
    )
    place_distance: float = param(
        0.10, "a place: the newer view replaces the older", unit="m", ge=0.0, le=2.0
    )
    place_angle: float = param(0.0873, "a place, as place_distance", unit="rad", ge=0.0, le=3.2)
    voxel_size: float = param(0.01, "thinning of stored clouds", unit="m", gt=0.0, le=0.2)
    clear_margin: float = param(
        0.03,
        "what a newer view looked through is gone if it is this far inside the free interval",
        unit="m",
        ge=0.0,
        le=0.5,
    )


class Surfaces(Group):
    """The surface map."""

    segmentation: Literal["tccm", "seed"] = param(
        "tccm", "seed: iterative RANSAC and clustering as published", read_only=True
    )
    min_points: int = param(500, "seed: least points of a cluster", ge=3)
    seed_distance: float = param(
        0.02, "seed: distance of an inlier from its plane", unit="m", gt=0.0, le=0.2
    )
    cluster_distance: float = param(0.10, "seed: Euclidean clustering", unit="m", gt=0.0, le=1.0)
    merge_distance: float = param(
        0.05, "surfaces with points this near are one, if coplanar", unit="m", gt=0.0, le=1.0
    )
    min_height: float = param(0.30, "least height above the floor", unit="m", ge=0.0, le=3.0)
    max_step: float = param(
        0.03, "surfaces further apart in height are never one", unit="m", gt=0.0, le=0.5
    )
    min_area: float = param(0.02, "smallest surface in the map", unit="m2", ge=0.0)
    max_floor_height: float = param(
        0.15, "the floor is not higher than this above the first base frame", unit="m", le=2.0
    )
    registration: bool = param(True, "register overlapping views")


Rule = tuple[float, float, float, float, float, float]


def label_rule(default: Rule, meaning: str) -> Any:
    """Declare the rule of one label: ranges of height above the floor, width and area."""
    return param(
        default,
        f"{meaning}: least and largest height above the floor, width, area",
        unit="m, m2",
    )


class Labels(Group):
    """What a surface is called: rules over its height, width (of its narrowest box) and area."""

    table: Rule = label_rule((0.66, 0.80, 0.45, 2.0, 0.25, 6.0), "a table or desk")
    counter: Rule = label_rule((0.82, 1.10, 0.35, 1.0, 0.30, 6.0), "a counter")
    low_table: Rule = label_rule(
        (0.30, 0.55, 0.40, 1.0, 0.36, 0.9), "a low table without a back: called table"
    )
    seat: Rule = label_rule((0.40, 0.47, 0.30, 0.60, 0.10, 0.30), "a seat of a chair or stool")
    sofa: Rule = label_rule(
        (0.34, 0.50, 0.40, 1.1, 0.40, 2.8), "a seat with a back along it: called seat"
    )
    bed: Rule = label_rule((0.30, 0.62, 0.75, 2.4, 1.30, 6.0), "a bed")
    shelf: Rule = label_rule((0.10, 2.20, 0.12, 0.65, 0.04, 2.0), "a board over or under another")
    ledge: Rule = label_rule((0.30, 2.20, 0.03, 0.25, 0.02, 1.0), "something long and narrow")
    step: Rule = label_rule(
        (0.30, 1.60, 0.10, 1.0, 0.02, 1.5), "a low step on a larger surface, or a tread of stairs"
    )
    step_height: tuple[float, float] = param(
        (0.015, 0.15), "a step rises this much above the surface that carries it", unit="m"
    )
    stair_rise: tuple[float, float] = param(
        (0.12, 0.23), "treads of stairs rise this much above each other", unit="m"
    )
    shelf_gap: tuple[float, float] = param(
        (0.12, 0.70), "boards of a shelf are this far apart", unit="m"
    )
    back_height: tuple[float, float] = param(
        (0.20, 0.70), "a back rises this much above its seat", unit="m"
    )
    wall_distance: float = param(
        0.15, "an edge this near to a wall stands at it", unit="m", ge=0.0, le=1.0
    )
    min_confidence: float = param(0.5, "below this a surface is labelled other", ge=0.0, le=1.0)


class Qos(Group):
    """Quality of service of the sensor subscriptions."""

    reliability: Literal["best_effort", "reliable"] = param(
        "best_effort", "reliability asked of scan publishers", read_only=True
    )
    stamp: Literal["header", "receive"] = param(
        "header", "receive: stamps of arrival, for drivers without a clock", read_only=True
    )
    silence: float = param(
        5.0,
        "an input that is silent this long is reported",
        unit="s",
        gt=0.0,
        le=3600.0,
        read_only=True,
    )


class Tf(Group):
    """The transform map -> odom."""

    publish: bool = param(
        True, "publish map -> odom on /tf where tf2_msgs is installed", read_only=True
    )
    rate: float = param(20.0, "of map -> odom", unit="Hz", gt=0.0, le=200.0)
    transform_tolerance: float = param(
        0.1, "map -> odom is stamped this much after the newest scan", unit="s", ge=0.0, le=10.0
    )


class Save(Group):
    """Where and when a live node saves."""

    directory: str = param("tccm_map", "folder that ~/save_map writes and ~/load_map reads")
    on_shutdown: bool = param(False, "save when the node is told to stop")
    autosave_minutes: float = param(
        0.0, "save this often; 0 never", unit="min", ge=0.0, le=1440.0, read_only=True
    )


class Markers(Group):
    """What the markers show."""

    cuboid_color: Literal["height", "age"] = param("height", "what colours a cuboid")


class Config(Group):
    """All parameters."""

    frames: Frames = Field(default_factory=Frames)
    rig: Rig = Field(default_factory=Rig)
    scan: ScanFilter = Field(default_factory=ScanFilter)
    cycle: Cycle = Field(default_factory=Cycle)
    map: Map = Field(default_factory=Map)
    planes: Planes = Field(default_factory=Planes)
    center_core: CenterCore = Field(default_factory=CenterCore)
    objects: Objects = Field(default_factory=Objects)
    lines: Lines = Field(default_factory=Lines)
    matching: Matching = Field(default_factory=Matching)
    odometry: Odometry = Field(default_factory=Odometry)
    walls: Walls = Field(default_factory=Walls)
    graph: Graph = Field(default_factory=Graph)
    loops: Loops = Field(default_factory=Loops)
    views: Views = Field(default_factory=Views)
    surfaces: Surfaces = Field(default_factory=Surfaces)
    labels: Labels = Field(default_factory=Labels)
    qos: Qos = Field(default_factory=Qos)
    tf: Tf = Field(default_factory=Tf)
    save: Save = Field(default_factory=Save)
    markers: Markers = Field(default_factory=Markers)
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


class Parameter(NamedTuple):
    """One parameter as the YAML file, the nodes and the README show it."""

    name: str
    default: Any
    type: Any
    unit: str
    minimum: float | None
    maximum: float | None
    meaning: str
    read_only: bool


def parameters(group: type[BaseModel] = Config, prefix: str = "") -> Iterator[Parameter]:
    """Yield every parameter in the order of declaration, named ``group.key``."""
    for key, field in group.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Group):
            yield from parameters(annotation, f"{prefix}{key}.")
        else:
            yield _parameter(f"{prefix}{key}", field)


def _parameter(name: str, field: FieldInfo) -> Parameter:
    limits = {"ge": None, "gt": None, "le": None}
    for constraint in field.metadata:
        for key in limits:
            limits[key] = getattr(constraint, key, limits[key])
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    minimum = limits["ge"] if limits["ge"] is not None else limits["gt"]
    return Parameter(
        name,
        field.default,
        field.annotation,
        str(extra["unit"]),
        minimum,
        limits["le"],
        field.description or "",
        bool(extra["read_only"]),
    )
