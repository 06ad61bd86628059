"""Parameters of tilt cycles, of the TCCM, of planes and of objects on them."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param

Box = tuple[float, float, float, float, float, float]


class CycleConfig(Group):
    """Detection of tilt cycles from the angle of the joint."""

    dead_band: float = param(
        0.010, "reversals smaller than this are encoder jitter", unit="rad", gt=0.0, le=0.5
    )
    min_sweep: float = param(
        0.10, "a shorter tilt cycle is joined to the next", unit="rad", gt=0.0, le=3.0
    )
    rest_time: float = param(
        0.5, "a tilt cycle ends when the joint rests this long", unit="s", gt=0.0, le=60.0
    )
    max_gap: float = param(
        0.5, "a longer gap in the joint samples ends a tilt cycle", unit="s", gt=0.0, le=60.0
    )
    max_time: float = param(30.0, "a tilt cycle ends after this time", unit="s", gt=0.0, le=600.0)
    period: float = param(
        1.0,
        "without a tilting laser a cycle ends after this time, or when the base has moved by 0.2 m "
        "or 10 deg",
        unit="s",
        gt=0.0,
        le=600.0,
    )


class MapConfig(Group):
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
        False, "a beam of the newest tilt cycle that passed through a cuboid removes it"
    )


class PlanesConfig(Group):
    """The plane detector and the tracking of planes."""

    detector: Literal["moments", "center_cores", "neighbours"] = param(
        "moments",
        "moments: pooled moments; center_cores (needs map.region), neighbours: the published "
        "detectors, as baselines",
    )
    source: Literal["map", "part"] = param("map", "detect in the integration map or the part map")
    height_threshold: float = param(
        0.010,
        "neighbours and labels of cuboids: tops of one surface differ by less",
        unit="m",
        gt=0.0,
        le=0.2,
    )
    horizontal_angle: float = param(
        0.10, "a plane tilted by less than this is horizontal", unit="rad", gt=0.0, le=0.8
    )
    min_points: int = param(50, "minimum number of points of a plane", ge=4)
    min_area: float = param(0.02, "minimum area of a plane", unit="m2", ge=0.0)
    max_rms: float = param(
        0.015, "largest standard deviation of the points across a plane", unit="m", gt=0.0, le=0.2
    )
    flatness: float = param(
        0.15, "largest ratio of the standard deviations across and along a plane", gt=0.0, le=0.5
    )
    track_distance: float = param(
        0.03, "a plane that moved less along its normal is the same plane", unit="m", gt=0.0, le=1.0
    )
    track_angle: float = param(
        0.15, "a plane whose normal rotated less is the same plane", unit="rad", gt=0.0, le=1.0
    )
    track_cycles: int = param(3, "tilt cycles that a hidden plane keeps its id", ge=0, le=1000)


class CenterCoreConfig(Group):
    """The center-core plane detector of the paper, a baseline."""

    trials: int = param(50, "random trials", ge=1, le=10000)
    cores: int = param(3, "center cores drawn in a trial (l)", ge=2, le=100)
    min_quality: float = param(0.15, "min quality, Eq. (8) of the TCCM paper", unit="m2", ge=0.0)
    angle_threshold: float = param(0.30, "angle of Eq. (7)", unit="rad", gt=0.0, le=1.5)
    distance_threshold: float = param(0.02, "distance of an inlier", unit="m", gt=0.0, le=0.5)
    min_length: float = param(
        0.0, "shorter cores are not used (standard deviation along the core)", unit="m", ge=0.0
    )
    cluster_distance: float = param(
        0.10, "cores of a plane whose cells are nearer are one surface", unit="m", gt=0.0, le=1.0
    )


class ObjectsConfig(Group):
    """Objects on horizontal surfaces, and free places between them."""

    min_height: float = param(0.02, "min height of an object", unit="m", gt=0.0, le=1.0)
    max_height: float = param(
        0.60, "max height; longer objects may be split at seen surface", unit="m", gt=0.0, le=3.0
    )
    cluster_distance: float = param(0.05, "gap that separates objects", unit="m", gt=0.0, le=1.0)
    min_points: int = param(8, "minimum number of points of an object", ge=1)
    track_distance: float = param(0.15, "max motion between cycles", unit="m", gt=0.0, le=2.0)
    agreeing_views: int = param(2, "agreeing views that confirm a change", ge=1, le=100)
    place_size: tuple[float, float] = param(
        (0.15, 0.15), "width and depth of a free place for an object to put down", unit="m"
    )
