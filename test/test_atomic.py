"""After a kill at any moment files and folders are old or new, and no temporary files stay."""

import os
import subprocess
import sys

import pytest

from tccm_ros.atomic import finish_moves, output_file, output_folder
from tccm_ros.errors import OutputError

KILLED = 9
WRITE_AND_DIE = """
import os, shutil, sys
from pathlib import Path
from tccm_ros.atomic import output_folder

out, text, left = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])

def deadly(step):
    def call(*arguments, **options):
        global left
        left -= 1
        if left == 0:
            os._exit(9)
        return step(*arguments, **options)
    return call

for module, name in ((os, "rename"), (os, "replace"), (os, "rmdir"), (os, "fsync"),
                     (os, "unlink"), (shutil, "rmtree")):
    setattr(module, name, deadly(getattr(module, name)))
with output_folder(out) as made:
    for name in ("a", "b", "c"):
        (made / name).write_text(text)
    (made / "folder").mkdir()
    (made / "folder" / "d").write_text(text)
"""
NAMES = ("a", "b", "c", "folder/d")


def write(out, text, steps=0) -> int:
    """Write a folder, and be killed before some step; return the exit status."""
    command = [sys.executable, "-c", WRITE_AND_DIE, str(out), text, str(steps)]
    return subprocess.run(command, check=False).returncode


def write_a_folder(out) -> None:
    with output_folder(out) as made:
        (made / "a").mkdir()
        (made / "b").write_text("new")


def contents(out) -> set[str]:
    return {(out / name).read_text() for name in NAMES}


@pytest.mark.parametrize("exists", [True, False])
def test_a_kill_before_any_step_leaves_the_old_or_the_new_folder(tmp_path, exists):
    out, states = tmp_path / "map", []
    for steps in range(1, 100):
        if exists:
            assert write(out, "old") == 0
            (out / "mine").write_text("kept")
        status = write(out, "new", steps)
        if out.exists():
            finish_moves(out)
            states.append(contents(out))
            assert not exists or (out / "mine").read_text() == "kept"
            assert set(os.listdir(out)) <= {"a", "b", "c", "folder", "mine"}
        else:
            states.append({"nothing"})
        if status == 0:
            break
        if not exists and out.exists():
            (out / "folder" / "d").unlink()
            for name in ("a", "b", "c"):
                (out / name).unlink()
            (out / "folder").rmdir()
            out.rmdir()
    first = {"old"} if exists else {"nothing"}
    news = states.index({"new"})
    assert states[:news] == [first] * news
    assert states[news:] == [{"new"}] * (len(states) - news)
    assert news > 3
    assert status == 0
    assert os.listdir(tmp_path) == ["map"]


def test_the_temporary_folder_of_a_running_process_stays(tmp_path):
    out = tmp_path / "map"
    with output_folder(out) as slow:
        (slow / "a").write_text("slow")
        assert write(out, "quick") == 0
        assert contents(out) == {"quick"}
    assert (out / "a").read_text() == "slow"
    assert (out / "b").read_text() == "quick"


def test_a_file_in_place_of_a_folder_is_an_error_and_nothing_is_moved(tmp_path):
    out = tmp_path / "map"
    assert write(out, "old") == 0
    with pytest.raises(OutputError, match="a is a file"):
        write_a_folder(out)
    assert contents(out) == {"old"}
    assert sorted(os.listdir(tmp_path)) == ["map"]


def test_hidden_folders_of_others_stay(tmp_path):
    (tmp_path / ".map.backup").mkdir()
    with output_folder(tmp_path / "map") as made:
        (made / "a").write_text("")
    assert (tmp_path / ".map.backup").is_dir()


def test_a_file_is_replaced_at_the_end_or_not_at_all(tmp_path):
    path = tmp_path / "deep" / "a.txt"
    with output_file(path) as made:
        made.write_text("old")
        assert not path.exists()

    def fail(error):
        with output_file(path) as made:
            made.write_text("new")
            raise error

    with pytest.raises(KeyError):
        fail(KeyError())
    with pytest.raises(OutputError, match=r"a\.txt: cannot be written"):
        fail(OSError("full"))
    assert path.read_text() == "old"
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]


def test_a_folder_may_be_replaced_as_a_whole(tmp_path):
    out = tmp_path / "out"
    for name in ("one", "two"):
        with output_folder(out, is_replaced=True) as made:
            (made / name).write_text(name)
            (made / "sub").mkdir()
            (made / "sub" / name).write_text(name)
    assert sorted(p.name for p in out.iterdir()) == ["sub", "two"]
    assert [p.name for p in (out / "sub").iterdir()] == ["two"]
