"""Crossings of rays with planes: each is on the plane, and on the way to a lower point."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.surfaces.views.crossings import crossings
from tccm_ros.surfaces.views.views import empty_view

EYE = np.array([0.1, -0.2, 1.3])
UP = np.array([0.0, 0.0, 1.0])


def view_of(hits, eye=EYE):
    rows = np.column_stack([hits, hits[:, 2]]).astype(np.float32)
    return replace(empty_view(0, 0, Config()), hits=rows, viewpoint=eye)


@given(st.integers(0, 1000), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_each_crossing_is_on_the_plane_and_on_its_ray(seed, dx, dy):
    hits = np.random.default_rng(seed).uniform([-3, -3, 0], [3, 3, 2], (30, 3))
    normal = np.array([dx, dy, 1.0]) / np.linalg.norm([dx, dy, 1.0])
    below = hits[normal @ hits.T < 0.75 - 0.03]
    found = crossings(view_of(hits), normal, 0.75, 0.03)
    assert len(found) == len(below)
    z = (0.75 - found @ normal[:2]) / normal[2]
    way = np.column_stack([found, z]) - EYE
    ray = below.astype(np.float32) - EYE
    assert np.linalg.norm(np.cross(way, ray), axis=1) == pytest.approx(0.0, abs=1e-5)
    assert ((way * ray).sum(axis=1) <= (ray * ray).sum(axis=1)).all()


def test_a_plane_above_the_sensor_has_no_crossings():
    hits = np.array([[1.0, 0.0, 0.2]])
    assert len(crossings(view_of(hits), UP, 1.4, 0.03)) == 0
    assert len(crossings(view_of(hits, None), UP, 0.75, 0.03)) == 0
    assert len(crossings(view_of(hits), UP, 0.75, 0.03)) == 1
