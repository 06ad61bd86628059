"""Settings for every test."""

import os
import shutil
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from tccm_ros.blas import use_one_thread

# Bytecode is kept also where the environment forbids it: tests start hundreds of interpreters.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("MPLBACKEND", "Agg")
use_one_thread()
os.environ.setdefault("TCCM_STRICT", "1")  # a stage that hangs on the map and fails is a fault

# The same examples in every run, so that a commit is green or red for everyone alike. To look for
# new counterexamples: HYPOTHESIS_PROFILE=search make test. What is found becomes an @example.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

SLOW = (
    "agents", "bags/test_topics.py", "baselines/test_seed_segmentation.py", "calibrate",
    "fleet/test_merge.py", "fleet/test_run.py", "fleet/test_task.py", "interfaces", "nodes",
    "replay", "slam/signs", "surfaces/test_changes_in_a_recording.py",
    "surfaces/test_changes_over_time.py", "surfaces/test_growing_map.py",
    "surfaces/registration/test_registration.py", "surfaces/test_sequence_of_changes.py",
    "surfaces/test_sessions_of_recordings.py", "test_cli.py", "test_packaging.py",
    "test_stages.py", "warm_up",
)  # fmt: skip
"""Folders and files of tests that take seconds each: `make test-fast` is without them."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that are slow."""
    root = Path(__file__).parent
    slow = {root / name for name in SLOW}
    files = {path for path in {item.path for item in items} if slow & {path, *path.parents}}
    for item in items:
        if item.path in files:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def session_files(tmp_path_factory):
    """Files that the workers of the session have in common."""
    from session_files import SessionFiles

    base = tmp_path_factory.getbasetemp()
    return SessionFiles((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "common")


@pytest.fixture(scope="session")
def flat(tmp_path_factory):
    """One result folder for all tests that read one; who changes it takes a copy."""
    from result_folder import write_folder

    return write_folder(tmp_path_factory.mktemp("results") / "flat")


@pytest.fixture
def flat_copy(flat, tmp_path):
    """A copy of the result folder, to be changed."""
    return shutil.copytree(flat, tmp_path / "copy")
