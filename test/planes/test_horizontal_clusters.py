"""Labels of horizontal surfaces against the true tables, and against plain 8-neighbours."""

import numpy as np
import pytest
from plane_rig import cuboid_of, part_map, room, scan, sheet, table
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.planes.horizontal_clusters import label_horizontal


def fraction_in_one_label(labels, cuboids, points):
    at = labels[cuboid_of(points, cuboids)]
    counts = np.bincount(at[at >= 0], minlength=1)
    return counts.max() / len(points), int(counts.argmax())


def labels_by_brute_force(cuboids, threshold, min_cuboids):
    x, y, u = (np.asarray(k, np.int64) for k in (cuboids.ix, cuboids.iy, cuboids.top))
    near = (abs(x[:, None] - x) <= 1) & (abs(y[:, None] - y) <= 1)
    near &= (x[:, None] != x) | (y[:, None] != y)
    near &= abs(u[:, None] - u) < threshold
    _, label = connected_components(coo_array(near), directed=False)
    names, first, size = np.unique(label, return_index=True, return_counts=True)
    result = np.full(len(x), -1)
    for index, name in enumerate(names[np.argsort(first)][size[np.argsort(first)] >= min_cuboids]):
        result[label == name] = index
    return result


@pytest.mark.parametrize("yaw", [0.0, 0.35, 0.8])
def test_a_table_seen_in_one_cycle_has_one_label(yaw):
    patches = room() + table(yaw=yaw)
    top = next(i for i, p in enumerate(patches) if p.name == "table.top")
    points, label = scan(patches, 0.0025, 1)
    cuboids = part_map(points)
    fraction, _ = fraction_in_one_label(label_horizontal(cuboids), cuboids, points[label == top])
    assert fraction >= 0.99
    broken = labels_by_brute_force(cuboids, 0.010 * TICKS_PER_M, 4)
    assert fraction_in_one_label(broken, cuboids, points[label == top])[0] < 0.6


@pytest.mark.parametrize("across", [False, True])
def test_tables_at_ten_centimetres_distance_stay_two(across):
    # The distance of scan lines is less than 5 cm up to 1 m ahead.
    if across:
        pair = table((0.4, 0.65)) + table((0.75, 0.95), name="other")
    else:
        pair = table((0.4, 0.95), (-0.6, -0.05)) + table((0.4, 0.95), (0.05, 0.6), name="other")
    points, label = scan(room() + pair, 0.002, 1)
    cuboids = part_map(points)
    labels = label_horizontal(cuboids)
    names = [p.name for p in room() + pair]
    found = [
        fraction_in_one_label(labels, cuboids, points[label == names.index(name)])
        for name in ("table.top", "other.top")
    ]
    assert found[0][1] != found[1][1]
    assert min(fraction for fraction, _ in found) > 0.97


def test_a_drawer_below_a_table_has_its_own_label():
    rng = np.random.default_rng(0)
    above = sheet(rng, 8000, (0.6, -0.5), (1.2, 0.5), offset=0.70, sigma=0.002)
    below = sheet(rng, 4000, (0.4, -0.3), (0.8, 0.3), offset=0.60, sigma=0.002)
    cuboids = part_map(np.concatenate([above, below]))
    labels = label_horizontal(cuboids)
    _, a = fraction_in_one_label(labels, cuboids, above)
    _, b = fraction_in_one_label(labels, cuboids, below)
    assert a != b


def test_labels_do_not_depend_on_unconnected_cuboids():
    rng = np.random.default_rng(0)
    first = sheet(rng, 3000, (0.5, 0.0), (1.0, 0.5), offset=0.7)
    second = sheet(rng, 3000, (2.5, 0.0), (3.0, 0.5), offset=0.7)
    both = part_map(np.concatenate([first, second]))
    labels = label_horizontal(both)
    assert sorted(set(labels.tolist())) == [0, 1]
    alone = label_horizontal(both.select(both.ix < 100))
    np.testing.assert_array_equal(alone, labels[both.ix < 100])


def test_an_empty_map_has_no_labels():
    cuboids = part_map(np.array([[1.0, 0.0, 0.5]]))
    assert len(label_horizontal(cuboids.select(np.array([False])))) == 0
    assert label_horizontal(cuboids).tolist() == [-1]
