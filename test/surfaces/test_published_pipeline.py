"""The published pipeline: each of its rules, from the cloud to the map."""

import numpy as np
import pytest
from room import Board, Room, Screen
from surface_maps import above_floor, build

from tccm_ros.baselines.seed_segmentation import segment
from tccm_ros.config import Config
from tccm_ros.config.reader import read_config

SEED = Config.model_validate({"surfaces": {"segmentation": "seed"}})
HERE = (0.0, 0.0, 0.0)


def test_one_parameter_selects_the_published_pipeline():
    assert read_config(None, ["surfaces.segmentation=seed"]) == SEED
    assert Config().surfaces.segmentation == "tccm"


def test_its_parameters_have_the_published_values():
    rules = SEED.surfaces
    assert (rules.cluster_distance, rules.min_points, rules.merge_distance) == (0.10, 500, 0.05)
    assert rules.min_height > 0.0


def board(count, *, x=0.0, width=0.8, tilt=0.0, z=0.7, seed=0):
    """Return points of a board that is tilted about y by an angle, rad."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(0.0, width, count)
    across = rng.uniform(-0.3, 0.3, count)
    height = z + rng.normal(0.0, 0.002, count)
    return np.c_[x + along * np.cos(tilt), across, height + along * np.sin(tilt)]


def surfaces_in(*parts):
    labels = segment(np.concatenate(parts), SEED)
    return len(np.unique(labels[labels >= 0]))


@pytest.mark.parametrize(("degrees", "found"), [(0.0, 1), (4.0, 1), (-4.0, 1), (9.0, 0), (90.0, 0)])
def test_planes_are_roughly_horizontal(degrees, found):
    assert surfaces_in(board(2000, tilt=np.radians(degrees))) == found


@pytest.mark.parametrize(("count", "found"), [(480, 0), (520, 1)])
def test_a_surface_has_500_points(count, found):
    # Beside a larger one, which is found first.
    assert surfaces_in(board(3000), board(count, x=3.0, z=0.9, seed=1)) == 1 + found


@pytest.mark.parametrize(("gap", "found"), [(0.08, 1), (0.13, 2)])
def test_points_of_one_plane_are_clustered_at_10_cm(gap, found):
    assert surfaces_in(board(4000), board(4000, x=0.8 + gap, seed=1)) == found


def test_planes_are_found_until_none_has_enough_points():
    boards = [board(3000 - 400 * k, x=2.0 * k, z=0.5 + 0.15 * k, seed=k) for k in range(6)]
    assert surfaces_in(*boards) == 6


def test_surfaces_below_the_min_height_are_not_kept():
    room = Room([Board(1.2, 0.0, 0.8, 0.8, 0.12), Board(1.5, 1.6, 0.8, 0.8, 0.74)])
    (table,) = above_floor(build([(room, HERE, 10)], config=SEED))
    assert table.height == pytest.approx(0.74, abs=1e-3)


def test_a_hob_4_cm_above_a_counter_is_merged_with_it():
    counter, hob = Board(1.4, 0.0, 0.6, 2.0, 0.90), Board(1.4, 0.4, 0.5, 0.5, 0.94)
    looks = [(Room([counter, hob]), HERE, 10)]
    assert len(above_floor(build(looks))) == 2, "ours compares heights"
    assert len(above_floor(build(looks, config=SEED))) == 1, "as published"


def test_a_box_6_cm_above_a_counter_is_its_own_surface():
    counter, box = Board(1.4, 0.0, 0.6, 2.0, 0.90), Board(1.4, 0.4, 0.5, 0.5, 0.96)
    assert len(above_floor(build([(Room([counter, box]), HERE, 10)], config=SEED))) == 2


def test_pieces_are_not_joined_over_occluded_areas():
    room = Room([Board(1.6, 0.0, 0.5, 1.6, 0.75)], [Screen(1.2, -0.09, 1.2, 0.09, 1.8)])
    assert len(above_floor(build([(room, HERE, 10)]))) == 1
    assert len(above_floor(build([(room, HERE, 10)], config=SEED))) == 2
