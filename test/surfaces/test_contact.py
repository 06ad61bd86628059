import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from tccm_ros.surfaces.contact import box_pairs, connect, patch_boxes


def clouds(seed, patches, most, size):
    rng = np.random.default_rng(seed)
    middles = rng.uniform(0.0, size, (patches, 3)) * [1.0, 1.0, 0.05]
    counts = rng.integers(0, most + 1, patches)
    parts = [m + rng.uniform(-0.2, 0.2, (n, 3)) * [1, 1, 0.05] for m, n in zip(middles, counts)]
    return np.concatenate(parts), np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def brute_force(points, offsets, distance):
    """Connected components by all distances, and who was taken when patches come one by one."""
    count = len(offsets) - 1
    root, taken = np.arange(count), []
    for p in range(count):
        touched = set()
        for q in range(p):
            a, b = points[offsets[q] : offsets[q + 1]], points[offsets[p] : offsets[p + 1]]
            if len(a) and len(b) and cdist(a, b, "sqeuclidean").min() <= distance**2:
                touched.add(root[q])
        if touched:
            least = min(touched)
            taken += sorted(int(t) for t in touched - {least})
            root[np.isin(root, list(touched))] = least
            root[p] = least
    return root, sorted(taken)


def fast(points, offsets, distance):
    boxes = patch_boxes(points, offsets)
    root, takers = connect(points, offsets, boxes, box_pairs(boxes, distance), distance)
    return root, sorted(takers[:, 1].tolist())


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10**6), st.integers(1, 25), st.integers(0, 30), st.sampled_from([0.5, 1.5, 4.0])
)
def test_components_equal_brute_force(seed, patches, most, size):
    points, offsets = clouds(seed, patches, most, size)
    root, taken = fast(points, offsets, 0.05)
    expected, expected_taken = brute_force(points, offsets, 0.05)
    np.testing.assert_array_equal(root, expected)
    assert taken == expected_taken


def test_the_limit_itself_touches():
    distance = 0.0625  # exact in binary, so that the squared distance is exact too
    near = np.array([[0.0, 0.0, 0.0], [distance, 0.0, 0.0]])
    far = np.array([[0.0, 0.0, 0.0], [np.nextafter(distance, 1.0), 0.0, 0.0]])
    offsets = np.array([0, 1, 2])
    assert fast(near, offsets, distance)[0].tolist() == [0, 0]
    assert fast(far, offsets, distance)[0].tolist() == [0, 1]


def test_pairs_that_may_not_merge_keep_their_patches_apart():
    points, offsets = np.zeros((3, 3)), np.array([0, 1, 2, 3])
    boxes = patch_boxes(points, offsets)
    root, takers = connect(points, offsets, boxes, np.array([[0, 2]]), 0.05)
    assert root.tolist() == [0, 1, 0]
    assert len(takers) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_no_pairs_without_patches(count):
    points, offsets = np.zeros((count, 3)), np.arange(count + 1)
    assert fast(points, offsets, 0.05)[0].tolist() == list(range(count))
