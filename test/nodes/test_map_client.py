"""The client and the examples, over DDS with both nodes."""

import numpy as np
import pytest
from example_process import run_example
from live_robot import Listener, recording, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


def test_a_python_node_hears_of_the_map_and_asks_it(ros):
    from tccm_ros.client import SurfaceMapClient
    from tccm_ros.errors import QuestionError

    tilt_node, node = tccm(ros), slam(ros)
    robot, own = ros.robot(), Listener(ros).node
    client = SurfaceMapClient(own)
    events, maps = [], []
    client.on_event(events.append)
    client.on_map(lambda: maps.append(len(client.surfaces)))
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, own, "/surface_slam/events")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: client.is_ready and events)
    assert [(e.kind, e.label, e.T_before) for e in events] == [("appeared", "table", None)]
    (table,) = (s for s in client.surfaces if s.label == "table")
    # The table of the room: 0.8 m by 1.0 m, its middle at (0.8, 0).
    assert table.height == pytest.approx(0.70, abs=0.01)
    assert np.abs(table.T_map_surface[:2, 3] - (0.8, 0.0)).max() < 0.1
    found = client.find_placements((0.1, 0.1, 0.12), max_count=1)
    ros.spin_until(found.done)
    (place,) = found.result()
    assert place.surface_id == table.id
    assert place.T_map_object[2, 3] == pytest.approx(0.70, abs=0.01)
    wrong = client.find_placements((-0.1, 0.1, 0.12))
    ros.spin_until(wrong.done)
    with pytest.raises(QuestionError, match="size_x"):
        wrong.result()
    assert f"table {table.id} at 0.70 m" in run_example(ros, "list_counters.py")
