"""After a warm-up nothing is compiled or read from disk any more."""

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from tccm_ros.calibrate.rig_check import RigCheck
from tccm_ros.config import Config
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.warm_up import drive, outlines, tilt
from tccm_ros.replay.processors import Pipeline
from tccm_ros.results.cuboids_file import cuboids_archive

def compiled():
    kernels = [x for x in gc.get_objects() if isinstance(x, Dispatcher)]
    names = [(k.py_func.__module__, k.py_func.__name__) for k in kernels]
    return {(*name, str(s)) for name, k in zip(names, kernels) for s in k.signatures}

tilt.warm_up(Config())
drive.warm_up(Config())
before = compiled()
outlines.warm_up(Config())
assert compiled() == before, "outlines are made for other types than those of a tilt cycle"
assert before
for bag in sys.argv[1:]:
    check = RigCheck()
    on_cycle = lambda result, _: check.add(result)
    pipeline = Pipeline(Config(), expects_odometry=True, on_cycle=on_cycle)
    with BagReader(Path(bag)) as reader:
        for role, _, record in reader.records(DEFAULT_TOPICS):
            pipeline.add(role, record)
    pipeline.finish()
    cuboids_archive(pipeline.tccm.map.cuboids(), Config(), "odom")
    solution = pipeline.solve()
    assert pipeline.cycles and solution.surfaces and solution.graph.walls
print(*sorted(compiled() - before), sep="\\n")
"""
BAGS = [Path(__file__).resolve().parents[2] / "bags" / name for name in ("walkthrough", "flat")]


def test_nothing_is_compiled_after_the_warm_up():
    command = [sys.executable, "-c", SCRIPT, *map(str, BAGS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""


TRACKING = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.config import Config
from tccm_ros.warm_up.parts import warm_up
from tccm_ros.robot import Robot
from tccm_ros.sensors.registry import default_streams
from tccm_ros.slam.tracking import Tracker

def compiled():
    kernels = [x for x in gc.get_objects() if isinstance(x, Dispatcher)]
    names = [(k.py_func.__module__, k.py_func.__name__) for k in kernels]
    return {(*name, str(s)) for name, k in zip(names, kernels) for s in k.signatures}

warm_up("slam", Config())
assert "gtsam" not in sys.modules
before = compiled()
assert before
for bag in sys.argv[1:]:
    robot, tracker = Robot(Config(), default_streams(), expects_odometry=True), Tracker(Config())
    with BagReader(Path(bag)) as reader:
        for role, _, record in reader.records(DEFAULT_TOPICS):
            if role in {"tilt_scan", "joint_states"}:  # for tccm_node
                continue
            for event in robot.add(role, record):
                if tracker.takes(event):
                    tracker.add(event)
    assert tracker.counts["keyframes"]
print(*sorted(compiled() - before), sep="\\n")
"""


def test_no_kernel_is_loaded_while_tracking():
    command = [sys.executable, "-c", TRACKING, *map(str, BAGS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
