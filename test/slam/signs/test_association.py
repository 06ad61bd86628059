"""Which sightings are one sign: each of text, patch and geometry alone decides."""

import numpy as np
import pytest

from tccm_ros.slam.signs.association import associate_signs, number_signs
from tccm_ros.slam.signs.sightings import Sighting, is_misread
from tccm_ros.slam.signs.triangulation import Point

MAX_DISTANCE = 0.5  # m, between sightings of one sign
MAX_MISREAD_DISTANCE = 0.2  # m, the same for different texts: the width of a plate

SIGMA = 0.02
PATCHES = np.eye(3)


def sighting(x, *, number="205", patch=0, views=(0, 1), keyframe=0):
    point = Point(np.array([x, 1.0, 1.5]), np.eye(3) * SIGMA**2)
    return Sighting(views, keyframe, point, number, 0.9, PATCHES[patch], np.zeros(3))


def certain(a, b, point):
    return np.zeros((2, 2))


def uncertain(a, b, point):
    """Half a metre, from one pass to another."""
    return np.eye(2) * (0.25 if a != b else 0.0)


def count(*sightings, relative=certain):
    return len(associate_signs(sightings, relative))


def test_geometry_decides_between_signs_of_one_text():
    """Sigma of the difference: 2 cm of each, and 2 cm of the surface, 3.5 cm in all."""
    assert count(sighting(0.0), sighting(0.1)) == 1
    assert count(sighting(0.0), sighting(0.3)) == 2
    far = sighting(0.3, keyframe=9)
    assert count(sighting(0.0), far, relative=uncertain) == 1


def test_signs_beyond_half_a_metre_are_never_associated():
    for distance, signs in ((MAX_DISTANCE - 0.01, 1), (MAX_DISTANCE + 0.01, 2)):
        pair = sighting(0.0), sighting(distance, keyframe=9)
        assert count(*pair, relative=uncertain) == signs


def test_a_text_with_another_digit_is_the_sign_only_where_it_is():
    assert count(sighting(0.0), sighting(0.02, number="206")) == 1
    for distance, signs in ((MAX_MISREAD_DISTANCE - 0.01, 1), (MAX_MISREAD_DISTANCE + 0.01, 2)):
        pair = sighting(0.0), sighting(distance, number="206", keyframe=9)
        assert count(*pair, relative=uncertain) == signs


def test_a_text_that_is_quite_different_is_another_sign_at_the_same_place():
    assert count(sighting(0.0, number="2051"), sighting(0.0, number="3162")) == 2


def test_patches_decide_where_text_and_place_are_doubtful():
    """Two digits differ, at one place: 12 of 20; another 10 for a plate that looks different."""
    assert count(sighting(0.0), sighting(0.0, number="216")) == 1
    assert count(sighting(0.0), sighting(0.0, number="216", patch=1)) == 2


def test_a_sighting_goes_to_the_sign_that_costs_less():
    """Where both are near, the text tells which."""
    one, other = sighting(0.0), sighting(0.4, number="206")
    again = sighting(0.2, number="206", keyframe=9)
    signs = associate_signs([one, other, again], uncertain)
    assert [len(sign) for sign in signs] == [1, 2]


def test_ids_of_a_saved_map_are_kept_by_the_majority_of_views():
    signs = [
        [sighting(0.0, views=(0, 1, 2))],
        [sighting(5.0, views=(3, 4))],
        [sighting(9.0, views=(5,))],
    ]
    assert number_signs(signs, [7, 7, 4, 4, 4, -1]) == [7, 4, 8]
    assert number_signs(signs, [-1] * 6) == [0, 1, 2]
    # Two signs with views of one: the one with more of them has its id.
    assert number_signs(signs, [4, 7, 7, 7, -1, -1]) == [7, 8, 9]


@pytest.mark.parametrize(
    ("text", "is_one"), [("206", True), ("05", True), ("205", True), ("316", False), ("2", False)]
)
def test_half_of_the_characters_may_be_misread(text, is_one):
    assert is_misread(text, "205") == is_one
