"""An example program in its own process, with nodes in the process of the test."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@contextmanager
def example(ros, name: str, *words: str) -> Iterator[subprocess.Popen]:
    """Start an example; it is terminated at the end."""
    process = subprocess.Popen(
        [sys.executable, EXAMPLES / name, *words],
        env={**os.environ, "ROS_DOMAIN_ID": str(ros.domain)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def printed(ros, process: subprocess.Popen) -> str:
    """Return the output of an example after it has ended."""
    ros.spin_until(lambda: process.poll() is not None, what="the example")
    assert process.stdout is not None
    text = process.stdout.read()
    assert process.returncode == 0, text
    return text


def run_example(ros, name: str, *words: str) -> str:
    """Run an example; return its output."""
    with example(ros, name, *words) as process:
        return printed(ros, process)
