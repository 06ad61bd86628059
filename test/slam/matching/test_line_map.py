"""Maps of points with normals, held against a test of all pairs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.slam.matching.buckets import Buckets, sort_into_buckets
from tccm_ros.slam.matching.line_map import _confirmed, _Seen, _thin

ACROSS = 0.04  # m across a surface
ALIKE = 0.9  # cosine between normals of one surface
ALONG = 0.15  # m along a surface
BORDER = 1.5  # buckets around the points
BUCKET = 0.30  # m, edge of a bucket
SAME_SIDE = 0.5  # cosine between normals of one side
SPACING = 0.05  # m between points of the map with one orientation

SEEDS = st.integers(0, 2**32 - 1)


def random_points(seed, count=160):
    """Return points with normals, some without, that three scans saw around two walls."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-1.5, 1.5, count)
    is_side = rng.random(count) < 0.5
    points = np.where(
        is_side[:, None], np.column_stack([at, 0 * at]), np.column_stack([0 * at, at])
    )
    yaw = np.where(is_side, np.pi / 2, 0.0) + np.pi * (rng.random(count) < 0.2)
    yaw += rng.normal(0.0, 0.3, count)
    normals = np.column_stack([np.cos(yaw), np.sin(yaw)])
    normals[rng.random(count) < 0.2] = 0.0
    points += rng.normal(0.0, 0.5 * ACROSS, (count, 2)) + rng.uniform(-5.0, 5.0, 2)
    return _Seen(points, normals, rng.integers(0, 3, count))


def area_of(points):
    origin = points.min(axis=0) - BORDER * BUCKET
    return origin, ((points.max(axis=0) - origin) / BUCKET).astype(np.int64) + 3


@given(SEEDS)
def test_a_point_is_left_out_where_an_earlier_one_on_its_side_is_near(seed):
    seen = random_points(seed)
    owner = _thin(seen.points, seen.normals, *area_of(seen.points))
    stays = []
    for i, (point, normal) in enumerate(zip(seen.points, seen.normals)):
        near = [
            j
            for j in stays
            if np.hypot(*(seen.points[j] - point)) < SPACING
            and (seen.normals[j] @ normal > SAME_SIDE or not normal.any())
        ]
        if near:
            assert owner[i] in near
        else:
            assert owner[i] == i
            stays.append(i)
    assert 0 < len(stays) < len(owner)


@given(SEEDS)
def test_point_is_confirmed_by_another_scan_of_its_surface(seed):
    seen = random_points(seed)
    chosen = np.random.default_rng(seed).permutation(len(seen.points))[:80]
    points, normals, scan = (field[chosen] for field in seen)
    origin, shape = area_of(seen.points)
    order, starts = sort_into_buckets(points, origin, shape)
    mapped = _Seen(points[order], normals[order], scan[order])
    offset = mapped.points[:, None] - seen.points
    distance = np.hypot(offset[..., 0], offset[..., 1])
    away = np.abs(np.sum(offset * seen.normals, axis=2))
    alike = mapped.normals @ seen.normals.T > ALIKE
    same = np.where(alike, (distance < ALONG) & (away < ACROSS), distance < ACROSS)
    expected = np.any(same & (mapped.scan[:, None] != seen.scan), axis=1)
    found = _confirmed(mapped, Buckets(origin, starts), seen)
    assert found.tolist() == expected.tolist()
    assert expected.sum() > 0
