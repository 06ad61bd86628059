"""Contact of patches against a brute-force search over all points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from tccm_ros.surfaces.merging.contact import connect, near_pairs
from tccm_ros.surfaces.merging.patch_planes import PatchPlanes, pose_jacobian

FLATNESS = 0.0013  # m, of a surface: a third of the 4 mm under 1 m that DIN 18202 allows
GATE = 3.0  # sigmas: 99.7 % of all measurements

STEP = 0.03


def clouds(seed, patches, max_points, size):
    rng = np.random.default_rng(seed)
    middles = rng.uniform(0.0, size, (patches, 3)) * [1.0, 1.0, 0.05]
    counts = rng.integers(0, max_points + 1, patches)
    parts = [m + rng.uniform(-0.2, 0.2, (n, 3)) * [1, 1, 0.05] for m, n in zip(middles, counts)]
    return parts


def planes_of(clouds, seed=None):
    """Return planes of patches: horizontal and unknown, or tilted at random."""
    count = len(clouds)
    if seed is None:
        cov = np.tile(np.eye(3), (count, 1, 1))
        return PatchPlanes(
            np.arange(count), np.zeros((count, 3)), np.zeros((count, 2)), cov, 0.0 * cov, cov
        )
    rng = np.random.default_rng(seed)
    middles = [part.mean(axis=0) if len(part) else np.zeros(3) for part in clouds]
    tilt = np.diag(np.square([0.005, 0.005, 0.005]))
    return PatchPlanes(
        rng.integers(0, 3, count),
        np.array(middles),
        rng.normal(0.0, 0.05, (count, 2)),
        np.eye(3) * rng.uniform(0.001, 0.005, (count, 1, 1)) ** 2,
        rng.normal(0.0, 0.002, (count, 3, 2)),
        np.stack([J @ tilt @ J.T for J in (pose_jacobian(np.eye(4), m) for m in middles)]),
    )


def have_common_height(a, b, meeting, planes, q, p):
    """Return whether two patches have one height where they meet, point by point."""
    zones = (a[meeting.any(axis=1)], b[meeting.any(axis=0)])
    middle = np.concatenate(zones)[:, :2].mean(axis=0)
    heights, shared, variance = [], [], 2 * FLATNESS**2
    for k, zone in ((q, zones[0]), (p, zones[1])):
        z0, slope = planes.centroid[k], planes.slope[k]
        residuals = [z - (z0[2] + slope @ (np.array([x, y]) - z0[:2])) for x, y, z in zone]
        heights.append(z0[2] + slope @ (middle - z0[:2]) + np.mean(residuals))
        J = np.r_[1.0, middle - z0[:2]]
        variance += J @ planes.cov_fit[k] @ J
        shared.append(J @ planes.systematic[k])
        if planes.view_index[q] != planes.view_index[p]:
            variance += J @ planes.cov_pose[k] @ J
    if planes.view_index[q] == planes.view_index[p]:
        variance += np.sum((shared[0] - shared[1]) ** 2)
    else:
        variance += np.sum(np.square(shared))
    return abs(heights[0] - heights[1]) <= min(GATE * np.sqrt(variance), STEP)


def connect_by_brute_force(clouds, distance, planes=None):
    """Return connected components from all distances, patch by patch."""
    count = len(clouds)
    root = np.arange(count)
    pairs = set(map(tuple, near_pairs(clouds, distance).tolist()))
    for p in range(count):
        met = set()
        for q in range(p):
            a, b = clouds[q], clouds[p]
            meeting = cdist(a[:, :2], b[:, :2], "sqeuclidean") <= distance**2
            if not meeting.any() or (q, p) not in pairs:
                continue
            if planes is None or have_common_height(a, b, meeting, planes, q, p):
                met.add(root[q])
        if met:
            first = min(met)
            root[np.isin(root, list(met))] = first
            root[p] = first
    return root


def connected(clouds, distance, planes=None, step=np.inf):
    return connect(clouds, planes_of(clouds) if planes is None else planes, distance, step)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10**6), st.integers(1, 25), st.integers(0, 30), st.sampled_from([0.5, 1.5, 4.0])
)
def test_components_equal_those_by_brute_force(seed, patches, max_points, size):
    some = clouds(seed, patches, max_points, size)
    np.testing.assert_array_equal(connected(some, 0.05), connect_by_brute_force(some, 0.05))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 25), st.integers(1, 30), st.sampled_from([0.5, 1.5]))
def test_components_of_patches_with_heights_equal_those_by_brute_force(
    seed, patches, max_points, size
):
    some = clouds(seed, patches, max_points, size)
    planes = planes_of(some, seed)
    root = connected(some, 0.05, planes, STEP)
    np.testing.assert_array_equal(root, connect_by_brute_force(some, 0.05, planes))


def test_points_at_exactly_the_distance_meet():
    distance = 0.0625  # exact in binary, so that the squared distance is exact too
    near = np.array([[0.0, 0.0, 0.0], [distance, 0.0, 0.0]])
    far = np.array([[0.0, 0.0, 0.0], [np.nextafter(distance, 1.0), 0.0, 0.0]])
    assert connected(np.split(near, 2), distance).tolist() == [0, 0]
    assert connected(np.split(far, 2), distance).tolist() == [0, 1]


def test_near_pairs_have_boxes_within_the_distance_along_all_axes():
    rng = np.random.default_rng(3)
    low = rng.uniform(0.0, 1.0, (40, 3))
    some = [np.stack([a, a + size]) for a, size in zip(low, rng.uniform(0.0, 0.3, (40, 3)))]
    some[7] = np.zeros((0, 3))
    full = [k for k in range(40) if k != 7]

    def gap(q, p):
        (low_q, high_q), (low_p, high_p) = some[q], some[p]
        return np.maximum(low_q - high_p, low_p - high_q).max()

    expected = [(q, p) for p in full for q in full if q < p and gap(q, p) <= 0.05]
    assert len(expected) > 20
    np.testing.assert_array_equal(near_pairs(some, 0.05), expected)


@pytest.mark.parametrize("count", [0, 1])
def test_a_single_patch_or_none_has_no_pairs(count):
    assert connected([np.zeros((1, 3))] * count, 0.05).tolist() == list(range(count))
