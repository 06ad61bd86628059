"""One result folder for all tests of the report; who changes it takes a copy."""

import shutil

import pytest
from result_folder import write_folder


@pytest.fixture(scope="session")
def flat(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("results") / "flat")


@pytest.fixture
def flat_copy(flat, tmp_path):
    return shutil.copytree(flat, tmp_path / "copy")
