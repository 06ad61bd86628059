"""Center cores and the published detector."""

import numpy as np
import pytest
from plane_rig import EYE, part_map, room, scan, sheet, table

from tccm_ros.baselines.center_cores import (
    CenterCores,
    center_cores,
    find_core_plane,
    find_core_planes,
    max_missed_rounds,
)
from tccm_ros.config import Config
from tccm_ros.records import PlaneKind

CONFIG = Config()


def test_center_core_is_the_long_axis_of_the_points():
    rng = np.random.default_rng(0)
    axis = np.array([0.1, -0.1, 1.0]) / np.linalg.norm([0.1, -0.1, 1.0])
    at = rng.uniform(-0.05, 0.05, 200)
    points = np.array([0.51, 0.31, 0.8]) + at[:, None] * axis
    cores = center_cores(part_map(points))
    assert len(cores) == 1
    assert cores.axis[0] @ axis == pytest.approx(1.0, abs=1e-5)
    assert cores.length[0] == pytest.approx(np.std(at), rel=1e-2)
    np.testing.assert_allclose(cores.center[0], points.mean(axis=0), atol=1e-4)
    low, high = cores.ends()[0]
    np.testing.assert_allclose(high - low, 4 * np.std(at) * axis, atol=1e-3)


def test_cuboids_of_few_points_have_no_core():
    cores = center_cores(part_map(np.array([[0.5, 0.5, 0.5], [0.505, 0.5, 0.5]])))
    assert len(cores) == 0
    assert find_core_plane(cores, CONFIG) is None


@pytest.mark.parametrize("trials", [10, 50])
def test_the_plane_of_a_table_without_noise_is_found(trials):
    points, _ = scan(table(), 0.0, 0)
    points = points[points[:, 0] > 0.52]
    plane = find_core_plane(center_cores(part_map(points)), CONFIG, trials, seed=1)
    assert plane is not None
    assert abs(plane.normal[2]) == pytest.approx(1.0, abs=1e-6)
    assert abs(plane.offset) == pytest.approx(0.7, abs=1e-4)
    assert plane.quality > 0.15


def test_quality_is_that_of_equation_8():
    rng = np.random.default_rng(2)
    points = sheet(rng, 20_000, (0.4, -0.4), (1.2, 0.4), (0.3, 0.1, 1.0), 0.8)
    cuboids = part_map(points)
    plane = find_core_plane(center_cores(cuboids), CONFIG, 50, seed=0)
    values = np.linalg.eigvalsh(np.cov(points.T))
    # All cores belong, and no noise: l3 is at its floor of 0.1 mm quantisation.
    assert len(plane.cores) > 0.99 * len(cuboids)
    assert plane.quality == pytest.approx(values[2] * values[1] / 1e-9, rel=0.15)


def test_val_uses_the_spread_of_the_cores_and_each_eigenvalue_once():
    """Eq. (8) in NumPy over many points of each core: l1 l2 / l3, no square of any of them."""
    cores = joined(level_cores(60, 0.70, 11), level_cores(60, 0.71, 12))
    lengths = np.random.default_rng(13).uniform(0.05, 0.3, len(cores))
    cores = CenterCores(cores.cuboid, cores.center, cores.axis, lengths)
    plane = find_core_plane(cores, CONFIG, 50, seed=0)
    used = cores.select(plane.cores)
    assert len(used) > 30
    # Two points a standard deviation to either side have the covariance of a core.
    ends = np.concatenate([used.center + s * used.length[:, None] * used.axis for s in (-1, 1)])
    l3, l2, l1 = np.linalg.eigvalsh(np.cov(ends.T, bias=True))
    assert plane.quality == pytest.approx(l1 * l2 / l3, rel=1e-6)


def test_the_normal_is_the_mean_of_all_pairs():
    """Eq. (6) and the average after (7), for three cores that are not quite in one plane."""
    rng = np.random.default_rng(14)
    found = 0
    for seed in range(60):
        center = np.array([[0.5, -0.3, 0.7], [1.1, 0.0, 0.7], [0.6, 0.5, 0.7]])
        center[:, 2] += rng.normal(0.0, 0.01, 3)
        yaw = rng.uniform(0.0, np.pi, 3)
        cores = cores_of(center, np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(3)]))
        plane = find_core_plane(cores, settings(min_quality=0.0), 1, seed=seed)
        drawn = (np.random.default_rng(seed).random(3) * 3).astype(int)
        if plane is None or len(set(drawn)) < 3:
            continue
        b = [np.cross(cores.axis[j], center[i] - center[j]) for i in drawn for j in drawn if i != j]
        b = np.array([n / np.linalg.norm(n) for n in b])
        mean = (b * np.sign(b @ b[0])[:, None]).mean(axis=0)
        np.testing.assert_allclose(plane.normal, mean / np.linalg.norm(mean), atol=1e-12)
        found += 1
    assert found > 5


