"""Our trajectory errors against those of evo, on random trajectories; evo is for tests alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tccm_ros.evaluate.trajectory_errors import (
    absolute_errors,
    distance_errors,
    relation_errors,
)
from tccm_ros.geometry import inverse, pose, spatial

metrics = pytest.importorskip("evo.core.metrics")
trajectory = pytest.importorskip("evo.core.trajectory")

POSES, STEP = 60, 0.5


def wandering(rng, is_planar):
    """A random way with steps of `STEP` m, and the same with errors: float64 (N, 4, 4) each."""
    heading = np.cumsum(rng.normal(0.0, 0.4, POSES))
    rise = np.zeros(POSES) if is_planar else rng.normal(0.0, 0.3, POSES)
    steps = np.stack([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])
    positions = np.cumsum(STEP * steps, axis=1).T
    truth = spatial(np.column_stack([positions[:, :2], heading]))
    truth[:, 2, 3] = positions[:, 2]
    errors = rng.normal(0.0, 0.05, (POSES, 6))
    if is_planar:
        errors[:, [2, 3, 4]] = 0.0
    noise = np.stack([pose(Rotation.from_rotvec(e[3:]).as_matrix(), e[:3]) for e in errors])
    return truth, spatial(rng.normal(0.0, 1.0, 3)) @ truth @ noise


def evo_errors(metric, truth, found):
    """Return evo's translation and rotation errors."""
    rows = []
    for relation in ("translation_part", "rotation_angle_rad"):
        one = metric(metrics.PoseRelation[relation])
        one.process_data((truth, found))
        rows.append(one.error)
    return rows


@pytest.fixture(params=[(seed, planar) for seed in range(4) for planar in (True, False)], ids=str)
def ways(request):
    seed, is_planar = request.param
    return wandering(np.random.default_rng(seed), is_planar)


def paths(ways):
    stamps = np.arange(POSES, dtype=float)
    return [trajectory.PoseTrajectory3D(poses_se3=list(T), timestamps=stamps) for T in ways]


@pytest.mark.parametrize("aligned", [True, False])
def test_absolute_errors_are_those_of_evo(ways, aligned):
    truth, found = paths(ways)
    if aligned:
        found.align(truth)
    translation, rotation = evo_errors(metrics.APE, truth, found)
    ours = absolute_errors(ways[1], ways[0], aligned=aligned)
    np.testing.assert_allclose(ours.translation, translation, atol=1e-9)
    np.testing.assert_allclose(ours.rotation, rotation, atol=1e-6)


@pytest.mark.parametrize("frames", [1, 7])
def test_errors_of_relations_are_those_of_evo(ways, frames):
    def metric(relation):
        return metrics.RPE(relation, frames, metrics.Unit.frames, all_pairs=True)

    translation, rotation = evo_errors(metric, *paths(ways))
    truth, found = ways
    deltas = inverse(truth[:-frames]) @ truth[frames:]
    ours = relation_errors(found[:-frames], found[frames:], deltas)
    np.testing.assert_allclose(ours.translation, translation, atol=1e-9)
    np.testing.assert_allclose(ours.rotation, rotation, atol=1e-6)


def test_errors_over_distance_are_those_of_evo(ways):
    """Over 4.75 m of a way with steps of 0.5 m: ten poses later."""

    def metric(relation):
        return metrics.RPE(relation, 10, metrics.Unit.frames, all_pairs=True)

    translation, rotation = evo_errors(metric, *paths(ways))
    ours = distance_errors(ways[1], ways[0], 4.75)
    np.testing.assert_allclose(ours.translation, translation, atol=1e-9)
    np.testing.assert_allclose(ours.rotation, rotation, atol=1e-6)
