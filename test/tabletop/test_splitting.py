"""Objects that touch are parted where their heights differ; what has a neck or a slope is one."""

import numpy as np
import pytest

from tccm_ros.tabletop.splitting import split_at_gaps, split_by_height

CELL, GAP = 0.02, 0.05
rng = np.random.default_rng(5)


def parts_of(height, x=(0.0, 0.4), y=(0.0, 0.2), yaw=0.3, spacing=CELL):
    """Parts of a cluster with a height, m, over each place; -1 where there is nothing."""
    xs, ys = np.meshgrid(np.arange(*x, spacing), np.arange(*y, CELL))
    flat = np.column_stack([xs.ravel(), ys.ravel()])
    top = np.array([height(*place) for place in flat])
    flat, top = flat[top >= 0], top[top >= 0]
    c, s = np.cos(yaw), np.sin(yaw)
    mean = flat @ np.array([[c, s], [-s, c]])
    parts = split_by_height(mean, top + rng.normal(0, 0.003, len(top)), CELL, GAP)
    assert sorted(np.concatenate(parts).tolist()) == list(range(len(flat)))
    return [flat[part] for part in parts]


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2])
@pytest.mark.parametrize("spacing", [0.02, 0.04])
def test_adjacent_boxes_are_two_objects(yaw, spacing):
    parts = parts_of(lambda x, _: 0.1 if x < 0.199 else 0.2, yaw=yaw, spacing=spacing)
    assert len(parts) == 2
    low, high = sorted(parts, key=lambda part: part[:, 0].mean())
    # A turned cell on the seam may have points of both.
    assert low[:, 0].max() < 0.2 + CELL
    assert high[:, 0].min() > 0.2 - 1.5 * CELL


def test_three_boxes_of_two_heights_in_a_row_are_three():
    assert len(parts_of(lambda x, _: 0.2 if 0.14 < x < 0.27 else 0.1)) == 3


def test_boxes_of_one_height_stay_one():
    assert len(parts_of(lambda *_: 0.1)) == 1


def test_sloping_top_is_one_object():
    assert len(parts_of(lambda x, _: 0.5 * x)) == 1


def test_a_bottle_is_one_with_its_neck():
    def bottle(x, y):
        from_axis = np.hypot(x - 0.1, y - 0.1)
        return -1 if from_axis > 0.1 else 0.2 if from_axis > 0.05 else 0.3

    assert len(parts_of(bottle, x=(0.0, 0.2))) == 1


def test_a_handle_is_no_object():
    assert len(parts_of(lambda x, y: 0.1 if x < 0.3 else 0.05 if y > 0.15 else -1)) == 1


def test_an_edge_seen_lower_belongs_to_the_nearest_object():
    """The columns of a front face reach less high than the top."""
    parts = parts_of(lambda x, y: 0.05 if y < 0.01 else 0.12 if x < 0.2 else 0.25)
    assert len(parts) == 2
    assert all((part[:, 1] < 0.01).any() for part in parts)


def test_few_columns_are_one_object():
    assert len(parts_of(lambda x, _: 0.1 if x < 0.04 else 0.3, x=(0.0, 0.08), y=(0.0, 0.06))) == 1
    assert len(split_by_height(np.zeros((0, 2)), np.zeros(0), CELL, GAP)) == 1


def test_parts_around_a_surface_cover_little_of_it():
    grid = np.stack(np.meshgrid(*[np.arange(0.0, 1.0, CELL)] * 2), axis=-1).reshape(-1, 2)
    is_u = (grid[:, 0] < 0.1) | (grid[:, 0] > 0.9) | (grid[:, 1] < 0.1)
    parts = split_at_gaps(grid[is_u], grid[~is_u], CELL, 0.6)
    assert sorted(np.concatenate(parts).tolist()) == list(range(is_u.sum()))
    assert 3 <= len(parts) <= 4
    for part in parts:
        assert np.ptp(grid[is_u][part], axis=0).min() < 0.11
    assert len(split_at_gaps(grid[is_u], np.zeros((0, 2)), CELL, 0.6)) == 1, "it may be hidden"
    assert len(split_at_gaps(grid[is_u], grid[~is_u][:40], CELL, 0.6)) == 1
    assert len(split_at_gaps(grid[is_u], grid[~is_u], CELL, 1.1)) == 1
