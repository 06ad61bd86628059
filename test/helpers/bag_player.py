"""Playback of a bag by `PlayerNode` to nodes of the same process, at the speed of these nodes."""

import time
from pathlib import Path

from live_robot import overrides, wait_until_done
from std_srvs.srv import SetBool

from tccm_ros.nodes.player_node import PlayerNode

RATE = 20.0
"""Maximum playback rate, seconds of the bag per second; it is lower where the nodes are slower."""

MAX_WAITING = 20
"""Number of messages of a topic in flight to a node at which the player is paused. The player sends
at most `player_node.BURST` before and after it receives the request; queues hold 200."""

ASK_AGAIN_S, MAX_ASKED = 5.0, 60
"""Time after which a request without a response is repeated, s, and the maximum number of requests.
"""


def play_bag(ros, bag: Path, *nodes, **values) -> None:
    """Play a bag, or a part of it; return when the nodes' workers have processed all messages.

    `values` are parameters of the player, such as `start` and `duration`.
    """
    received = {node: node.inputs.counts() for node in nodes}
    values = {"bag": str(bag), "rate": RATE, "reliable": True, "paused": True, **values}
    player = ros.add(
        PlayerNode(context=ros.another_context(), parameter_overrides=overrides(values))
    )
    topics = {publisher.topic_name for publisher in player.publishers}
    for node, before in received.items():
        ros.connect(player, node, *(topics & before.keys()))

    def missing(node) -> int:
        """Return the maximum number, over the topics, of messages sent but not yet received."""
        counts, before = node.inputs.counts(), received[node]
        sent = ((n, topic) for topic, n in player.sent.items() if topic in counts)
        return max((n - counts[topic] + before[topic] for n, topic in sent), default=0)

    def is_ahead() -> bool:
        return any(max(missing(n), n.worker.backlog) > MAX_WAITING for n in nodes)

    _play_while(ros, player, is_ahead)
    for node in nodes:
        ros.spin_until(lambda n=node: missing(n) <= 0, what="all messages")
        wait_until_done(ros, node)
    ros.remove(player)


def _play_while(ros, player, is_ahead) -> None:
    """Spin until the player is done; it pauses while it is ahead of the nodes."""
    pause = player.create_client(SetBool, "/player/pause")
    ros.spin_until(pause.service_is_ready, what="the player's service")
    is_paused = True
    while not player.is_done:
        if is_paused != is_ahead():
            is_paused = not is_paused
            _ask(ros, pause, SetBool.Request(data=is_paused))
        ros.executor.spin_once(timeout_sec=0.02)


def _ask(ros, client, request) -> None:
    """Repeat a request until there is a response.

    A request is lost if the client has discovered the service, but not the service the client.
    """
    for _ in range(MAX_ASKED):
        answer, end = client.call_async(request), time.monotonic() + ASK_AGAIN_S
        while time.monotonic() < end:
            ros.executor.spin_once(timeout_sec=0.02)
            if answer.done():
                return
    raise AssertionError(f"no answer of {client.srv_name}")
