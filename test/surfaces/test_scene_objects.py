"""Objects and free places of a recording, on the surfaces of its map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.pipeline.run import run_bag
from tccm_ros.records import SurfaceSighting
from tccm_ros.surfaces import scene_objects as module

BAG = Path(__file__).resolve().parents[2] / "bags" / "walkthrough"


@pytest.fixture(scope="module")
def outcome():
    return run_bag(BAG, Config())


def test_planes_that_are_left_out_have_no_objects_or_free_places(outcome, monkeypatch):
    objects, free = module.scene_objects(outcome.solution, outcome.cycles)
    assert free
    monkeypatch.setattr(module, "_near_surfaces", lambda planes, *_: list(planes))
    every_object, every_free = module.scene_objects(outcome.solution, outcome.cycles)
    assert [item.id for item in objects] == [item.id for item in every_object]
    assert sorted(free) == sorted(every_free)
    for surface, rings in free.items():
        for ring, expected in zip(rings, every_free[surface], strict=True):
            np.testing.assert_array_equal(ring, expected)


def test_free_places_are_at_the_height_of_their_surface(outcome):
    _, free = module.scene_objects(outcome.solution, outcome.cycles)
    surfaces = {surface.id: surface for surface in outcome.solution.surfaces}
    for identity, rings in free.items():
        for ring in rings:
            height = ring @ surfaces[identity].normal - surfaces[identity].offset
            assert np.abs(height.mean()) < module.MAX_HEIGHT_DIFFERENCE


def test_an_earlier_session_whose_clock_was_ahead_hides_no_object(outcome):
    expected, _ = module.scene_objects(outcome.solution, outcome.cycles)
    assert expected
    ahead = SurfaceSighting(outcome.cycles[-1].stamp_ns + 10**12, 0, 500)
    surfaces = [replace(s, views=(ahead, *s.views)) for s in outcome.solution.surfaces]
    mapped = replace(outcome.solution.mapped, surfaces=tuple(surfaces))
    found, _ = module.scene_objects(replace(outcome.solution, mapped=mapped), outcome.cycles)
    assert [(o.id, o.surface) for o in found] == [(o.id, o.surface) for o in expected]
