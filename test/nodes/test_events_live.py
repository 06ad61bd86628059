"""Simulated rooms that change, played to live nodes: ~/events says what is true, and no more."""

import os

import pytest
from asker import Asker
from bag_player import play_bag
from changing_rooms import WORLD, assert_one_id_an_item, counted, true_counts
from live_robot import Listener, end_input, slam, tccm, wait_until_done

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.records.building import pose_matrix
from tccm_ros.ros.surface_messages import SURFACE_EVENT
from tccm_ros.scene.changes import Change, ChangeKind

pytestmark = [
    pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed"),
    pytest.mark.skipif(
        "TCCM_LONG" not in os.environ, reason="three minutes each: TCCM_LONG=1 pytest test/nodes"
    ),
]

RATE = 1.0
"""The rooms change while the robot drives: a node solves each two seconds."""

RESTART_S = 75.0
"""The robot has seen the first changes of the first room, and is on its way to the second."""


@pytest.mark.parametrize("seed", [1, 2])
def test_events_are_true_also_over_a_saved_map_and_a_restart(ros, session_files, tmp_path, seed):
    bag = session_files.simulated(WORLD, seed=seed)
    events = Listener(ros).listen(message_class(SURFACE_EVENT), "/surface_slam/events")
    asker = Asker(ros)
    tilt_node = tccm(ros, context=ros.context)
    saving = {"save__directory": str(tmp_path / "maps")}
    node = slam(ros, context=ros.context, **saving)
    play_bag(ros, bag, tilt_node, node, duration=RESTART_S, rate=RATE)
    save_all(asker)
    ros.remove(node)
    node = slam(ros, context=ros.context, **saving)
    assert asker.ask("LoadMap", "/surface_slam/load_named_map", name="rooms").success
    play_bag(ros, bag, tilt_node, node, start=RESTART_S, rate=RATE)
    end_input(tilt_node)
    wait_until_done(ros, node)
    save_all(asker)
    ros.spin_until(lambda: len(events) >= true_counts().total(), what="as many events as are true")
    found = [change(message) for message in events]
    assert counted(found) == true_counts()
    assert_one_id_an_item(found)


def save_all(asker) -> None:
    """Save until the map has all that has come: a save does not wait long for a solution."""
    said = "not in it"
    while "not in it" in said:
        said = asker.ask(
            "SaveMap", "/surface_slam/save_named_map", name="rooms", overwrite=True
        ).message


def change(message) -> Change:
    """Return what a message says."""
    return Change(
        ChangeKind(message.kind),
        message.header.stamp.sec * 10**9 + message.header.stamp.nanosec,
        tuple(message.surface_ids_before),
        tuple(message.surface_ids_after),
        message.label,
        message.object_id,
        pose(message.pose_before),
        pose(message.pose_after),
    )


def pose(message):
    """Return T float64 (4, 4) of a pose; None where it has none."""
    p, q = message.position, message.orientation
    if p.x != p.x:
        return None
    return pose_matrix((p.x, p.y, p.z), (q.x, q.y, q.z, q.w), "the event")
