"""A bag played through DDS into both nodes gives the files of its replay, byte for byte."""

import time
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from tccm_ros.config import Config
from tccm_ros.nodes.player_node import PlayerNode
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.tccm_node import TccmNode
from tccm_ros.replay import replay

MOST_BEHIND = 60
"""Messages of one topic that may wait: with a burst of the player less than a queue holds."""

BAG = Path(__file__).resolve().parents[2] / "bags" / "walkthrough"
EQUAL = (
    "surfaces.json",
    "surfaces.ply",
    "walls.json",
    "graph.json",
    "trajectory.tum",
    "cuboids.npz",
)


@pytest.fixture(scope="module")
def offline(tmp_path_factory):
    out = tmp_path_factory.mktemp("offline") / "map"
    replay(BAG, out, Config(), pictures=False)
    return out


def call(ros, client):
    ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    ros.spin_until(future.done, timeout=120.0)
    assert future.result().success, future.result().message


def test_live_equals_offline(ros, offline, tmp_path):
    live = tmp_path / "live"
    settings = [
        Parameter("save.directory", value=str(live)),
        # Everything has to arrive for the files to be equal; best effort may lose a sample.
        Parameter("qos.reliability", value="reliable"),
    ]
    tccm = ros.add(TccmNode(context=ros.context, parameter_overrides=settings))
    slam = ros.add(SlamNode(context=ros.context, parameter_overrides=settings))
    ask = Node("asker", context=ros.context)
    ros.add(ask)
    player = ros.add(
        PlayerNode(
            context=ros.context,
            parameter_overrides=[
                Parameter("bag", value=str(BAG)),
                Parameter("rate", value=2.0),
                Parameter("reliable", value=True),
                Parameter("wait_for_subscribers", value=10.0),
            ],
        )
    )
    ros.spin_until(lambda: throttled(player, tccm, slam) and player.is_done, timeout=240.0)
    for node in (tccm, slam):
        ros.spin_until(lambda n=node: behind(player, n) == 0, what="all messages")
    call(ros, ask.create_client(Trigger, "/tccm/save_map"))
    cycles = tccm.processor.counts["cycles"]
    ros.spin_until(lambda: slam.inputs.counts()["/tccm/surfaces"] == cycles)
    ros.spin_until(lambda: slam.inputs.counts()["/tccm/view"] == cycles)
    call(ros, ask.create_client(Trigger, "/surface_slam/save_map"))
    slam.close()
    assert cycles > 0
    for name in EQUAL:
        assert (live / name).read_bytes() == (offline / name).read_bytes(), name


def behind(player, node) -> int:
    """Return how many messages of its slowest topic a node has not received yet."""
    received = node.inputs.counts()
    return max(sent - received.get(topic, sent) for topic, sent in player.sent.items())


def throttled(player, *nodes) -> bool:
    """Hold the player while a node of this one executor is behind: nothing may overflow."""
    now = time.monotonic_ns()
    late = max((behind(player, node) for node in nodes), default=0) if player.sent else 0
    if late > MOST_BEHIND and player._timeline.is_running:
        player._timeline.pause(now)
    elif late <= MOST_BEHIND and player._timeline.is_paused:
        player._timeline.run(now)
    return True
