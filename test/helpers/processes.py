"""Nodes in their own processes, as started by `ros2 run`."""

import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

from live_robot import recording

PATIENCE_S = 300.0
"""Timeout of waits, s: many times the duration on an idle machine."""


@contextmanager
def started(domain: int, module: str, *arguments: str, before: str = "", **options):
    """Start a node; it is always terminated at the end.

    `before` is a script that runs first; `options` are those of `subprocess.Popen`.
    """
    script = f"{before}\nfrom tccm_ros.nodes.start import {module}; {module}()"
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, **options}
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        **options,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def settings(**values) -> list[str]:
    """Return the arguments that set parameters, ``group__key``."""
    pairs = [f"{name.replace('__', '.')}:={value}" for name, value in values.items()]
    return ["--ros-args", *(word for pair in pairs for word in ("-p", pair))]


def play_until(ros, robot, cycles: float, is_done: Callable[[], object], what: str, **options):
    """Play a short recording to a node in another process until `is_done`.

    Each repetition has later stamps. The subscriptions of that process discover the robot's
    publishers one after another, and the last match cannot be observed here. Scans that arrive
    before the description or the joints are dropped; those of a later recording are not.

    Parameters
    ----------
    cycles, options
        As for `live_robot.recording`; with fewer messages than the depth of a queue.
    is_done
        Called after each recording. It calls the node, and so waits for its pending work.
    what
        Name of the condition, for the message of a failure.
    """
    end = time.monotonic() + PATIENCE_S
    while True:
        for topic, record in recording(cycles, start_ns=ros.start_of_recording(cycles), **options):
            message = robot.message(record)
            publisher = robot.publisher(topic, message)
            ros.spin_until(publisher.get_subscription_count, what=f"somebody to hear {topic}")
            robot.publish(topic, message)
        if is_done():
            return
        assert time.monotonic() < end, f"timed out: {what}"


def read_until(process, pattern: str) -> str:
    """Return the output of a process up to a pattern."""
    text, end = "", time.monotonic() + PATIENCE_S
    while not re.search(pattern, text):
        assert time.monotonic() < end, text
        if select.select([process.stdout], [], [], 1.0)[0]:
            piece = os.read(process.stdout.fileno(), 65536).decode()
            assert piece, text
            text += piece
    return text


def children(process) -> list[int]:
    """Return the ids of the child processes of a process."""
    text = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    return [int(word) for word in text.split()]


def stop(process, number=signal.SIGINT, timeout: float = PATIENCE_S) -> tuple[int, str]:
    """Send a signal; return the exit status and the output."""
    process.send_signal(number)
    output, _ = process.communicate(timeout=timeout)
    return process.returncode, output
