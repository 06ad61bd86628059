"""The thread that saves solutions does not hold up the end of the process."""

import os
import threading
from types import SimpleNamespace

import pytest

from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.saving.saves import Saves
from tccm_ros.nodes.saving.solution_saver import MapKeeper, Session, SolutionSaver, Wanted


class SlowSolver:
    """A solver whose next solution never comes."""

    newest = SimpleNamespace(resets=0, duration_s=1e6)

    def __init__(self):
        self.is_asked = threading.Event()

    def wait(self, number, timeout_s=None):
        self.is_asked.set()
        threading.Event().wait(timeout_s)
        return False


def test_a_save_that_waits_for_a_solution_does_not_hold_up_the_end(monkeypatch, tmp_path):
    saved = []
    monkeypatch.setattr("tccm_ros.nodes.saving.solution_saver.MAX_PATIENCE_S", 1e6)
    monkeypatch.setattr(
        SolutionSaver, "_save", lambda self, *_, is_asked, **__: saved.append(is_asked) or "map"
    )
    solver, ending = SlowSolver(), Ending()
    session = Session(resets=0, keyframes=1, waits_for_scan=False)
    saver = SolutionSaver(
        solver, lambda: session, Saves("slam", print), lambda name: None, lambda error: None
    )
    wanted = Wanted(stamp_ns=0, number=2)
    asked = saver.begin(SimpleNamespace(executor=None), tmp_path, lambda note: note(wanted))
    assert solver.is_asked.wait(60.0)
    saver.save_quickly(tmp_path, wanted, ending.begin())
    saver.close()
    assert saved == [True, False]  # the requested one, then that of the end
    assert asked.result() == "map"
    assert (ending.status, ending.saved) == (0, {"slam": "map"})


class LoadedMap:
    """A solver whose newest solution is that of a loaded map: it has no stamp."""

    newest = SimpleNamespace(
        resets=0, duration_s=0.1, number=1, stamp_ns=0, content="16 surfaces and 40 keyframes"
    )

    def wait(self, number, timeout_s=None):
        return True

    def archive(self):
        return self.newest, os.open(os.devnull, os.O_RDONLY)


@pytest.mark.parametrize(
    ("stamp_ns", "said"),
    [(5, "; nothing of this drive is in it, only the map that was loaded"), (0, "")],
)
def test_a_save_before_the_first_solution_of_a_drive_says_so(monkeypatch, tmp_path, stamp_ns, said):
    monkeypatch.setattr(MapKeeper, "save", lambda self, archive, content, folder, **_: folder)
    session = Session(resets=0, keyframes=1, waits_for_scan=False)
    saver = SolutionSaver(
        LoadedMap(), lambda: session, Saves("slam", print), lambda name: None, lambda error: None
    )
    ending = Ending()
    saver.save_at_end(tmp_path, Wanted(stamp_ns=stamp_ns, number=1), ending.begin())
    saver.close()
    words = "solution 1, 16 surfaces and 40 keyframes"
    assert ending.saved == {"slam": f"{tmp_path}: {words}{said}"}
