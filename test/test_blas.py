"""The command and the nodes have one thread of BLAS, unless the user chose a number."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tccm_ros.blas import THREADS

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="threads are counted in /proc"
)

LOADED = "import numpy, os; numpy.ones((400, 400)) @ numpy.ones((400, 400)); "
LOADED += "print(len(os.listdir('/proc/self/task')))"

COMMAND = f"""
import sys
from tccm_ros import cli
sys.argv = ["tccm", "--version"]
try:
    cli.main()
except SystemExit:
    exec({LOADED!r})
"""

NODE = f"""
import sys, types
from tccm_ros.nodes import start
node = sys.modules["tccm_ros.nodes.idle"] = types.ModuleType("idle")
node.main = lambda: exec({LOADED!r})
start._start("idle")
"""


def threads_of(script, **environment):
    env = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", script], env={**env, **environment}, check=True, text=True,
        stdout=subprocess.PIPE,
    )  # fmt: skip
    return int(done.stdout.split()[-1])


@pytest.mark.parametrize("script", [COMMAND, NODE], ids=["command", "node"])
def test_numpy_has_one_thread_or_as_many_as_the_user_wants(script):
    assert threads_of(script) == 1
    assert threads_of(script, **{THREADS: "2"}) == threads_of(LOADED, **{THREADS: "2"})


def test_thread_count_follows_the_environment():
    assert threads_of(LOADED, **{THREADS: "2"}) == min(2, os.cpu_count() or 1)
