"""Signs that pictures should show and do not: taken away, moved, or none in the first place."""

from dataclasses import replace

import numpy as np
import plan
import pytest
from sign_plates import Pictures, Plate, office

from tccm_ros.config import Config
from tccm_ros.geometry import spatial
from tccm_ros.slam.signs.presence import (
    Looks,
    is_read_by_chance,
    is_taken_away,
    reading_probabilities,
)
from tccm_ros.slam.wall_slam import WallSlam

FALSE_PROBABILITY = 0.1  # that other text is read as a number
HEIGHTS = (14.0, 20.0, 28.0, 40.0)  # pixels, bounds of the height classes: half octaves
HIDDEN_PASS = 0.02  # probability that a sign is occluded during a pass
MAX_PRESENCE_RATIO = 0.05  # likelihood of the misses of a sign that was taken away
PRIOR_LOOKS = 4.0  # looks of the prior of a class
PRIOR_PROBABILITY = 0.5  # of a reading, by that prior

WALLS, PLATES = office()
CORRIDOR = [p for p in PLATES if p.position[1] < 0.0]
ROUTE = plan.route([(0, 0), (20, 0), (0, 0), (20, 0)], step=0.05)
STAMPS = 10**18 + np.arange(len(ROUTE)) * 100_000_000
FIRST = slice(0, len(ROUTE) // 3)
REST = slice(len(ROUTE) // 3, None)


def signs_of(measurements, *, with_pictures=True):
    """Return the signs of a drive along the corridor, there, back and there again."""
    slam = WallSlam(Config())
    for pose, stamp in zip(ROUTE, STAMPS.tolist()):
        slam.add_odometry(stamp, spatial(pose))
    for sign in measurements:
        slam.add_sign(sign)
    if with_pictures:
        for picture in Pictures([], WALLS).searched(ROUTE, STAMPS):
            slam.add_picture(picture)
    return places(slam.solve().signs)


def places(plates):
    """Return numbers with places along the corridor, m; the error of a sign rounds to the same."""
    return {(p.number, round(float(p.position[0]) - 0.1)) for p in plates}


def seen(plates, part=slice(0, None), seed=1, found=0.9):
    return Pictures(plates, WALLS, found=found).along(ROUTE[part], STAMPS[part], seed=seed)


@pytest.mark.parametrize("found", [0.9, 0.6])
def test_signs_that_are_there_stay_though_many_pictures_miss_them(found):
    assert signs_of(seen(CORRIDOR, found=found)) == places(CORRIDOR)


def test_a_sign_that_was_taken_away_goes():
    rest = [p for p in CORRIDOR if p.number != "205"]
    measurements = [*seen(CORRIDOR, FIRST), *seen(rest, REST, seed=2)]
    assert signs_of(measurements) == places(rest)
    assert signs_of(measurements, with_pictures=False) == places(CORRIDOR)


def test_a_sign_that_moved_leaves_its_old_place():
    moved = [
        replace(p, position=(10.8, *p.position[1:])) if p.number == "205" else p for p in CORRIDOR
    ]
    assert signs_of([*seen(CORRIDOR, FIRST), *seen(moved, REST, seed=2)]) == places(moved)


def test_a_sign_that_is_read_again_after_it_was_hidden_stays():
    third = slice(2 * len(ROUTE) // 3, None)
    middle = slice(len(ROUTE) // 3, 2 * len(ROUTE) // 3)
    rest = [p for p in CORRIDOR if p.number != "205"]
    measurements = [
        *seen(CORRIDOR, FIRST),
        *seen(rest, middle, seed=2),
        *seen(CORRIDOR, third, seed=3),
    ]
    assert signs_of(measurements) == places(CORRIDOR)


def test_a_row_of_a_list_that_is_read_now_and_then_is_no_sign():
    row = Plate("55", (7.0, -0.98, 1.5), np.pi / 2)
    measurements = [*seen(CORRIDOR), *seen([row], seed=3, found=1.0)[::4]]
    assert signs_of(measurements, with_pictures=False) == places([*CORRIDOR, row])
    assert signs_of(measurements) == places(CORRIDOR)


def looks(read, stamps_s=None, height_class=0):
    """Return looks at a sign, each a second after the one before."""
    n = len(read)
    stamps = np.arange(n) if stamps_s is None else np.array(stamps_s)
    return Looks(
        stamps.astype(np.int64) * 10**9,
        np.full(n, height_class, np.int64),
        np.array(read, bool),
        np.ones(n, bool),
    )


def test_the_probability_of_a_reading_is_counted_over_the_other_signs():
    known = [looks([1, 1, 0, 1, 0]), looks([0, 1, 0]), looks([1] * 30)]
    probability = reading_probabilities(known, 2)
    # Without the first reading of each pass: 4 looks with 2 readings, and 2 looks with none.
    counted = (2 + PRIOR_LOOKS * PRIOR_PROBABILITY) / (6 + PRIOR_LOOKS)
    assert probability[0] == pytest.approx(counted)
    assert probability[1:].tolist() == [PRIOR_PROBABILITY] * len(HEIGHTS)


def test_misses_after_the_last_reading_remove_a_sign():
    p = np.full(len(HEIGHTS) + 1, 0.5)
    enough = int(np.ceil(np.log(MAX_PRESENCE_RATIO) / np.log(0.5)))
    later = [0, 1, *range(100, 100 + enough)]
    assert not is_taken_away(looks([1, 1] + [0] * (enough - 1), later[:-1]), p)
    assert is_taken_away(looks([1, 1] + [0] * enough, later), p)
    # In the pass that read it, and before it.
    assert not is_taken_away(looks([1, 1] + [0] * enough), p)
    assert not is_taken_away(looks([0] * 20 + [1], [*range(20), 100]), p)


def test_misses_of_one_pass_count_no_more_than_a_sign_that_was_hidden():
    p = np.full(len(HEIGHTS) + 1, 0.9)
    reading = np.log(0.9 / FALSE_PROBABILITY)
    readings = int(np.ceil(-np.log(HIDDEN_PASS) / reading))
    stamps = [*range(readings), *range(100, 200)]
    assert not is_read_by_chance(looks([1] * readings + [0] * 100, stamps), p)
    assert is_read_by_chance(looks([1] * readings + [0] * 100), p)
