"""managed_tccm_node: tccm_node for a lifecycle manager."""

from tccm_ros.nodes.managed import ManagedTccmNode
from tccm_ros.nodes.run import run


def main() -> None:
    """Run the node until it is asked to stop."""
    run(ManagedTccmNode)
