"""The wheel works in an empty environment, away from the checkout."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def run(*command, folder: Path, **environment: str) -> str:
    """Run a command away from the checkout; where it fails, say what it printed."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "AMENT"))}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=plain | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """An empty environment with the wheel and what its metadata asks for, nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    source = folder / "source"
    run("git", "clone", "-q", ROOT, source, folder=folder)
    run(*pip, "wheel", "-q", "--no-deps", "-w", folder, source, folder=folder)
    [wheel] = folder.glob("tccm_ros-*.whl")
    venv = folder / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", venv, folder=folder)
    run(*pip, "--python", venv, "install", "-q", "--no-compile", wheel, folder=folder)
    return folder


def test_the_wheel_maps_its_recording_in_an_empty_environment(installed):
    assert "tccm_ros" not in os.listdir(installed)
    run(installed / "venv/bin/tccm", "demo", "--no-browser", folder=installed)
    surfaces = json.loads((installed / "tccm_demo/surfaces.json").read_text())["surfaces"]
    assert len(surfaces) > 15
    assert (installed / "tccm_demo/report.html").stat().st_size > 10_000