def test_the_same_seed_gives_the_same_plane():
    points, _ = scan(room() + table(), 0.0025, 0)
    cores = center_cores(part_map(points))
    a, b = (find_core_plane(cores, CONFIG, seed=3) for _ in range(2))
    assert a.normal.tobytes() == b.normal.tobytes()
    np.testing.assert_array_equal(a.cores, b.cores)


# -- the rules of IV.B and IV.C, one by one ------------------------------------------------------


def cores_of(center, axis, length=0.05):
    """Return cores with given centers (K, 3), axes (3,) or (K, 3) and lengths."""
    center = np.atleast_2d(np.asarray(center, float))
    axis = np.broadcast_to(np.asarray(axis, float), center.shape)
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    lengths = np.broadcast_to(np.asarray(length, float), len(center)).copy()
    return CenterCores(np.arange(len(center)), center, np.ascontiguousarray(axis), lengths)


def joined(*parts):
    """Return the cores of all parts."""
    fields = ("center", "axis", "length")
    arrays = [np.concatenate([getattr(part, name) for part in parts]) for name in fields]
    return CenterCores(np.arange(len(arrays[0])), *arrays)


def level_cores(count, z, seed, low=(0.4, -0.5), high=(1.4, 0.5)):
    """Return horizontal cores in all directions, spread over a rectangle at one height."""
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(0.0, np.pi, count)
    center = np.column_stack([rng.uniform(low, high, (count, 2)), np.full(count, z)])
    return cores_of(center, np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(count)]))


def settings(**values):
    return Config.model_validate({"center_core": values})


def test_cores_that_are_in_no_common_plane_give_none():
    """Eq. (7): cores of two boards at a distance of 20 cm span a tilted plane only by mistake."""
    boards = joined(level_cores(60, 0.6, 0), level_cores(60, 0.8, 1))
    config = settings(angle_threshold=0.1, min_quality=1e-6)
    found = [find_core_plane(boards, config, trials=1, seed=seed) for seed in range(300)]
    planes = [plane for plane in found if plane is not None]
    # Three of a board are drawn in one trial of four.
    assert 30 < len(planes) < 150
    assert max(np.hypot(*plane.normal[:2]) for plane in planes) < 0.1


def test_cores_across_a_plane_do_not_belong_to_it():
    """The angular threshold: legs that stand in the height of a board."""
    board = level_cores(60, 0.7, 2)
    legs = cores_of(level_cores(20, 0.7, 3).center, (0.2, 0.0, 1.0))
    plane = find_core_plane(joined(board, legs), CONFIG, seed=0)
    np.testing.assert_array_equal(plane.cores, np.arange(60))


def test_cores_beside_a_plane_do_not_belong_to_it():
    """The distance threshold: a smaller board 3 cm higher; the threshold is 2 cm."""
    board, step = level_cores(60, 0.70, 4), level_cores(12, 0.73, 5, high=(0.6, -0.3))
    plane = find_core_plane(joined(board, step), CONFIG, seed=0)
    np.testing.assert_array_equal(plane.cores, np.arange(60))


def test_the_offset_is_that_of_the_longest_core():
    """IV.C: d follows from the longest core, not from another one or a mean."""
    around = np.arange(8) * np.pi / 4
    heights = 0.7 + np.random.default_rng(6).uniform(-0.005, 0.005, 8)
    center = np.column_stack([0.5 * np.cos(around), 0.5 * np.sin(around), heights])
    axis = np.column_stack([-np.sin(around), np.cos(around), np.zeros(8)])
    cores = cores_of(center, axis, 0.02 + 0.01 * np.arange(8))
    config = settings(cores=8, angle_threshold=0.2)
    planes = [find_core_plane(cores, config, trials=1, seed=seed) for seed in range(60)]
    in_plane = np.array([np.abs(center @ p.normal - p.offset) < 1e-12 for p in planes])
    # Eight draws of eight leave the longest out in one trial of three; then it is the next.
    assert np.all(in_plane.any(axis=1))
    assert in_plane.mean(axis=0)[7] > 0.5
    assert in_plane.mean(axis=0)[:5].max() < 0.1


