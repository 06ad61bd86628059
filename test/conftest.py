"""Settings for every test."""

import os
import shutil

import pytest
from hypothesis import settings

os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("TCCM_STRICT", "1")  # a stage that hangs on the map and fails is a fault

# The same examples in every run, so that a commit is green or red for everyone alike. To look for
# new counterexamples: HYPOTHESIS_PROFILE=search make test. What is found becomes an @example.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

RERUNS = 1
"""Discovery between participants is asynchronous: a test over DDS that fails is tried once more."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Have the tests over DDS, and these alone, run again where they fail."""
    if not config.pluginmanager.hasplugin("rerunfailures"):
        return
    for item in items:
        if {"ros", "domain"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS))


@pytest.fixture(scope="session")
def flat(tmp_path_factory):
    """One result folder for all tests that read one; who changes it takes a copy."""
    from result_folder import write_folder

    return write_folder(tmp_path_factory.mktemp("results") / "flat")


@pytest.fixture
def flat_copy(flat, tmp_path):
    """A copy of the result folder, to be changed."""
    return shutil.copytree(flat, tmp_path / "copy")
