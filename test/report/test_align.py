"""Maps of the same rooms in other frames are aligned by the surfaces and walls of both."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.errors import MapError
from tccm_ros.geometry import between2, inverse2
from tccm_ros.report.align import find_alignment, moved_results
from tccm_ros.report.changes import wall_changes
from tccm_ros.report.compare import compare, compare_results
from tccm_ros.results.folder_reader import load_results

POSES = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3.14, 3.14)).map(np.array)


@pytest.fixture(scope="module")
def results(flat):
    return load_results(flat)


@pytest.fixture
def other(flat_copy):
    """The flat with a table that moved, two surfaces less, a wall less, and noise on the rest."""
    rng = np.random.default_rng(3)
    tree = json.loads((flat_copy / "surfaces.json").read_text())
    tree["surfaces"] = [s for s in tree["surfaces"] if s["id"] not in (4, 9)]
    for surface in tree["surfaces"]:
        shift = np.array([-0.5, 0.2, 0.0]) if surface["id"] == 8 else rng.normal(0, 0.01, 3)
        rings = [surface["boundary"], *surface["holes"], [surface["centroid"]]]
        for point in (p for ring in rings for p in ring):
            point[:] = (np.array(point) + shift * [1, 1, 0.1]).tolist()
    (flat_copy / "surfaces.json").write_text(json.dumps(tree))
    walls = json.loads((flat_copy / "walls.json").read_text())
    del walls["walls"][5]
    (flat_copy / "walls.json").write_text(json.dumps(walls))
    return flat_copy


@settings(max_examples=25, deadline=None)
@given(POSES)
def test_the_pose_of_a_moved_map_is_found(results, pose):
    found = find_alignment(results, moved_results(results, inverse2(pose)))
    assert np.allclose(between2(pose, found), 0.0, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(POSES)
def test_moving_a_map_moves_surfaces_walls_and_trajectory(results, pose):
    """The ends of moved walls are on their lines, and the inverse motion restores the map."""
    moved = moved_results(results, pose)
    for wall in moved.walls:
        normal = np.array([np.cos(wall.phi), np.sin(wall.phi)])
        assert np.allclose(wall.endpoints @ normal, wall.rho, atol=1e-9)
        assert wall.rho >= 0.0
    back = moved_results(moved, inverse2(pose))
    assert {c.kind for c in compare_results(results, back).surfaces} == {"same"}
    assert {c.kind for c in wall_changes(results.walls, back.walls)} == {"same"}
    assert np.allclose(back.trajectory.T_map_base, results.trajectory.T_map_base, atol=1e-9)


def test_changes_are_found_between_maps_in_different_frames(flat, other, results):
    pose = np.array([3.0, -1.0, 2.2])
    changed = load_results(other)
    found = find_alignment(results, moved_results(changed, inverse2(pose)))
    # Walls are exact here; a few centimetres of noise on the surfaces hardly count.
    assert np.allclose(between2(pose, found), 0.0, atol=5e-3)
    laid = compare(flat, other, lay_over=True)
    kinds = {(c.after or c.before).id: c.kind for c in laid.surfaces if c.kind != "same"}
    assert kinds == {4: "went", 8: "moved", 9: "went"}
    assert [w.kind for w in laid.walls].count("went") == 1
    assert "laid over the first: " in laid.text()


def test_maps_of_different_rooms_are_not_aligned(flat, flat_copy):
    rng = np.random.default_rng(5)
    tree = json.loads((flat_copy / "surfaces.json").read_text())
    for surface in tree["surfaces"]:
        surface["centroid"][:2] = rng.uniform(-5, 5, 2).tolist()
    (flat_copy / "surfaces.json").write_text(json.dumps(tree))
    walls = json.loads((flat_copy / "walls.json").read_text())
    for wall in walls["walls"]:
        wall["endpoints"] = rng.uniform(-5, 5, (2, 2)).tolist()
    (flat_copy / "walls.json").write_text(json.dumps(walls))
    with pytest.raises(MapError, match="maps of the same rooms"):
        compare(flat, flat_copy, lay_over=True)


def test_a_map_without_surfaces_is_not_aligned(flat, flat_copy):
    (flat_copy / "surfaces.json").write_text('{"surfaces": []}')
    with pytest.raises(MapError, match="maps of the same rooms"):
        compare(flat, flat_copy, lay_over=True)
