"""`tccm view` of a folder that a replay is writing."""

import json
import threading
from pathlib import Path

import pytest
from chromium import Browser

from tccm_ros.config import Config
from tccm_ros.records import Posed
from tccm_ros.replay.replay import replay
from tccm_ros.replay.unfinished_maps import is_running, newest_map, running_replay

pytest.importorskip("aiohttp", reason="aiohttp (the extra 'view') is missing")

from tccm_ros.view.replay_page import entities_of_results, show_replay

BAG = Path(__file__).resolve().parents[2] / "bags" / "walkthrough"
LOOK_S = 1.0
"""Period of the check that the replay still runs."""

OFFER_NS = 2_000_000_000
"""Time of the recording between two maps, ns: some before each gate."""


class Gate:
    """A watcher that holds a replay at given times of its recording until they are passed."""

    def __init__(self, *times_s):
        self.gates = [(int(t * 1e9), threading.Event(), threading.Event()) for t in times_s]
        self.start_ns = None

    def add(self, event):
        if not isinstance(event, Posed):
            return
        self.start_ns = self.start_ns or event.stamp_ns
        while self.gates and event.stamp_ns - self.start_ns > self.gates[0][0]:
            _, reached, passed = self.gates[0]
            reached.set()
            passed.wait()
            self.gates.pop(0)

    def finish(self, outcome, parts):
        pass


class Replay:
    """A replay in a thread; after an error of the test it runs to its end."""

    def __init__(self, out, *times_s, bag=BAG):
        self.gate, self.failure = Gate(*times_s), None
        self.gates = list(self.gate.gates)
        self.thread = threading.Thread(target=self._run, args=(bag, out))

    def _run(self, bag, out):
        try:
            replay(bag, out, Config(), pictures=False, watcher=self.gate)
        except Exception as error:
            self.failure = error

    def __enter__(self):
        self.thread.start()
        return self

    def wait_for(self, number):
        while not self.gates[number][1].wait(LOOK_S):
            assert self.thread.is_alive(), self.failure

    def go_on(self, number):
        self.gates[number][2].set()

    def __exit__(self, *_):
        for number in range(len(self.gates)):
            self.go_on(number)
        self.thread.join()
        assert self.failure is None


@pytest.fixture(autouse=True)
def _maps_at_once(monkeypatch):
    """A map whenever it is offered: a replay that is held offers none when its pause is over."""
    monkeypatch.setattr("tccm_ros.replay.run.PROGRESS_STEP_NS", OFFER_NS)
    monkeypatch.setattr("tccm_ros.replay.unfinished_maps.MIN_PERIOD_S", 0.0)
    monkeypatch.setattr("tccm_ros.replay.unfinished_maps.MAX_FRACTION", 1.0)


def test_page_shows_a_growing_replay_and_changes_no_results(session_files, tmp_path):
    out, urls = tmp_path / "out", []
    assert running_replay(out) is None
    with Replay(out, 1.0, 7.0, 17.0) as run, Browser(tmp_path / "profile", 1100, 900) as browser:
        run.wait_for(0)
        maps = running_replay(out)
        assert maps is not None
        assert not any(maps.iterdir()), "a map was made though nobody looks"
        shown = threading.Thread(target=show_replay, args=(maps, urls.append))
        shown.start()
        while not urls:
            assert shown.is_alive()
        browser.call("Page.navigate", url=urls[0])
        run.go_on(0)
        run.wait_for(1)
        browser.wait_for("window.tccmLive && tccmLive.entities.size > 2 && tccmLive.pose")
        seen = browser.evaluate("tccmLive.pose")
        assert browser.evaluate("document.querySelector('#map').hidden")
        run.go_on(1)
        run.wait_for(2)
        browser.wait_for(f"JSON.stringify(tccmLive.pose) !== '{json.dumps(seen, separators=',:')}'")
        browser.wait_for("tccmLive.ofKind('surface').length > 1")
        assert "replay at " in browser.evaluate("document.querySelector('#headline').textContent")
        run.go_on(2)
        run.thread.join()
        shown.join()
        browser.wait_for("document.querySelector('#headline').classList.contains('lost')")
        complaints = [line for line in map(str, browser.complaints()) if "net::ERR" not in line]
        assert not complaints
    assert not is_running(maps)
    assert running_replay(out) is None
    alone = session_files.replayed("walkthrough")
    for file in ("surfaces.json", "walls.json", "objects.json", "trajectory.tum"):
        assert (out / file).read_bytes() == (alone / file).read_bytes()
    assert {path.name for path in out.iterdir()} == {path.name for path in alone.iterdir()}


def test_a_killed_replay_is_not_shown(tmp_path):
    (tmp_path / ".out.tccm-new-abc" / "maps" / "3").mkdir(parents=True)
    assert running_replay(tmp_path / "out") is None
    assert newest_map(tmp_path / ".out.tccm-new-abc" / "maps", 0) is None


def test_entities_have_the_fields_that_a_page_draws(flat):
    from tccm_ros.results.folder_reader import load_results

    results = load_results(flat)
    found = entities_of_results(results)
    kinds = [name.partition("/")[0] for name in found]
    for kind, values in (
        ("surface", results.surfaces),
        ("wall", results.walls),
        ("object", results.objects),
        ("sign", results.signs),
    ):
        assert kinds.count(kind) == len(values), kind
    assert found["path"]["length"] == pytest.approx(results.trajectory.length, abs=0.01)
    json.dumps(found, allow_nan=False)