def test_the_best_trial_is_kept():
    """Eq. (8) chooses: a table has a larger val than a stool, whatever was drawn last."""
    cores = joined(
        level_cores(40, 0.7, 7), level_cores(40, 0.4, 8, low=(0.4, 0.8), high=(0.7, 1.1))
    )
    for seed in range(20):
        plane = find_core_plane(cores, CONFIG, trials=50, seed=seed)
        assert abs(plane.offset) == pytest.approx(0.7, abs=1e-9)


def test_more_trials_never_give_a_smaller_val():
    points, _ = scan(room() + table(), 0.0025, 0)
    cores = center_cores(part_map(points), 0.004)
    planes = [[find_core_plane(cores, CONFIG, n, seed) for n in (10, 50)] for seed in range(12)]
    vals = np.array([[plane.quality if plane else 0.0 for plane in pair] for pair in planes])
    assert np.all(vals[:, 1] >= vals[:, 0])
    assert np.any(vals[:, 1] > vals[:, 0])


# -- all planes of a map -------------------------------------------------------------------------


def slabs(*sheets):
    """Return a map of sheets with some noise, in cells of 40 mm, as the paper's coarsest."""
    rng = np.random.default_rng(9)
    points = np.concatenate([sheet(rng, *args, sigma=0.001) for args in sheets])
    return part_map(points, cell=0.04)


TABLE_TOP = (12_000, (0.4, -0.4), (1.0, 0.4), (0, 0, 1), 0.7)
SLOPE = (8_000, (1.2, -0.4), (1.6, 0.4), (-0.5, 0, 1), 0.2)


def test_all_planes_are_found_the_one_with_the_largest_support_first():
    fits = find_core_planes(slabs(TABLE_TOP, SLOPE), CONFIG, EYE)
    assert [fit.kind for fit in fits[:2]] == [PlaneKind.HORIZONTAL, PlaneKind.ANY]
    assert fits[0].normal @ [0, 0, 1] > 0.99
    assert fits[0].offset == pytest.approx(0.7, abs=0.01)
    up = np.array([-0.5, 0, 1]) / np.sqrt(1.25)
    assert abs(fits[1].normal @ up) > 0.99
    assert fits[1].normal @ EYE > fits[1].offset, "towards the laser"
    assert fits[0].support >= fits[1].support
    assert fits[0].rms < 0.006
    assert fits[0].area == pytest.approx(0.6 * 0.8, rel=0.1)


def test_rounds_without_a_plane_do_not_end_the_search():
    """One trial a round: three cores of the table are drawn in one round of some twenty."""
    clutter = np.random.default_rng(3).uniform((0.4, -0.4, 0.0), (1.6, 0.4, 0.6), (4000, 3))
    points = sheet(np.random.default_rng(4), *TABLE_TOP, sigma=0.001)
    cuboids = part_map(np.concatenate([points, clutter]), cell=0.04)
    config = Config.model_validate({"center_core": {"trials": 1, "min_quality": 100.0}})
    assert find_core_plane(center_cores(cuboids), config, seed=0) is None
    fits = find_core_planes(cuboids, config, EYE)
    assert fits[0].kind == PlaneKind.HORIZONTAL
    assert fits[0].offset == pytest.approx(0.7, abs=0.01)


def test_the_search_ends_when_a_plane_of_a_tenth_would_have_been_drawn():
    """ln(0.01) / ln(1 - 0.1^3) = 4603 trials, in rounds of 50."""
    assert max_missed_rounds(CONFIG) == 93
    assert max_missed_rounds(settings(cores=2, trials=10)) == 46


def test_tables_of_one_height_are_two_planes_by_their_cells():
    """The clustering of IV.C: a gap of 30 cm, more than the distance of cores of one surface."""
    pair = (TABLE_TOP, (12_000, (0.4, 0.7), (1.0, 1.5), (0, 0, 1), 0.7))
    cuboids = slabs(*pair)
    assert len(find_core_planes(cuboids, CONFIG, EYE)) == 2
    assert len(find_core_planes(cuboids, settings(cluster_distance=0.4), EYE)) == 1


def test_a_cuboid_is_in_one_plane_or_none():
    fits = find_core_planes(slabs(TABLE_TOP, SLOPE), CONFIG, EYE)
    members = np.concatenate([fit.members for fit in fits])
    assert len(np.unique(members)) == len(members)
    np.testing.assert_array_equal(np.sort(members), np.flatnonzero(fits.labels >= 0))


def test_short_cores_are_left_out():
    cores = center_cores(slabs(TABLE_TOP))
    longer = center_cores(slabs(TABLE_TOP), 0.012)
    assert 0 < len(longer) < len(cores)
    assert longer.length.min() > 0.012
    np.testing.assert_array_equal(longer.cuboid, cores.cuboid[cores.length > 0.012])
