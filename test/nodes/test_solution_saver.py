"""The thread that saves solutions does not hold up the end of the process."""

import threading
from types import SimpleNamespace

from tccm_ros.nodes.ending import Ending
from tccm_ros.nodes.saves import Saves
from tccm_ros.nodes.solution_saver import Session, SolutionSaver, Wanted


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
    monkeypatch.setattr("tccm_ros.nodes.solution_saver.MAX_PATIENCE_S", 1e6)
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
