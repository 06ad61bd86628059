"""Objects and free places of a recording, on the surfaces of its map."""

import json
from pathlib import Path

import numpy as np
import pytest
from object_boxes import prism
from outlined_surfaces import surface
from shapely import Polygon, box

from tccm_ros.config import Config
from tccm_ros.replay.run import run_bag
from tccm_ros.surfaces.objects.object_tracks import ObjectTrack
from tccm_ros.surfaces.objects.scene_objects import free_places, scene_objects

BAG = Path(__file__).resolve().parents[3] / "bags" / "walkthrough"


@pytest.fixture(scope="module")
def solution():
    return run_bag(BAG, Config()).solution


def furniture(solution):
    """Return the surfaces but the floor and tops of objects, which have no place of 0.2 x 0.1 m."""
    return [s for s in solution.surfaces if s.label != "floor" and s.area > 0.1]


def test_objects_equal_the_truth_without_removed_ones(solution):
    truth = json.loads((BAG / "truth.json").read_text())["objects"]
    expected = sorted(tuple(np.round(entry["center"], 6)) for entry in truth)
    found = sorted(item.center.tolist() for item in solution.objects)
    assert len(found) == len(expected)
    assert np.abs(np.array(found) - expected).max() < 0.03
    (table,) = furniture(solution)
    assert {item.surface for item in solution.objects} == {table.id}


def test_free_places_lie_on_their_surface_and_on_no_object(solution):
    free = free_places(solution.surfaces, solution.objects, (0.2, 0.1))
    surfaces = {surface.id: surface for surface in solution.surfaces}
    assert free.keys() == {s.id for s in furniture(solution)}
    for identity, rings in free.items():
        surface = surfaces[identity]
        outline = Polygon(surface.boundary[:, :2]).buffer(1e-6)
        for ring in rings:
            assert np.abs(ring @ surface.normal - surface.offset).max() < 1e-9
            assert outline.contains(Polygon(ring[:, :2]))
            for item in solution.objects:
                assert Polygon(ring[:, :2]).intersection(item.footprint).area < 1e-9
            assert Polygon(ring[:, :2]).exterior.is_ccw
    assert free_places(solution.surfaces, solution.objects, (5.0, 5.0)) == {}


COUNTER = surface(box(0.0, 0.0, 2.4, 0.6), height=0.90, label="counter", number=1)
STOVE = surface(box(0.7, 0.05, 1.3, 0.55), height=0.95, label="step", number=2)
BOARD = surface(box(1.5, 0.05, 2.3, 0.55), height=1.20, label="shelf", number=3)
CRATE_TOP = surface(box(0.1, 0.1, 0.4, 0.4), height=1.10, label="other", number=4)


def track(xy, size, top, number=9):
    middle = top - 0.5 * size[2]
    return ObjectTrack(number, *prism(*xy, middle, *size, 0.0), 50, 1, 2, 2)


@pytest.mark.parametrize(
    ("xy", "size", "top", "is_object"),
    [
        ((0.70, 0.30), (0.03, 0.27, 0.05), 0.951, False),  # the stove's left side
        ((1.00, 0.05), (0.50, 0.02, 0.05), 0.944, False),  # its front
        ((0.70, 0.30), (0.03, 0.27, 0.10), 1.00, True),  # a board at it
        ((0.60, 0.30), (0.10, 0.20, 0.05), 0.95, True),  # a box as high as the stove, beside it
        ((1.60, 0.30), (0.06, 0.20, 0.28), 1.18, True),  # cereals under a board of 2 cm
        ((0.25, 0.25), (0.30, 0.30, 0.20), 1.10, True),  # a crate whose top is in the map
    ],
)
def test_a_side_of_furniture_is_no_object_on_the_surface_beside_it(xy, size, top, is_object):
    surfaces = (COUNTER, STOVE, BOARD, CRATE_TOP)
    found = [item.id for item in scene_objects(surfaces, [track(xy, size, top)])]
    assert found == ([9] if is_object else [])


FLOOR = surface(box(-2.0, -2.0, 4.0, 4.0), height=0.0, label="floor", number=0)


@pytest.mark.parametrize(
    ("xy", "size", "top", "is_object"),
    [
        ((0.05, 0.05), (0.06, 0.05, 0.45), 0.45, False),  # a leg, of which the upper part is hidden
        ((1.20, 0.02), (2.30, 0.04, 0.60), 0.60, False),  # the front
        ((1.20, 0.30), (0.30, 0.20, 0.25), 0.25, True),  # a crate below
        ((1.20, 0.90), (0.06, 0.05, 0.25), 0.25, True),  # a bottle before it
        ((0.05, 0.05), (0.06, 0.05, 0.20), 1.10, True),  # a bottle on it
    ],
)
def test_a_leg_or_front_of_furniture_is_no_object_on_the_floor(xy, size, top, is_object):
    found = scene_objects((FLOOR, COUNTER), [track(xy, size, top)])
    assert [item.id for item in found] == ([9] if is_object else [])
