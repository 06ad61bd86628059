"""What the processes of a robot need not load.

gtsam and what rests on it take 40 MB of each, scipy.stats 20 MB.
"""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "solves"),
    [
        ("tccm_ros.nodes.tccm_node", False),
        ("tccm_ros.nodes.slam_node", False),
        ("tccm_ros.nodes.solver.process", True),
    ],
)
def test_only_the_solver_process_loads_gtsam_and_no_process_scipy_stats(module, solves):
    code = f"import sys, {module}; print(*({{'gtsam', 'scipy.stats'}} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["gtsam"] * solves
