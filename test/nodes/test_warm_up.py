"""After a node's warm-up nothing is compiled or read from disk any more."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import gc, sys
from dataclasses import replace
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from tccm_ros.pipeline.calibrate.rig_check import RigCheck
from tccm_ros.config import Config
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.nodes.map_folder import write_map
from tccm_ros.nodes.warm_up import warm_up_tccm
from tccm_ros.nodes.warm_up_slam import warm_up_slam
from tccm_ros.pipeline.processors import Pipeline
from tccm_ros.records import Scan

def compiled():
    kernels = [x for x in gc.get_objects() if isinstance(x, Dispatcher)]
    names = [(k.py_func.__module__, k.py_func.__name__) for k in kernels]
    return {(*name, str(s)) for name, k in zip(names, kernels) for s in k.signatures}

warm_up_tccm(Config())
warm_up_slam(Config())
before = compiled()
assert before
check = RigCheck()

def take(result, _):
    check.add(result)
    result.free_places()

pipeline = Pipeline(Config(), expects_odometry=True, on_cycle=take)
with BagReader(Path(sys.argv[1])) as reader:
    for role, _, record in reader.records(DEFAULT_TOPICS):
        if isinstance(record, Scan):  # what a node gets can be written to
            record = replace(record, ranges=record.ranges.copy())
        pipeline.add(role, record)
pipeline.finish()
solution = pipeline.solve()
assert pipeline.cycles and solution.surfaces and solution.slam.walls
print(*sorted(compiled() - before), sep="\\n")
"""
BAGS = Path(__file__).resolve().parents[2] / "bags"


@pytest.mark.parametrize("bag", ["walkthrough", "flat"])
def test_nothing_is_compiled_once_a_node_is_up(bag):
    command = [sys.executable, "-c", SCRIPT, str(BAGS / bag)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
