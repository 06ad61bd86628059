"""Cuboids as arrays: chosen ones keep all that is known of them."""

import numpy as np
from tccm_rig import config, filled, part_of


def test_selected_cuboids_keep_their_moments_and_cycles():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.integers(-900, 900, (2, 800)).T, rng.integers(0, 4000, 800)])
    cuboids = filled(config(), [part_of(p, k, config()) for k, p in enumerate((points, points))])
    cuboids = cuboids.cuboids()
    chosen = rng.random(len(cuboids)) < 0.5
    some = cuboids.select(chosen)
    for name in ("ix", "iy", "bottom", "top", "count", "s", "S"):
        np.testing.assert_array_equal(getattr(some, name), getattr(cuboids, name)[chosen])
    offsets = cuboids.cycle_offsets
    rows = [cuboids.cycles[offsets[k] : offsets[k + 1]].tolist() for k in np.flatnonzero(chosen)]
    own = some.cycle_offsets
    assert [some.cycles[own[k] : own[k + 1]].tolist() for k in range(len(some))] == rows
    assert len(cuboids.select(np.zeros(len(cuboids), bool))) == 0


def test_the_covariance_is_that_of_equation_2():
    """P = S / N - p p^T: divided by N, not N - 1, for cuboids of two points and of two thousand."""
    rng = np.random.default_rng(1)
    few, many = rng.integers(0, 200, (2, 3)), rng.integers(0, 200, (2000, 3))
    for points in (few, many):
        cuboids = filled(config(), [part_of(points, 0, config())]).cuboids()
        assert len(cuboids) == 1
        expected = np.cov(points.T * 1e-4, bias=True)[np.triu_indices(3)]
        np.testing.assert_allclose(cuboids.cov()[0], expected, atol=1e-12)
