"""Door signs as landmarks of the graph: detection, factors, and optimised signs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.records import SIGN, Landmark, RefusedSign, Sign, SignSighting
from tccm_ros.signs.texts import vote
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, wall_key
from tccm_ros.slam.factors.landmarks import landmark_class
from tccm_ros.slam.factors.signs import SignOnWall, SignStart
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.landmarks import AnchoredObservation
from tccm_ros.slam.signs.association import associate_signs, number_signs
from tccm_ros.slam.signs.plates import misplacement, plate_on_wall
from tccm_ros.slam.signs.presence import (
    Looks,
    SeenSign,
    is_read_by_chance,
    is_taken_away,
    looks_at,
    reading_probabilities,
    seen_pictures,
)
from tccm_ros.slam.signs.sightings import Sighting, find_sightings
from tccm_ros.slam.signs.triangulation import RAY_CHI2, Rays, triangulate
from tccm_ros.slam.signs.views import PictureView, SignView, camera_poses, rays_of
from tccm_ros.slam.signs.walls import is_behind_wall, wall_of_sign
from tccm_ros.slam.walls.association import WallTable

WALL_SIGMA = 0.02
"""Standard deviation (m) of the distance of a plate from its wall: thickness and skirting
(chosen)."""


MIN_VIEWS_WITHOUT_WALL = 3
"""Minimum number of views of a sign on no known wall: two rays always meet approximately
(chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundSign(SeenSign):
    """A sign with its id and its wall.

    Attributes
    ----------
    id
        Id of the sign.
    wall
        Index of its wall, -1 for none.
    refusal
        Reason of a refusal by its views; empty otherwise.
    """

    id: int
    wall: int
    refusal: str = ""

    @property
    def key(self) -> Key:
        """The sign's variable."""
        return Key(landmark_class(SIGN).letter, self.id)


def find_signs(
    views: Sequence[SignView],
    pictures: Sequence[PictureView],
    solution: GraphSolution,
    chain: KeyframeChain,
    walls: WallTable,
) -> tuple[list[FoundSign], list[RefusedSign]]:
    """Return the signs with enough views and not too many misses, by id.

    The second list contains the refused readings of room numbers, with positions.

    Parameters
    ----------
    views
        Views in the order of the pictures, those of earlier sessions first.
    pictures
        Pictures searched in this session, in stamp order.
    solution
        Solution of the graph without signs.
    chain
        Keyframes of all sessions.
    walls
        Walls of the map, with at least one observation each.
    """
    if not views:
        return [], []
    keys, sessions = chain.keys, [chain.keyframes[v.anchored.keyframe].session for v in views]
    poses = solution.planar_poses(keys)
    cameras = camera_poses(views, poses)
    rays = rays_of(views, poses)
    signs = associate_signs(
        find_sightings(views, rays, sessions),
        lambda a, b, p: solution.relative_covariance(keys[a], keys[b], p),
    )
    ids = number_signs(signs, [v.sign for v in views])
    refused: list[RefusedSign] = []
    known: list[FoundSign] = []
    for i, sign in sorted(zip(ids, signs), key=lambda pair: pair[0]):
        found = _found(i, sign, views, rays, walls)
        reason = found.refusal or _misplacement(found, views, cameras)
        if reason:
            refused.append(_refused(found, reason))
        else:
            known.append(found)
    seen = seen_pictures(pictures, camera_poses(pictures, poses), views)
    looks = [looks_at(sign, seen, walls) for sign in known]
    reasons = [_absence(looks, k) for k in range(len(looks))]
    refused += [_refused(sign, reason) for sign, reason in zip(known, reasons) if reason]
    there = [sign for sign, reason in zip(known, reasons) if not reason]
    return there, sorted(refused, key=lambda r: tuple(r.position))


def _absence(looks: Sequence[Looks], k: int) -> str:
    """Return why a sign is absent, by the pictures that read it and those that missed it."""
    probability = reading_probabilities(looks, k)
    if is_read_by_chance(looks[k], probability):
        return "read in few of the pictures that show the place"
    return "taken away" if is_taken_away(looks[k], probability) else ""


def _misplacement(sign: FoundSign, views: Sequence[SignView], cameras: Float64) -> str:
    """Return why height, size or tilt exclude a sign; empty where they do not."""
    own = [i for i, view in enumerate(views) if any(view is v for v in sign.views)]
    corners = np.array([views[i].measurement.plate for i in own])
    corners = np.einsum("nij,nkj->nki", cameras[own, :3, :3], corners)
    plate = plate_on_wall(sign.position, sign.normal, cameras[own, :3, 3], corners)
    return misplacement(sign.position, plate)


def _refused(sign: FoundSign, reason: str) -> RefusedSign:
    seen = [view.measurement for view in sign.views]
    number, _ = vote([(m.number, m.confidence) for m in seen])
    return RefusedSign(number, sign.position, reason)


def _found(
    number: int,
    sightings: Sequence[Sighting],
    views: Sequence[SignView],
    rays: Rays,
    walls: WallTable,
) -> FoundSign:
    """Return a sign without inconsistent views."""
    members = sorted(i for s in sightings for i in s.views)
    point = triangulate(rays.of(members)).position
    kept = [i for i, chi2 in zip(members, rays.of(members).chi2(point)) if chi2 < RAY_CHI2]
    if len(kept) < len(members) and len(kept) >= 2:
        point = triangulate(rays.of(kept)).position
    reason = "" if kept else "its views contradict each other"
    kept = kept or members
    origins = rays.origins[kept]
    origin = np.asarray(origins.mean(axis=0))
    if not reason and is_behind_wall(point, origins, walls):
        reason = "behind a wall: a reflection"
    wall = wall_of_sign(point, origin, walls)
    if not reason and wall < 0 and len(kept) < MIN_VIEWS_WITHOUT_WALL:
        reason = "on no known wall, in few views"
    normal = _horizontal(origin - point)
    if wall >= 0:
        normal = np.array([-np.cos(walls.phi[wall]), -np.sin(walls.phi[wall]), 0.0])
    seen = tuple(views[i] for i in kept)
    return FoundSign(point, normal, seen, origins, number, wall, reason)


def _horizontal(direction: Float64) -> Float64:
    """Return the horizontal part of a direction (3,), a unit vector float64 (3,)."""
    away = direction * [1.0, 1.0, 0.0]
    return np.asarray(away / max(float(np.linalg.norm(away)), 1e-12))


def sign_observations(signs: Sequence[FoundSign]) -> list[AnchoredObservation]:
    """Return the views of signs as observations of landmarks."""
    return [view.observation(sign.id) for sign in signs for view in sign.views]


def sign_factors(signs: Sequence[FoundSign], scale: float) -> list[Factor]:
    """Return the factors with start values of signs, and those of signs on walls.

    Parameters
    ----------
    signs
        All signs.
    scale
        Factor by which the covariances of the graph's other factors are too large.
    """
    factors: list[Factor] = [SignStart(sign.key, sign.position) for sign in signs]
    factors += [
        SignOnWall(sign.key, wall_key(sign.wall), WALL_SIGMA / np.sqrt(scale))
        for sign in signs
        if sign.wall >= 0
    ]
    return factors


def sign_records(
    signs: Sequence[FoundSign], landmarks: Sequence[Landmark], solution: GraphSolution, whole: Int64
) -> tuple[Sign, ...]:
    """Return the optimised signs, by id.

    Parameters
    ----------
    signs
        The signs of the graph, before optimisation.
    landmarks
        The optimised landmarks of all kinds.
    solution
        Solution of the graph that contains them.
    whole
        int64 (W,), index of the whole wall of each wall in the graph (`WallTable.whole_numbers`).
    """
    optimised = {m.id: m for m in landmarks if m.kind == SIGN}
    return tuple(_record(sign, optimised[sign.id], solution, whole) for sign in signs)


def _record(sign: FoundSign, landmark: Landmark, solution: GraphSolution, whole: Int64) -> Sign:
    seen = [view.measurement for view in sign.views]
    number, confidence = vote([(m.number, m.confidence) for m in seen])
    text, _ = vote([(m.text, m.confidence) for m in seen if m.number == number])
    is_held = sign.wall >= 0
    origin = np.asarray(sign.origins.mean(axis=0))
    away = -solution.plane(wall_key(sign.wall))[:3] if is_held else origin - landmark.position
    return Sign(
        sign.id,
        text,
        number,
        confidence,
        landmark.position,
        _horizontal(away),
        landmark.covariance,
        int(whole[sign.wall]) if is_held else None,
        tuple(
            SignSighting(v.measurement.stamp_ns, v.anchored.keyframe, v.measurement.pixel)
            for v in sign.views
        ),
    )
