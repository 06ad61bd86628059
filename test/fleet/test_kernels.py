"""Kernels are compiled by one process, which runs once."""

import subprocess

import pytest

from tccm_ros.config import Config
from tccm_ros.fleet import kernels


@pytest.fixture
def started(monkeypatch):
    """The processors that a child was started for; compiling is left out."""
    kernels._ready.cache_clear()
    commands = []

    def run(command, **_):
        commands.append(command[-2])
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(kernels.subprocess, "run", run)
    yield commands
    kernels._ready.cache_clear()


def test_what_is_not_compiled_is_compiled_once(started, monkeypatch):
    monkeypatch.setattr(kernels, "is_compiled", lambda name: False)
    for _ in range(3):
        kernels.compile_kernels(Config())
    assert started == ["tccm", "slam"]


def test_what_is_compiled_is_left_as_it_is(started, monkeypatch):
    monkeypatch.setattr(kernels, "is_compiled", lambda name: True)
    kernels.compile_kernels(Config())
    assert started == []
