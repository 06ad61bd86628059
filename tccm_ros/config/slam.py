"""Wall SLAM: lines, matching, odometry, walls, the graph and its loops."""

from __future__ import annotations

from typing import Literal

from tccm_ros.config.parameter import Group, param

__all__ = ["Graph", "Lines", "Loops", "Matching", "Odometry", "Walls"]


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
