"""The nodes as processes of their own, as `ros2 run` starts them."""

import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 300.0
"""A wait that is this long has failed: a loaded machine takes many times what a free one takes."""


@contextmanager
def started(domain: int, module: str, *arguments: str, before: str = "", **options):
    """Start a node; whatever happens, it is gone at the end.

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


def play_to_process(ros, robot, records) -> None:
    """Publish a short recording to a node in another process: less than a queue holds."""
    for topic, record in records:
        message = robot.message(record)
        if topic not in robot._publishers:
            publisher = robot.node.create_publisher(type(message), topic, robot._qos)
            robot._publishers[topic] = publisher
            ros.spin_until(publisher.get_subscription_count, what=f"somebody to hear {topic}")
        robot.publish(topic, message)


def read_until(process, pattern: str) -> str:
    """Return what a process prints up to a pattern."""
    text, end = "", time.monotonic() + PATIENCE_S
    while not re.search(pattern, text):
        assert time.monotonic() < end, text
        if select.select([process.stdout], [], [], 1.0)[0]:
            piece = os.read(process.stdout.fileno(), 65536).decode()
            assert piece, text
            text += piece
    return text


def children(process) -> list[int]:
    """Return the ids of the processes that a process has started."""
    text = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    return [int(word) for word in text.split()]


def stop(process, number=signal.SIGINT, timeout: float = PATIENCE_S) -> tuple[int, str]:
    """Send a signal; return the exit status and what was printed."""
    process.send_signal(number)
    output, _ = process.communicate(timeout=timeout)
    return process.returncode, output
