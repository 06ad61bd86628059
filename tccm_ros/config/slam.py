"""Parameters of wall SLAM: lines, matching, odometry, walls, graph and loop closures."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param


class LinesConfig(Group):
    """Line extraction from level scans."""

    extractor: Literal["split_merge", "ransac"] = param("split_merge", "line extractor")
    min_length: float = param(0.50, "shortest line", unit="m", gt=0.0)
    min_points: int = param(8, "min number of beams on a line", ge=3)
    distance: float = param(0.03, "largest distance of an inlier", unit="m", gt=0.0, le=0.5)
    max_gap: float = param(
        0.60, "largest distance between neighbours of a line", unit="m", gt=0.0, le=5.0
    )
    trials: int = param(60, "ransac: pairs drawn for each line", ge=1, le=10000)


class MatchingConfig(Group):
    """Scan-to-submap matching between level scans."""

    enabled: bool = param(True, "match level scans; off: odometry alone")
    range_sigma: float = param(0.02, "noise of one range", unit="m", gt=0.0, le=0.5)
    search_distance: float = param(
        0.15, "min half width of the correlative search", unit="m", gt=0.0, le=2.0
    )
    search_angle: float = param(
        0.06, "min half width of the correlative search", unit="rad", gt=0.0, le=1.0
    )
    submap_keyframes: int = param(20, "newest keyframes in the local map", ge=1, le=500)
    correlated_beams: float = param(
        4.0, "beams that carry as much information as one independent beam", ge=1.0, le=100.0
    )


class OdometryConfig(Group):
    """Noise of odometry."""

    sigma_per_m: float = param(0.05, "translation noise per metre", gt=0.0, le=2.0)
    sigma_rad_per_rad: float = param(0.05, "rotation noise per radian", gt=0.0, le=2.0)
    sigma_rad_per_m: float = param(0.02, "rotation noise per metre", unit="rad/m", gt=0.0, le=2.0)
    sigma_scale: float = param(
        0.01,
        "standard deviation of the scale of distances, the same all the way",
        ge=0.0,
        le=0.5,
        read_only=True,
    )


class WallsConfig(Group):
    """Wall landmarks."""

    enabled: bool = param(True, "use walls as landmarks")
    min_observations: int = param(3, "keyframes that confirm a wall", ge=2, le=1000)
    gate_distance: float = param(
        0.06, "a line further from a wall is another wall", unit="m", gt=0.0, le=2.0
    )
    gate_angle: float = param(
        0.04, "a line whose angle to a wall is larger is another wall", unit="rad", gt=0.0, le=0.5
    )
    max_gap: float = param(
        0.50, "a line further along from a wall's extent is another wall", unit="m", ge=0.0, le=50.0
    )
    flatness: float = param(
        0.01, "deviation of real walls from a plane, added to the noise of a line", unit="m", ge=0.0
    )
    thickness: float = param(
        0.08,
        "parallel, overlapping walls closer than this are merged",
        unit="m",
        ge=0.0,
        le=0.5,
    )
    discount: float = param(
        2.0, "factor on the covariance of a line whose beams matching used too", ge=1.0, le=100
    )
    corners: Literal["auto", "none", "point", "endpoint"] = param(
        "auto",
        "shared ends of walls as landmarks: points near which both walls pass, or the endpoints of "
        "both, as published; auto: points where matching has not used their beams",
    )


class LocalisationConfig(Group):
    """Source of map -> odom (docs/guides/your_localisation.md)."""

    source: Literal["slam", "tf"] = param(
        "slam",
        "slam: level scans and loop closures; tf: another program's map -> odom on /tf, whose map "
        "frame surfaces are in",
        read_only=True,
    )
    sigma: tuple[float, float] = param(
        (0.05, 0.03),
        "tf: standard deviation of the external pose, position and yaw",
        unit="m, rad",
    )

    @property
    def is_external(self) -> bool:
        """Whether another program localises the robot."""
        return self.source == "tf"


class GraphConfig(Group):
    """Keyframes and optimisation."""

    mode: Literal["mapping", "localisation"] = param(
        "mapping", "localisation: a loaded map stays as it is", read_only=True
    )
    keyframe_distance: float = param(0.30, "distance between keyframes", unit="m", gt=0.0, le=10.0)
    keyframe_angle: float = param(0.35, "rotation between keyframes", unit="rad", gt=0.0, le=3.2)


class LoopsConfig(Group):
    """Loop closures."""

    enabled: bool = param(True, "search for loop closures")
    min_path: float = param(
        6.0, "min path between two keyframes of a loop closure", unit="m", gt=0.0
    )
    max_window: float = param(
        10.0, "largest half width of a search, whatever the drift", unit="m", gt=0.0, le=50.0
    )
    drift: float = param(
        0.04, "growth of the search window with the path", unit="m/m", gt=0.0, le=1.0
    )
    drift_angle: float = param(
        0.006, "growth of the search window's angle with the path", unit="rad/m", gt=0.0, le=1.0
    )
    min_score: float = param(0.45, "min mean likelihood of a match", ge=0.0, le=1.0)
    min_inliers: float = param(0.45, "min fraction of matched points", ge=0.0, le=1.0)
    max_contradiction: float = param(
        0.12, "max fraction of points where beams of the submap passed", ge=0.0, le=1.0
    )
    ambiguity: float = param(
        0.9, "a match is ambiguous if another pose scores this fraction of it", gt=0.0, le=1.0
    )
    confirmations: int = param(
        3, "mutually consistent matches that make a loop closure", ge=1, le=100
    )
