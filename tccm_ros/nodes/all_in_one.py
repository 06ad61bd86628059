"""all_in_one: both nodes in one process and one executor."""

from tccm_ros.nodes.run import run
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.tccm_node import TccmNode

__all__ = ["main"]


def main() -> None:
    """Run both nodes until they are told to stop."""
    run(TccmNode, SlamNode)
