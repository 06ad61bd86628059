"""Factors of door signs: residuals against NumPy, derivatives against differences."""

import gtsam
import numpy as np
import pytest

from tccm_ros.geometry import pose_from_rpy, transform
from tccm_ros.records import SIGN
from tccm_ros.slam.factors.keys import Key, wall_key
from tccm_ros.slam.factors.landmarks import landmark_class
from tccm_ros.slam.factors.signs import SignBearing, SignOnWall, tangents

BASE, SIGN_KEY, WALL = Key("o", 0), Key("g", 3), wall_key(2)
STEP = 1e-6


def graph_of(factor):
    graph = gtsam.NonlinearFactorGraph()
    factor.add_to(graph)
    return graph


def derivatives_by_differences(factor, values, key, dim):
    """Return the derivative of the whitened residual by a variable, from its definition."""
    noise = factor.noiseModel()
    columns = []
    for k in range(dim):
        moved = []
        for sign in (1.0, -1.0):
            step = np.zeros(dim)
            step[k] = sign * STEP
            changed = gtsam.VectorValues()
            for symbol in values.keys():  # noqa: SIM118 - no dict
                size = values.zeroVectors().at(symbol).size
                changed.insert(symbol, step if symbol == key else np.zeros(size))
            other = values.retract(changed)
            moved.append(noise.whiten(factor.unwhitenedError(other)))
        columns.append((moved[0] - moved[1]) / (2.0 * STEP))
    return np.stack(columns, axis=1)


def jacobians(factor, values):
    """Return the derivatives that the factor itself gives, by variable."""
    linear = factor.linearize(values)
    A = linear.jacobian()[0]
    blocks, start = {}, 0
    for symbol in linear.keys():  # noqa: SIM118 - no dict
        size = values.zeroVectors().at(symbol).size
        blocks[symbol] = A[:, start : start + size]
        start += size
    return blocks


def bearing_factor(T_base_camera, direction, sigma=0.003):
    cov = np.zeros((6, 6))
    cov[3:, 3:] = sigma**2 * (np.eye(3) - np.outer(direction, direction))
    measured = np.concatenate([T_base_camera[:3, 3], direction])
    return SignBearing(BASE, SIGN_KEY, measured, cov)


def test_the_residual_of_a_bearing_is_the_angle_to_the_sign():
    """Twin: tangents of the two angles between the bearing and the sign, seen from the camera."""
    random = np.random.default_rng(0)
    for _ in range(50):
        T = pose_from_rpy(np.append(random.normal(size=3), random.uniform(-1, 1, 3)))
        at = random.normal(size=3) * 0.3
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        point = transform(T, [at + 2.0 * direction + 0.1 * random.normal(size=3)])[0]
        camera = np.eye(4)
        camera[:3, 3] = at
        values = gtsam.Values()
        values.insert(BASE.symbol, gtsam.Pose3(T))
        values.insert(SIGN_KEY.symbol, point)
        factor = graph_of(bearing_factor(camera, direction)).at(0)
        seen = T[:3, :3].T @ (point - T[:3, 3]) - at
        expected = np.linalg.norm(np.cross(direction, seen)) / (direction @ seen)
        residual = factor.unwhitenedError(values)
        assert np.linalg.norm(residual) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("sigmas", [0.5, 1.345, 10.0, 40.0])
def test_a_wrong_reading_pulls_as_far_as_hubers_function_allows(sigmas):
    """Half the square up to 1.345 sigma, beyond that the tangent there."""
    direction, distance = np.array([1.0, 0.0, 0.0]), 2.0
    values = gtsam.Values()
    values.insert(BASE.symbol, gtsam.Pose3())
    off = distance * 0.003 * sigmas
    values.insert(SIGN_KEY.symbol, np.array([distance, off, 0.0]))
    graph = graph_of(bearing_factor(np.eye(4), direction))
    k = 1.345
    expected = 0.5 * sigmas**2 if sigmas <= k else k * (sigmas - 0.5 * k)
    assert graph.error(values) == pytest.approx(expected, rel=1e-6)


def test_the_derivatives_of_both_factors_are_those_of_their_residuals():
    random = np.random.default_rng(4)
    for _ in range(20):
        T = pose_from_rpy(np.append(random.normal(size=3), random.uniform(-0.3, 0.3, 3)))
        camera = pose_from_rpy([0.2, 0.0, 1.1, 0.0, 0.0, 0.0])
        direction = np.array([1.0, 0.4, 0.2]) / np.linalg.norm([1.0, 0.4, 0.2])
        # Within Huber's threshold, where the weight is one.
        point = transform(T, [camera[:3, 3] + 2.0 * direction])[0] + random.normal(size=3) * 1e-3
        phi = random.uniform(-3.0, 3.0)
        normal = np.array([np.cos(phi), np.sin(phi), 0.0])
        values = gtsam.Values()
        values.insert(BASE.symbol, gtsam.Pose3(T))
        values.insert(SIGN_KEY.symbol, point)
        plane = gtsam.OrientedPlane3(np.array([*normal, -(normal @ point) + 0.01]))
        values.insert(WALL.symbol, plane)
        for made in (bearing_factor(camera, direction), SignOnWall(SIGN_KEY, WALL, 0.02)):
            factor = graph_of(made).at(0)
            own = jacobians(factor, values)
            for symbol, block in own.items():
                twin = derivatives_by_differences(factor, values, symbol, block.shape[1])
                assert np.allclose(block, twin, rtol=1e-4, atol=1e-3)


def test_a_sign_beside_its_wall_has_its_distance_as_residual():
    values = gtsam.Values()
    values.insert(SIGN_KEY.symbol, np.array([2.0, 0.97, 1.5]))
    values.insert(WALL.symbol, gtsam.OrientedPlane3(np.array([0.0, 1.0, 0.0, -1.0])))
    factor = graph_of(SignOnWall(SIGN_KEY, WALL, 0.02)).at(0)
    assert factor.unwhitenedError(values) == pytest.approx([-0.03])


def test_tangents_are_a_rotation_whose_last_axis_is_the_direction():
    for direction in (*np.eye(3), *-np.eye(3), np.array([0.6, 0.0, 0.8])):
        R = tangents(direction)
        assert np.allclose(R.T @ R, np.eye(3))
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert np.allclose(R[:, 2], direction)


def test_signs_are_a_registered_kind_of_landmark():
    assert landmark_class(SIGN) is SignBearing
