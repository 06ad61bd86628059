"""managed_slam_node: slam_node for a lifecycle manager."""

from tccm_ros.nodes.managed import ManagedSlamNode
from tccm_ros.nodes.run import run


def main() -> None:
    """Run the node until it is asked to stop."""
    run(ManagedSlamNode)
