"""What the processes of a robot need not load.

gtsam and what rests on it take 40 MB of each, scipy.stats 20 MB.
"""

import subprocess
import sys

import pytest

LOADED = "import sys, {node}; print('gtsam' in sys.modules)"


@pytest.mark.parametrize(
    ("node", "solves"),
    [
        ("tccm_ros.nodes.tccm_node", False),
        ("tccm_ros.nodes.slam_node", False),
        ("tccm_ros.nodes.solver.process", True),
    ],
)
def test_only_the_process_that_solves_loads_the_graph(node, solves):
    code = LOADED.format(node=node)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(solves)


@pytest.mark.parametrize(
    "module",
    [
        "tccm_ros.nodes.tccm_node",
        "tccm_ros.nodes.slam_node",
        "tccm_ros.nodes.solver.process",
    ],
)
def test_no_process_loads_the_distributions_of_scipy(module):
    code = f"import sys, {module}; print('scipy.stats' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
