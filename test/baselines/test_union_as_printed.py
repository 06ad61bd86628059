"""Eq. (1) as printed, against a twin in the paper's own terms and against the union."""

from hypothesis import given
from hypothesis import strategies as st
from tccm_rig import config, part_of

DEPTH = 300
"""d0 of the test rig, ticks."""

HEIGHTS = st.lists(st.integers(-40, 40).map(lambda k: 50 * k), min_size=1, max_size=12)


def cuboids(zs, mode):
    """Return the cuboids (bottom, top) of points in one cell, in their order, from below."""
    part = part_of([(0, 0, z) for z in zs], 0, config(mode=mode))
    return [tuple(bound) for bound in part.bounds.tolist()]


def by_equation_1(zs):
    """Return the cuboids (u, d) of Eq. (1), a point at a time; what overlaps is then merged.

    z_j is the top u of a cuboid: a point at or below it, down to d0 below its bottom,
    makes (u, d + u - z); one above, within d, makes (z, d + z - u).
    """
    found = []
    for z in zs:
        for k, (u, d) in enumerate(found):
            if u >= z >= u - d - DEPTH:
                found[k] = (u, d + u - z)
                break
            if z > u and u >= z - d:
                found[k] = (z, d + z - u)
                break
        else:
            found.append((z, DEPTH))
    merged = []
    for top, depth in sorted(found):
        bottom = top - depth
        while merged and merged[-1][1] >= bottom:
            bottom = min(bottom, merged.pop()[0])
        merged.append((bottom, top))
    return merged


@given(HEIGHTS)
def test_cuboids_are_those_of_equation_1_in_its_own_terms(zs):
    assert cuboids(zs, "paper") == by_equation_1(zs)


def test_a_point_inside_a_cuboid_grows_it_again_and_again_as_printed():
    """The first case of Eq. (1) against the union, which covers nothing new the second time."""
    zs = [1000, 900, 900, 900]
    assert cuboids(zs, "union") == [(600, 1000)]
    assert cuboids(zs, "paper") == [(1000 - DEPTH - 3 * 100, 1000)]


def test_a_point_above_a_grown_cuboid_is_near_as_printed():
    """The second case: nearness is by the cuboid's own depth, which the union does not know."""
    zs = [1000, 700, 1550]
    assert cuboids(zs, "union") == [(400, 1000), (1250, 1550)]
    assert cuboids(zs, "paper") == [(400, 1550)]
