"""Surfaces of solutions that go on from the one before: those of the batch, with the same ids."""

from pathlib import Path

import numpy as np
import pytest
from slam_inputs import slam_inputs

from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import SurfaceCloud
from tccm_ros.slam import wall_slam

BAG = Path(__file__).resolve().parents[2] / "bags" / "flat"
FIRST_VIEW = 4
MAX_M, MAX_RAD = 1e-3, np.radians(0.01)
"""How far a solution may be from the batch: what is asked."""


@pytest.fixture(scope="module")
def events():
    return slam_inputs(BAG)


def solutions(events):
    """Yield what goes on and the batch, after each view."""
    slam, views = SurfaceSlam(Config()), 0
    for event in events:
        slam.add(event)
        views += isinstance(event, SurfaceCloud)
        if not isinstance(event, SurfaceCloud) or views < FIRST_VIEW:
            continue
        grown = slam.solve(is_final=False)
        kept, slam.wall_slam._growth = slam.wall_slam._growth, None
        batch = slam.solve()
        slam.wall_slam._growth = kept
        yield grown, batch


def test_surfaces_have_the_ids_and_places_of_the_batch(events, monkeypatch):
    monkeypatch.setattr(wall_slam, "MIN_KEYFRAMES", 20)
    grown_solutions = 0
    for grown, batch in solutions(events):
        if grown.graph.is_batch:
            continue
        grown_solutions += 1
        poses = [np.array([k.pose for k in s.graph.keyframes]) for s in (grown, batch)]
        moved = poses[0] - poses[1]
        assert np.hypot(moved[:, 0], moved[:, 1]).max() < MAX_M
        assert np.abs(wrap_angle(moved[:, 2])).max() < MAX_RAD
        views = grown.T_map_views[:, :3, 3] - batch.T_map_views[:, :3, 3]
        assert np.linalg.norm(views, axis=1).max() < MAX_M
        assert [s.id for s in grown.surfaces] == [s.id for s in batch.surfaces]
        assert [s.label for s in grown.surfaces] == [s.label for s in batch.surfaces]
        heights = [np.array([s.height for s in one.surfaces]) for one in (grown, batch)]
        assert np.allclose(*heights, atol=MAX_M)
    assert grown_solutions >= 3
    assert len(grown.surfaces) > 10
