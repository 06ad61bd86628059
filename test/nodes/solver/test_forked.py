"""The process that solves is forked from its node: common memory, restarts, its end."""

import subprocess
import sys

PATIENCE_S = 120.0

SOLVES = """
import os, signal, sys
from pathlib import Path
from tccm_ros.nodes.solver import forked

if {is_forked}:
    forked.prepare()
assert "rclpy" not in sys.modules  # its libraries start threads
from tccm_ros.config import Config
from tccm_ros.nodes.solver.solver import Solver

solver = Solver(Config(), lambda answer: None)
first = solver.pid
assert solver.wait(solver.solve(frozenset()), {patience})
lines = Path(f"/proc/{{first}}/smaps_rollup").read_text().splitlines()
print(next(line.split()[1] for line in lines if line.startswith("Shared_Dirty")))
os.kill(first, signal.SIGKILL)
with solver._changed:
    assert solver._changed.wait_for(lambda: solver.pid != first, {patience})
print(solver.restarts, solver.pid != first)
solver.close()
"""

ENDS = """
from tccm_ros.nodes.solver import forked

forked.prepare()
print("made", flush=True)
{end}
"""


def run(script: str, status: int = 0) -> list[str]:
    """Run a script; return its lines when it and its children, who can print, have ended."""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S,
        check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    assert not done.stderr
    return done.stdout.splitlines()


def test_forked_process_inherits_memory_and_is_restarted_after_death():
    shared_kb, restarts = run(SOLVES.format(is_forked=True, patience=PATIENCE_S))
    assert int(shared_kb) > 30_000
    assert restarts == "1 True"


def test_a_process_that_is_not_forked_has_its_own():
    shared_kb, restarts = run(SOLVES.format(is_forked=False, patience=PATIENCE_S))
    assert int(shared_kb) < 1_000
    assert restarts == "1 True"


def test_idle_solver_process_ends_with_its_node():
    assert run(ENDS.format(end="")) == ["made"]
    assert run(ENDS.format(end="import os; os.kill(os.getpid(), 9)"), status=-9) == ["made"]
