"""Surfaces in another program's map: where its map -> odom on /tf puts them."""

from dataclasses import replace

import numpy as np
import pytest
from fed import role_of
from mapped_room import FLOOR, HALF_TIME, TABLE, WALL, record, settings

from tccm_ros.geometry import inverse, spatial
from tccm_ros.mapping.saved_map import views_in_map
from tccm_ros.records import MapOdom, Odometry, TransformSample
from tccm_ros.replay.processors import Pipeline

T_MAP_ODOM = spatial(np.array([5.0, -3.0, 1.2]))


def records():
    return record(4 * HALF_TIME, lambda t: (FLOOR, WALL, TABLE), noise=0.002, every=3)


def mapped(T_map_odom, *, source="tf", saved=None, origin=None):
    """Return the processors that were fed with the room, and their solution."""
    config = settings(localisation={"source": source})
    pipeline = Pipeline(config, expects_odometry=True, saved=saved)
    for k, item in enumerate(records()):
        if isinstance(item, Odometry) and origin is not None:
            item = replace(item, T_odom_base=origin @ item.T_odom_base)
        pipeline.add(role_of(item), item)
        if isinstance(item, Odometry) and T_map_odom is not None and k % 5 == 1:
            sample = TransformSample(item.stamp_ns, "map", item.frame_id, T_map_odom, False)
            pipeline.add("tf", sample)
    pipeline.finish()
    return pipeline, pipeline.solve()


def table_of(solution):
    """Return the surface at the table's height."""
    (found,) = [s for s in solution.mapped.surfaces if abs(s.height - 0.7) < 0.02]
    return found


def test_a_table_is_where_the_other_program_has_it():
    _, default = mapped(None, source="slam")
    _, external = mapped(T_MAP_ODOM)
    here, there = table_of(default), table_of(external)
    expected = T_MAP_ODOM @ np.append(here.centroid, 1.0)
    assert there.centroid == pytest.approx(expected[:3], abs=0.003)
    assert there.area == pytest.approx(here.area, rel=0.05)
    assert not external.graph.walls
    assert external.grid is None


def test_odometry_that_begins_far_away_changes_nothing():
    origin = spatial(np.array([20_000.0, -7_000.0, 0.0]))
    _, external = mapped(T_MAP_ODOM @ inverse(origin), origin=origin)
    expected = table_of(mapped(T_MAP_ODOM)[1])
    assert table_of(external).centroid == pytest.approx(expected.centroid, abs=1e-4)


def test_nothing_is_mapped_before_the_first_pose():
    pipeline, waiting = mapped(None)
    assert pipeline.slam.wall_slam.waits_for_external_pose
    assert not waiting.mapped.surfaces
    assert pipeline.slam.counts["views while lost"] == 0


def test_other_transforms_are_not_taken_for_it():
    config = settings(localisation={"source": "tf"})
    robot = Pipeline(config, expects_odometry=True).robot
    robot.add("odom", Odometry(10, "odom", "base", np.eye(4)))
    for parent, child in (("map", "base"), ("world", "odom"), ("odom", "map")):
        events = robot.add("tf", TransformSample(20, parent, child, np.eye(4), False))
        assert not [event for event in events if isinstance(event, MapOdom)]


def test_by_default_map_to_odom_of_others_is_not_used():
    _, alone = mapped(None, source="slam")
    _, beside = mapped(T_MAP_ODOM, source="slam")
    assert table_of(beside).centroid.tobytes() == table_of(alone).centroid.tobytes()


def test_a_saved_map_goes_on_in_the_same_frame():
    pipeline, first = mapped(T_MAP_ODOM)
    saved = pipeline.slam.saved(first)
    _, second = mapped(T_MAP_ODOM, saved=saved)
    (before, after) = table_of(first), table_of(second)
    assert after.id == before.id
    assert after.centroid == pytest.approx(before.centroid, abs=0.005)


def test_views_of_a_map_without_keyframes_stay_as_they_are():
    pipeline, first = mapped(T_MAP_ODOM)
    saved = pipeline.slam.saved(first)
    assert views_in_map(saved) == saved.views
