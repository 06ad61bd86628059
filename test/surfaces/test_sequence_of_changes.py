"""Two simulated rooms that change: each true event is told once, with its id, and no other."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from changing_rooms import (
    WORLD,
    assert_one_id_an_item,
    counted,
    index_at,
    is_at,
    reported,
    solved,
    true_counts,
    true_presence,
)
from slam_inputs import slam_inputs

from tccm_ros.config import Config
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.scene.changes import MapChanges
from tccm_ros.scene.live_objects import LiveObjects
from tccm_ros.scene.planning_shapes import scene_shapes
from tccm_ros.scene.published_scene import PublishedScene
from tccm_ros.scene.scene import Scene
from tccm_ros.scene.session_changes import scene_of
from tccm_ros.slam.tracking import Tracker

OBJECTS_S = 50.0, 90.0
"""The robot looks at the objects of the first room for the second time, and has left it."""

LIVE_M = 0.01
"""Maximum error of the live pose before a view is in the graph, m."""

RESTART_S = 75.0
"""The robot has seen the first changes of the first room, and is on its way to the second."""


@pytest.fixture(scope="module", params=[1, 2])
def inputs(request, session_files):
    return slam_inputs(session_files.simulated(WORLD, seed=request.param))


class Session(NamedTuple):
    """The scenes after each tilt cycle, before a map is saved and after that, and the saved map."""

    before: list[Scene]
    after: list[Scene]
    saved: Path


@pytest.fixture(scope="module")
def session(inputs, tmp_path_factory):
    half, slam = index_at(inputs, RESTART_S), SurfaceSlam(Config())
    before = list(solved(inputs[:half], slam))
    solution, saved = slam.solve(), tmp_path_factory.mktemp("saved") / "map.mcap"
    save_map(saved, slam.saved(solution), solution, "map")
    return Session(before, list(solved(inputs[half:], slam)), saved)


@pytest.fixture
def scenes(session):
    """The scenes after each tilt cycle."""
    return [*session.before, *session.after]


def test_every_true_event_is_reported_once_and_no_other(scenes):
    found = reported(scenes, MapChanges())
    assert counted(found) == true_counts()
    assert_one_id_an_item(found)


def test_events_after_save_restart_and_load_are_the_same(inputs, session):
    found = reported(session.before, MapChanges())
    loaded = SurfaceSlam.from_saved(Config(), load_map(session.saved))
    changes = MapChanges(is_map_loaded=True)
    assert changes.note(scene_of(loaded.solve(), "map"), loaded.config.objects.agreeing_views) == []
    found += reported(solved(inputs[index_at(inputs, RESTART_S) :], loaded), changes)
    assert counted(found) == true_counts()
    assert_one_id_an_item(found)


def test_objects_between_solutions_are_where_the_next_solution_has_them(inputs):
    slam, tracker, live = SurfaceSlam(Config()), Tracker(Config()), LiveObjects(Config())
    first, end = (index_at(inputs, seconds) for seconds in OBJECTS_S)
    moved = []
    for i, event in enumerate(inputs[:end]):
        slam.add(event)
        if not tracker.takes(event):
            continue
        tracker.add(event)
        if isinstance(event, (SurfaceCloud, ViewIntervals, ObjectBoxes)):
            live.add(event)
        else:
            pose = tracker.current_pose()
            live.add_pose(pose.stamp_ns, pose.pose)
        if i >= first and isinstance(event, ObjectBoxes):
            scene, solution = live.scene(), slam.solve(with_racks=False)
            known = {} if scene is None else {item.id: item.center for item in scene.objects}
            moved += [o.center - known[o.id] for o in solution.objects if o.id in known]
            live.correct(tracker.take(slam.solved_map(solution)))
            live.take(scene_of(solution, "map"))
    assert len(moved) > 5
    assert np.abs(moved).max() < LIVE_M


def test_planning_scene_of_a_listener_follows_all_changes(scenes):
    """It knows the diffs alone; the second tilt cycle that looks at a change has corrected it."""
    scene, world, worlds = PublishedScene(), {}, {}
    for solution in scenes:
        surfaces = [known.surface for known in solution.surfaces]
        diff = scene.update(scene_shapes(surfaces, solution.objects, solution.compartments)).diff
        assert set(diff.remove) <= world.keys() >= diff.move.keys()
        world = {k: s for k, s in world.items() if k not in diff.remove} | diff.add | diff.move
        worlds[solution.stamp_ns] = world
    expected = list(true_presence(list(worlds)))
    assert len(expected) == 13
    for item in expected:
        assert is_at(item.place, worlds[item.stamp_ns]) == item.is_present, item
