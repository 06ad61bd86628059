"""Kernels are compiled by children, each part once, and nobody waits for one that is gone."""

import io
import os
import sys
import threading

import pytest

from tccm_ros import kernel_cache
from tccm_ros.config import Config
from tccm_ros.warm_up import compilation
from tccm_ros.warm_up.compilation import Compilation, compile_kernels, missing_parts
from tccm_ros.warm_up.parts import PARTS


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty folder of kernels."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel_cache.cache_folder.cache_clear()
    yield kernel_cache.cache_folder()
    kernel_cache.cache_folder.cache_clear()


@pytest.fixture
def child(monkeypatch, tmp_path):
    """Replaces what the children run; called with a shell script, it returns its log."""

    def run(script):
        program, log = tmp_path / "child", tmp_path / "log"
        program.write_text(f'#!/bin/sh\ncat > /dev/null\necho "$3" >> {log}\n{script}\n')
        program.chmod(0o700)
        log.touch()
        monkeypatch.setattr(sys, "executable", str(program))
        return log

    return run


def compile_here(monkeypatch, part, compiled):
    """Do what a child does, but for compiling."""
    monkeypatch.setattr(sys, "argv", ["", part, str(os.getppid())])
    monkeypatch.setattr(sys, "stdin", io.StringIO(Config().model_dump_json()))
    monkeypatch.setattr(compilation, "_end_with", lambda parent: None)
    monkeypatch.setattr(compilation, "run_part", lambda part, config: compiled.append(part))
    compilation.main()


def test_a_part_is_compiled_once_and_again_for_other_versions(folder, monkeypatch):
    compiled = []
    assert missing_parts(PARTS) == ("tilt", "outlines", "drive")
    for _ in range(2):
        compile_here(monkeypatch, "outlines", compiled)
    assert compiled == ["outlines"]
    assert missing_parts(["tccm"]) == ("tilt",)
    monkeypatch.setattr(compilation, "numba_version", "0")
    assert missing_parts(["tccm"]) == ("tilt", "outlines")


def test_each_part_of_the_processors_gets_a_child(folder, child):
    log = child("exit 0")
    compile_kernels(["slam", "tccm", "signs"], Config())
    assert sorted(log.read_text().split()) == ["drive", "outlines", "tilt"]


def test_cached_parts_need_no_child_process(folder, child, monkeypatch):
    log = child("exit 0")
    for part in PARTS["slam"]:
        compile_here(monkeypatch, part, [])
    compile_kernels(["slam"], Config())
    assert log.read_text() == ""


def test_without_compiling_no_child_is_started(folder, child, monkeypatch):
    log = child("exit 0")
    monkeypatch.setattr(compilation.numba_config, "DISABLE_JIT", 1)
    compile_kernels(PARTS, Config())
    assert log.read_text() == ""


def test_failed_child_is_reported_with_its_last_line(folder, child):
    child("echo first >&2; echo no memory >&2; exit 3")
    failing = Compilation(["slam"], Config())
    failing.start()
    assert failing.wait()
    assert failing.problems == ["compiling in a process failed (no memory)"]


def test_stopping_ends_the_children_and_starts_no_more(folder, child, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    log = child("exec sleep 600")
    stopped = Compilation(["tccm"], Config())
    stopped.start()
    while not log.read_text():
        assert not stopped.wait(0.01)
    stopped.stop()
    assert stopped.wait(60.0)
    assert log.read_text().split() == ["tilt"]
    assert not stopped.problems


def test_only_one_process_compiles_a_part(folder, monkeypatch):
    compiled = []
    with compilation._only_one("drive"):
        second = threading.Thread(target=compile_here, args=(monkeypatch, "drive", compiled))
        second.start()
        compilation._marker("drive").write_text(compilation._fingerprint())
        assert not compiled
    second.join(60.0)
    assert not compiled
    assert not second.is_alive()
