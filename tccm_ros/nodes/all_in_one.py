"""all_in_one: both nodes in one process and one executor, with one robot.

tccm_node subscribes to the robot's topics and the tilting laser, slam_node to the level laser. Each
record is checked once, and its events go to the workers of both.
"""

from __future__ import annotations

from tccm_ros.nodes.run import run
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.tccm_node import TccmNode


def main() -> None:
    """Run both nodes until they are asked to stop."""
    made: list[TccmNode] = []

    def tccm_node() -> TccmNode:
        made.append(TccmNode())
        return made[0]

    run(tccm_node, lambda: SlamNode(made[0].robot))
