"""Maps of the same rooms in other frames are matched as a new session in a saved map is."""

import json
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import between2, inverse2, planar
from tccm_ros.mapping.saved_map import SavedMap, views_in_map
from tccm_ros.report.align import find_alignment, moved_results
from tccm_ros.report.changes import wall_changes
from tccm_ros.report.compare import compare, compare_results
from tccm_ros.results.folder_reader import load_results
from tccm_ros.results.map_file import load_map

POSES = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3.14, 3.14)).map(np.array)


@pytest.fixture(scope="module")
def results(flat):
    return load_results(flat)


@pytest.fixture(scope="module")
def halves(session_files):
    """Result folders of two drives through the flat, which have six seconds in common."""
    return session_files.replayed_halves()


@pytest.fixture(scope="module")
def pose(halves):
    """The pose of the second map in the first, from the pose of the base that both have."""
    first, second = (load_results(folder).trajectory for folder in halves)
    at = first.nearest(second.stamps[:1])[0]
    assert abs(first.stamps[at] - second.stamps[0]) < 0.05
    return planar(first.T_map_base[at] @ np.linalg.inv(second.T_map_base[0]))


def test_keyframes_of_one_map_are_found_in_the_other(halves, pose):
    maps = [load_map(folder / "map.mcap") for folder in halves]
    error = between2(pose, find_alignment(*maps, Config()))
    assert np.hypot(*error[:2]) < 0.03
    assert abs(error[2]) < np.radians(0.5)


def test_without_a_level_laser_the_views_of_one_map_are_found_in_the_other(halves, pose):
    maps = [load_map(folder / "map.mcap") for folder in halves]
    maps = [SavedMap({}, views_in_map(saved)) for saved in maps]
    error = between2(pose, find_alignment(*maps, Config()))
    assert np.hypot(*error[:2]) < 0.05
    assert abs(error[2]) < np.radians(1.0)


def test_paths_of_maps_in_different_frames_are_compared_at_common_times(halves):
    laid = compare(*halves, lay_over=True)
    assert laid.path.poses > 50
    assert laid.path.rms < 0.02
    assert [wall.kind for wall in laid.walls].count("same") > 10
    assert "laid over the first: " in laid.text()


def test_removed_surfaces_are_found_between_maps_in_different_frames(halves, tmp_path):
    first, second = halves

    def went(folder):
        changes = compare(first, folder, lay_over=True).surfaces
        return {change.before.id for change in changes if change.kind == "went"}

    (counter,) = [c for c in compare(first, second, lay_over=True).surfaces
                  if c.kind == "same" and c.after.label == "counter"]  # fmt: skip
    changed = shutil.copytree(second, tmp_path / "changed")
    tree = json.loads((changed / "surfaces.json").read_text())
    tree["surfaces"] = [s for s in tree["surfaces"] if s["id"] != counter.after.id]
    (changed / "surfaces.json").write_text(json.dumps(tree))
    assert went(changed) - went(second) == {counter.before.id}


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


def test_maps_of_different_rooms_are_not_aligned(halves, session_files):
    with pytest.raises(MapError, match="expected two maps of the same rooms"):
        compare(halves[0], session_files.replayed("walkthrough"), lay_over=True)


def test_a_folder_without_a_map_is_not_aligned(halves, flat):
    with pytest.raises(MapError, match=r"no such map"):
        compare(halves[0], flat, lay_over=True)
