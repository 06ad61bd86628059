"""Compiled kernels on disk: found again by any process, and never when what is in them changed."""

import os
import textwrap
from pathlib import Path

import numpy as np
import pytest
from kernel_forks import run_forked

from tccm_ros import kernel_cache
from tccm_ros.kernel_cache import cache_folder, source_digest
from tccm_ros.kernels import kernel

KEPT = 24  # newest files kept per kernel

INNER = """
    from tccm_ros.kernels import kernel

    {comment}
    STEP = {step}


    @kernel
    def inner(x):
        '''Add a step.{comment}'''
        return x {sign} STEP
"""
OUTER = """
    from inner import inner
    from tccm_ros.kernels import kernel


    @kernel
    def outer(x):
        return {times} * inner(x)


    if __name__ == "__main__":
        print(outer(1.0), sum(outer._cache_hits.values()))
"""


@pytest.fixture
def run(tmp_path):
    """Return what runs two modules, one of which calls the other's kernel, in a process."""

    def start(step="10.0", sign="+", comment="", times=2, environment=()):
        inner = INNER.format(step=step, sign=sign, comment=comment)
        (tmp_path / "inner.py").write_text(textwrap.dedent(inner))
        (tmp_path / "outer.py").write_text(textwrap.dedent(OUTER.format(times=times)))
        settings = {"XDG_CACHE_HOME": str(tmp_path / "cache"), **dict(environment)}
        plain = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        value, hits = run_forked(tmp_path / "outer.py", plain | settings).split()
        return float(value), int(hits)

    return start


def test_a_kernel_is_compiled_once_for_all_processes(run):
    assert run() == (22.0, 0)
    assert run() == (22.0, 1)


def test_a_change_in_a_kernel_of_another_module_is_seen(run):
    """Numba's own cache looks at the caller's file alone and gives 22 again."""
    assert run() == (22.0, 0)
    assert run(sign="-") == (-18.0, 0)
    assert run() == (22.0, 1), "the first one is still there"


def test_a_change_of_a_constant_of_another_module_is_seen(run):
    assert run() == (22.0, 0)
    assert run(step="20.0") == (42.0, 0)


def test_a_kernel_from_the_cache_is_linked_into_one_that_is_compiled(run):
    assert run() == (22.0, 0)
    assert run(times=3) == (33.0, 0)


def test_a_change_of_comments_and_lines_compiles_nothing(run):
    assert run() == (22.0, 0)
    assert run(comment="# A comment.") == (22.0, 1)


def test_a_damaged_file_is_compiled_again(run, tmp_path):
    run()
    for path in (tmp_path / "cache" / "tccm_ros").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert run() == (22.0, 0)
    assert run() == (22.0, 1)


def test_a_folder_that_cannot_be_made_is_no_error(run, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "temporary").mkdir()
    environment = {
        "XDG_CACHE_HOME": str(tmp_path / "file"),
        "TMPDIR": str(tmp_path / "temporary"),
    }
    assert run(environment=environment) == (22.0, 0)
    assert run(environment=environment) == (22.0, 1), "kept among the temporary files"


def test_numbas_variable_names_the_folder(run, tmp_path):
    run(environment={"NUMBA_CACHE_DIR": str(tmp_path / "named")})
    assert list((tmp_path / "named" / "tccm_ros").glob("*.nbc"))
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("version", ["numba", "np"])
def test_another_version_of_a_library_is_another_key(version, monkeypatch):
    @kernel
    def same(x):
        return x

    key = same._cache._key_of("(float64,)", Codegen())
    assert key == same._cache._key_of("(float64,)", Codegen())
    assert key != same._cache._key_of("(float64,)", Codegen("another processor"))
    monkeypatch.setattr(getattr(kernel_cache, version), "__version__", "0.1")
    assert key != same._cache._key_of("(float64,)", Codegen())


def test_a_setting_of_numba_that_changes_code_is_another_key(run):
    assert run() == (22.0, 0)
    assert run(environment={"NUMBA_BOUNDSCHECK": "1"}) == (22.0, 0)
    assert run() == (22.0, 1)


class Codegen:
    def __init__(self, processor="a processor"):
        self.processor = processor

    def magic_tuple(self):
        return (self.processor,)


def function(text: str, **names):
    space = dict(names)
    exec(textwrap.dedent(text), space)
    return space["f"]


@pytest.mark.parametrize(
    ("before", "after"),
    [(1, 1.0), (1.0, 1.5), ((1, 2), (2, 1)), (np.arange(3), np.arange(3) + 1), (np.pi, np.e)],
)
def test_the_value_of_a_constant_is_part_of_the_key(before, after):
    text = "def f(x):\n    return C"
    digest = source_digest(function(text, C=before))
    assert digest == source_digest(function(text, C=before))
    assert digest != source_digest(function(text, C=after))


def test_the_oldest_files_of_a_kernel_are_removed(tmp_path, monkeypatch):
    @kernel
    def twice(x):
        return 2 * x

    monkeypatch.setattr(kernel_cache, "cache_folder", lambda: tmp_path)
    for k in range(KEPT + 3):
        path = tmp_path / f"{twice._cache._name}.{k:032x}.nbc"
        path.write_bytes(b"")
        os.utime(path, (k, k))
    other = tmp_path / f"other.{0:032x}.nbc"
    other.write_bytes(b"")
    assert twice(1) == 2
    left = sorted(path.name for path in tmp_path.iterdir())
    assert len(left) == KEPT + 1
    assert other.name in left
    assert not any(f".{k:032x}." in name for k in range(4) for name in left if name != other.name)
    twice._cache.flush()
    assert [path.name for path in tmp_path.iterdir()] == [other.name]


def test_only_a_folder_of_this_user_is_taken(tmp_path, monkeypatch):
    cache_folder.cache_clear()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    try:
        assert cache_folder() == tmp_path / "tccm_ros"
        cache_folder.cache_clear()
        monkeypatch.setattr(os, "getuid", lambda: 12345)
        found = cache_folder()
        assert found.name.startswith("tccm_ros_")
        assert found != Path(tmp_path / "tccm_ros")
    finally:
        cache_folder.cache_clear()
