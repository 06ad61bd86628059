"""Assign hits to planes, and find the parameters that these hits may determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.calibrate.model import RigValues
from tccm_ros.calibrate.patches import Patches
from tccm_ros.calibrate.problem import LevelHits, Planes, Problem
from tccm_ros.calibrate.recording import CalibrationRecording, LevelScans
from tccm_ros.calibrate.surroundings import (
    CEILING,
    FIRST_WALL,
    FLOOR,
    NO_PLANE,
    assign,
    near_another,
)

WALL_MARGIN = 0.2
"""Maximum distance of level laser hits beyond the part of a wall observed by the tilting laser, m
(chosen)."""

VARIED_SPEED = 0.3
"""Minimum fraction of the joint's speed that is not linear in its angle, for a time offset to be
observable (chosen)."""


def assigned(
    problem: Problem,
    x: Float64,
    recording: CalibrationRecording,
    patches: Patches,
    gates: tuple[float, float],
    level_gate: float,
) -> Problem:
    """Return a problem with hits assigned to planes under the current estimate.

    Parameters
    ----------
    problem
        Problem with its planes; its hits are replaced.
    x
        float64 (P,), the estimate.
    recording, patches
        The input, and its patches.
    gates
        Maximum distance (m) and angle (rad) of a patch to its plane.
    level_gate
        Maximum distance of a level laser hit to its wall, m.
    """
    model, places = problem.model, recording.places[patches.centers.cycle]
    values = RigValues.of_vector(x[problem.layout.rig])
    centers = model.transform_points(patches.centers, values)
    normals = model.transform_directions(patches.centers, values, patches.normals)
    planes = _seen_planes(problem, x)
    plane = assign(centers, normals, places, patches.spread, planes, gates)
    of_hit = plane[patches.patch]
    everywhere = model.transform_points(patches.hits, values)
    place_of_hit = places[patches.patch]
    on_plane = (of_hit != NO_PLANE) & ~near_another(everywhere, place_of_hit, of_hit, planes)
    hits, place = patches.hits.take(on_plane), places[patches.patch[on_plane]]
    problem = replace(problem, hits=hits, plane=of_hit[on_plane], place=place)
    tilt_hits = model.transform_points(hits, values)
    level = tuple(
        _on_walls(problem, x, scans, place, tilt_hits, level_gate)
        for place, scans in sorted(recording.level.items())
    )
    return replace(problem, level=level)


def determinable(problem: Problem, values: RigValues, *, floor_is_known: bool) -> Bool:
    """Return a mask (P,) of the parameters with hits that may determine them.

    Parameters
    ----------
    problem
        Problem with assigned hits.
    values
        The rig.
    floor_is_known
        Whether the floor's height in the base frame is known; otherwise the laser's height is not
        observable.
    """
    layout = problem.layout
    free = np.zeros(layout.size, bool)
    free[layout.rig] = free[layout.bias] = True
    seen = np.bincount(problem.plane, minlength=FIRST_WALL + layout.walls) > 0
    free[layout.floor] = seen[FLOOR]
    for bag in np.unique(problem.bag[problem.place[problem.plane == CEILING]]).tolist():
        free[layout.ceiling(bag)] = True
    for number in range(layout.walls):
        free[layout.wall(number)] = seen[FIRST_WALL + number]
    for place in np.unique(problem.place).tolist():
        free[layout.roll_pitch(place)] = True
    free[layout.rig.start + 3] = floor_is_known and bool(seen[FLOOR])
    free[layout.rig.start + 4] = _speeds_vary(problem, values)
    walls = {int(w) for hits in problem.level for w in np.unique(hits.wall) if w >= 0}
    # A pan zero and a yaw of the level laser are indistinguishable: a head trusts the level laser.
    free[layout.rig.start + 5] = bool(walls) and problem.model.pans
    free[layout.level] = bool(walls) and not problem.model.pans
    return free


def _seen_planes(problem: Problem, x: Float64) -> Planes:
    """Return the planes; missing ones are at an infinite distance."""
    planes, found = problem.planes(x), problem.surroundings
    if found.floor is None:
        planes.offsets[planes.number == FLOOR] = np.inf
    hidden = np.array([height is None for height in found.ceilings])
    ceilings = planes.number == CEILING
    planes.offsets[ceilings] = np.where(hidden[problem.bag], np.inf, planes.offsets[ceilings])
    return planes


def _on_walls(
    problem: Problem, x: Float64, scans: LevelScans, place: int, tilt_hits: Float64, gate: float
) -> LevelHits:
    """Assign level laser hits to walls observed by the tilting laser."""
    _, points = problem.level_points(x, scans)
    nearest, wall = np.full(len(points), gate), np.full(len(points), -1, np.int64)
    for number, found in enumerate(problem.surroundings.walls):
        mine = problem.plane == FIRST_WALL + number
        if found.place != place or not mine.any():
            continue
        phi, rho, _ = x[problem.layout.wall(number)]
        along = np.array([-np.sin(phi), np.cos(phi)])
        limits = np.quantile(tilt_hits[mine, :2] @ along, [0.01, 0.99])
        positions = points[:, :2] @ along
        distance = np.abs(points[:, :2] @ [np.cos(phi), np.sin(phi)] - rho)
        better = (
            (distance < nearest)
            & (positions > limits[0] - WALL_MARGIN)
            & (positions < limits[1] + WALL_MARGIN)
        )
        nearest[better], wall[better] = distance[better], number
    return LevelHits(scans, place, wall)


def _speeds_vary(problem: Problem, values: RigValues) -> bool:
    """Return whether a time offset is distinguishable from a zero offset and a scale.

    Tilt cycles in one direction at constant speed shift all angles equally, like a zero offset.
    """
    if not len(problem.plane):
        return False
    model, step = problem.model, 2e-3
    early, late = (model.measured(problem.hits, values.delayed(shift)) for shift in (step, -step))
    speed, angle = (late - early) / (2.0 * step), (late + early) / 2.0
    A = np.column_stack([np.ones(len(angle)), angle])
    rest = speed - A @ np.linalg.lstsq(A, speed, rcond=None)[0]
    return bool(np.std(rest) > VARIED_SPEED * np.sqrt(np.mean(speed**2)) > 0.0)
