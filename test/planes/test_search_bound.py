"""The work of the search for planes is proportional to the cuboids of a map, whatever is in it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_rig import EYE, part_map

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICKS_PER_M, CuboidArrays
from tccm_ros.planes import find_planes, search
from tccm_ros.planes.arrays import plane_map
from tccm_ros.planes.blocks import find_patches, sort_into_blocks
from tccm_ros.planes.inliers import Flood
from tccm_ros.planes.region_growing import grow_regions

MAX_VISITS = 200  # searches that examine a cuboid, on average, at most
PATCH_POINTS = 6  # points of a flat patch: three define a plane, three test it

P = Config().planes
LIMITS = search.PlaneLimits(P.max_rms, float(P.min_points), P.min_area, P.flatness, 0.99)


def searched(cuboids, visits=0):
    """Return the planes of a map, and how many cuboids the searches examined; by `segment`."""
    arrays, caps = CuboidArrays(*cuboids.arrays), cuboids.caps
    map_ = plane_map(arrays, caps.of, caps.moments, np.rint(EYE * TICKS_PER_M))
    n = len(cuboids)
    blocks = sort_into_blocks(map_.ix, map_.iy)
    moments, patches, place = find_patches(map_, blocks, LIMITS.max_rms, PATCH_POINTS)
    region, pooled = grow_regions(moments, patches, place, blocks, LIMITS.max_rms)
    count = blocks.rows * blocks.wide
    flood = Flood(
        np.empty(count, np.int32),
        np.full(count, -1, np.int32),
        np.zeros((n >> 6) + 1, np.uint64),
        np.array([visits]),
    )
    planes = search.planes_of_regions(
        map_, blocks, region, pooled, place, flood, LIMITS, np.full(n, -1, np.int32)
    )
    return planes, int(flood.visits[0])


def sheets(rng, count, size, slope, radius):
    """Return points of small sheets anywhere in a volume: (N, 3)."""
    centres = rng.uniform([-size, -size, 0.0], [size, size, 2.5], (count, 3))
    tilts = rng.normal(0.0, slope, (count, 2))
    uv = rng.uniform(-radius, radius, (count, 20, 2))
    heights = np.einsum("kni,ki->kn", uv, tilts)
    return (centres[:, None, :] + np.dstack([uv, heights])).reshape(-1, 3)


def beams_in_degrees(rng, count):
    """Return points of a scan whose increment is taken for rad: in all directions at random."""
    bearing, tilt = rng.uniform(-3000.0, 3000.0, count), rng.uniform(-0.6, 0.9, count)
    away = np.minimum(3.0 / np.abs(np.cos(bearing % 1.0) + 0.01), 10.0)
    ahead = away * np.cos(bearing)
    return np.c_[ahead * np.cos(tilt), away * np.sin(bearing), 1.5 - ahead * np.sin(tilt)]


@settings(deadline=None, max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 30, 1000, 3000]),
    st.floats(0.05, 3.0),
    st.floats(0.0, 3.0),
    st.floats(0.01, 1.0),
    st.booleans(),
)
def test_each_cuboid_of_any_map_is_examined_a_bounded_number_of_times(
    seed, count, size, slope, radius, is_noise
):
    rng = np.random.default_rng(seed)
    points = sheets(rng, count, size, slope, radius)
    if is_noise:
        points = np.vstack([points, beams_in_degrees(rng, 2000)])
    cuboids = part_map(points)
    planes, visits = searched(cuboids)
    assert visits <= (MAX_VISITS + 1) * len(cuboids)
    assert len(planes) <= len(cuboids)


def test_no_further_region_is_searched_once_the_visits_are_used_up():
    rng = np.random.default_rng(0)
    cuboids = part_map(sheets(rng, 3000, 1.0, 0.05, 0.15))
    planes, _ = searched(cuboids)
    assert len(planes) > 3
    used_up = MAX_VISITS * len(cuboids) + 1
    planes, visits = searched(cuboids, used_up)
    assert (len(planes), visits) == (0, used_up)


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_the_planes_of_the_pieces_are_those_of_the_search(size):
    cuboids = part_map(sheets(np.random.default_rng(1), 500, size, 0.05, 0.3))
    fits = find_planes(cuboids, Config(), EYE)
    planes, visits = searched(cuboids)
    assert len(cuboids) <= visits
    assert len(fits) <= len(planes)
