"""Objects and free places of a recording, on the surfaces of its map."""

import json
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.pipeline.run import run_bag
from tccm_ros.surfaces.scene_objects import free_places

BAG = Path(__file__).resolve().parents[2] / "bags" / "walkthrough"


@pytest.fixture(scope="module")
def solution():
    return run_bag(BAG, Config()).solution


def test_the_objects_are_those_of_the_truth_and_what_left_is_gone(solution):
    truth = json.loads((BAG / "truth.json").read_text())["objects"]
    expected = sorted(tuple(np.round(entry["center"], 6)) for entry in truth)
    found = sorted(item.center.tolist() for item in solution.objects)
    assert len(found) == len(expected)
    assert np.abs(np.array(found) - expected).max() < 0.03
    (table,) = (s for s in solution.surfaces if s.label != "floor")
    assert {item.surface for item in solution.objects} == {table.id}


def test_free_places_lie_on_their_surface_and_on_no_object(solution):
    free = free_places(solution.surfaces, solution.objects, (0.2, 0.1))
    surfaces = {surface.id: surface for surface in solution.surfaces}
    assert free.keys() == {s.id for s in solution.surfaces if s.label != "floor"}
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
