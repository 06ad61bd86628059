"""Depth cameras and lidars over DDS: what cannot be used is counted, and the rest is mapped."""

from collections import Counter

import edited_bag as eb
import numpy as np
from depth_room import write_recording
from live_bag import SLOW_RATE, play, save
from live_robot import slam, tccm
from rclpy.node import Node

from tccm_ros.config import Config
from tccm_ros.pipeline.replay import replay


def all_zero(message):
    message.data = np.zeros_like(message.data)


SPOILERS = {
    eb.CLOUD: (None, eb.without_x, eb.wrong_step, eb.too_many),
    eb.IMAGE: (None, all_zero, eb.wrong_size),
    eb.INFO: (None, eb.zero_focal),
}
"""What is done to the messages of a type, in turn."""


def spoiled(source, path):
    """Write a recording whose messages are spoiled in turn; return how many of each type were."""
    seen: Counter[str] = Counter()
    count: Counter[str] = Counter()

    def edit(topic, msgtype, message):
        spoilers = SPOILERS.get(msgtype, (None,))
        spoil = spoilers[seen[msgtype] % len(spoilers)]
        seen[msgtype] += 1
        if spoil is not None:
            spoil(message)
            count[spoil.__name__] += 1
        return [(topic, msgtype, message)]

    eb.edited(source, path, edit)
    return count


def test_what_cannot_be_used_is_counted_by_reason_and_the_rest_is_mapped(ros, tmp_path):
    write_recording(tmp_path / "source")
    spoilt = spoiled(tmp_path / "source", tmp_path / "bag")
    bag, live, offline = tmp_path / "bag", tmp_path / "live", tmp_path / "offline"
    summary = replay(bag, offline, Config(), pictures=False)
    common = {"context": ros.context, "save__directory": str(live)}
    node, walls = tccm(ros, **common), slam(ros, **common)
    ros.connect(node, walls, "/tccm/surfaces", "/tccm/view")
    play(ros, bag, node, walls, rate=SLOW_RATE)
    asker = ros.add(Node("asker", context=ros.context))
    save(ros, asker, "/tccm/save_map")
    cycles = node.processor.counts["cycles"]
    for topic in ("/tccm/surfaces", "/tccm/view"):
        ros.spin_until(lambda t=topic: walls.inputs.counts()[t] == cycles, what=topic)
    save(ros, asker, "/surface_slam/save_map")
    assert cycles >= 3
    assert {topic.lstrip("/"): n for topic, n in node.refused.items()} == {
        "points": spoilt["without_x"] + spoilt["wrong_step"] + spoilt["too_many"],
        "depth/image_rect_raw": spoilt["wrong_size"],
        "depth/camera_info": spoilt["zero_focal"],
    }
    assert node.dropped == {"no depths": spoilt["all_zero"]}
    dropped = summary.content.counts.dropped
    assert sum(dropped.values()) == sum(spoilt.values())
    assert dropped["no depths"] == spoilt["all_zero"]
    assert node.inputs.lost() == {}
    # Of what is mapped slam_node reads the stamps alone: its trajectory has those of the rest too.
    for name in ("surfaces.json", "objects.json", "surfaces.ply", "walls.json", "graph.json"):
        assert (live / name).read_bytes() == (offline / name).read_bytes(), name
