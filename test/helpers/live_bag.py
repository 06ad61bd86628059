"""A bag played through DDS into nodes as fast as they take it, and the files that they save."""

import time
from pathlib import Path

from live_robot import overrides
from std_srvs.srv import Trigger

from tccm_ros.bags.reader import BagReader
from tccm_ros.nodes.player_node import PlayerNode

MAX_BEHIND = 60
"""Messages of one topic that may wait: with a burst of the player less than a queue holds."""

MAX_WAITING = 500
"""Jobs of a worker that may wait: a node drops scans only with four times as many."""

RATE = 50.0
"""Far more than the nodes can take: how fast they are decides."""

SLOW_RATE = 3.0
"""For images: they wait in short queues, and may not come seconds after odometry."""

EQUAL = (
    "surfaces.json",
    "objects.json",
    "surfaces.ply",
    "walls.json",
    "graph.json",
    "trajectory.tum",
    "cuboids.npz",
)
"""Files that are the same, byte for byte, live and offline."""


def messages(bag: Path) -> int:
    with BagReader(bag) as reader:
        return sum(topic.count for topic in reader.topics())


def save(ros, node, service: str) -> None:
    """Save until the map has all that has come: a save does not wait long for a solution."""
    while True:
        answer = ros.call(node.create_client(Trigger, service), Trigger.Request())
        assert answer.success, answer.message
        if "not in it" not in answer.message:
            return


def play(ros, bag: Path, *nodes, rate: float = RATE) -> PlayerNode:
    """Play a bag as fast as the nodes take it; return when they have received all of it."""
    values = {"bag": str(bag), "rate": rate, "reliable": True, "paused": True}
    player = ros.add(PlayerNode(context=ros.context, parameter_overrides=overrides(values)))
    for node in nodes:
        for topic in set(node.inputs.counts()) & set(player._publishers_by_topic):
            ros.connect(player, node, topic)
    ros.spin_until(lambda: throttled(player, nodes) and player.is_done, what="the player")
    for node in nodes:
        ros.spin_until(lambda n=node: behind(player, n) == 0, what="all messages")
    return player


def behind(player, node) -> int:
    """Return how many messages of its slowest topic a node has not received yet."""
    received = node.inputs.counts()
    return max((sent - received.get(t, sent) for t, sent in player.sent.items()), default=0)


def throttled(player, nodes) -> bool:
    """Hold the player while a node of this one executor is behind: nothing may overflow."""
    is_late = any(
        behind(player, node) > MAX_BEHIND or node.worker.backlog > MAX_WAITING for node in nodes
    )
    if is_late and player._timeline.is_running:
        player._timeline.pause(time.monotonic_ns())
    elif not is_late and player._timeline.is_paused:
        player._timeline.run(time.monotonic_ns())
    return True
