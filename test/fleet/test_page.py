"""The page of a fleet: one file, escaped, sortable; of 10,000 rows those in view are drawn."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from chromium import Browser
from PIL import Image

from tccm_ros.config import Config
from tccm_ros.fleet.layout import RECORD, FleetFolder
from tccm_ros.fleet.page import RecordingRow, fleet_rows, page_text, write_page
from tccm_ros.fleet.record import Cost, DoneRecord, Failure, settings_checksum, software_checksum
from tccm_ros.results.models import CountsEntry, ScansUsedEntry
from tccm_ros.results.numbers import write_json

COUNT = 10_000


def counts(surfaces):
    return CountsEntry({}, ScansUsedEntry(1, 1), {"late": 2}, 1, 1, 1, 4, 5, 0, surfaces, 0, 3)


def record(source, surfaces):
    return DoneRecord(
        source, software_checksum(), settings_checksum(Config()), "0", (), counts(surfaces),
        12.5, 1_600_000_000.0, Cost(3.5, 3.0, 0, 1, 1),
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A fleet of three: one done, one failed, one done before and failed now."""
    fleet = FleetFolder(tmp_path / "fleet")
    for name in ("run-1", "run-3"):
        fleet.results(name).mkdir(parents=True)
        write_json(fleet.results(name) / RECORD, record(f"/bags/{name}", 7))
    Image.new("RGB", (60, 40), (200, 30, 30)).save(fleet.results("run-1") / "map.png")
    for name in ("run-2", "run-3"):
        write_json(fleet.failure(name), Failure(f"/bags/{name}", "the file is cut off"))
    return fleet


def rows(count=COUNT):
    made = [
        RecordingRow(f"run-{k:05d}", f"/archive/run_{k}.mcap", "done", "", True, False,
            1.6e9 + k, 60.0, (k * 7919) % 1000, k % 17, k % 23, k % 5, 0, 4.0)
        for k in range(count)
    ]  # fmt: skip
    made[5] = replace(made[5], state="failed", reason="cut off", surfaces=None, has_results=False)
    return made


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_text(page_text(rows(), "hospital"))
    with Browser(tmp_path_factory.mktemp("profile"), 1280, 800) as browser:
        browser.open(path)
        browser.wait_for("window.tccmFleet && tccmFleet.view.draws > 0")
        yield browser


def names(page):
    return page.evaluate(
        "[...document.querySelectorAll('.row .name :first-child')].map((e) => e.textContent)"
    )


def test_rows_are_of_the_records_and_failures(folder):
    done, failed, was_done = fleet_rows(folder)
    assert (done.name, done.state, done.surfaces, done.dropped) == ("run-1", "done", 7, 2)
    assert (done.has_results, done.pictures) == (True, True)
    assert (failed.name, failed.state, failed.has_results) == ("run-2", "failed", False)
    assert failed.reason == "/bags/run-2: the file is cut off"
    assert (was_done.state, was_done.has_results) == ("failed", True)


def test_the_page_is_one_file_that_loads_nothing_from_elsewhere(folder):
    text = write_page(folder).read_text()
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!data:)""", text)
    assert not re.search(r"https?://|@import|url\(", text)
    assert write_page(folder).read_text() == text


def test_text_of_recordings_is_escaped():
    evil = "</script><script>alert(1)</script>"
    text = page_text([replace(rows(9)[0], source=evil, reason=evil)], evil)
    assert "<script>alert" not in text
    data = re.search(r'<script id="data"[^>]*>(.*?)</script>', text)[1]
    assert json.loads(data)["rows"][0][1] == evil


def test_only_the_rows_in_view_are_in_the_document(page):
    assert 10 < len(names(page)) < 40
    assert page.evaluate("document.getElementById('scroll').scrollHeight") >= COUNT * 60
    assert page.complaints() == []


def test_a_step_of_scrolling_draws_the_rows_in_view_alone(page):
    max_rows = page.evaluate("""(async () => {
        const scroll = document.getElementById('scroll'), rows = document.getElementById('rows');
        let max_rows = 0;
        for (let k = 0; k <= 100; k++) {
            scroll.scrollTop = k / 100 * scroll.scrollHeight;
            scroll.dispatchEvent(new Event('scroll'));
            const first = Math.floor(scroll.scrollTop / 64);
            const { view } = tccmFleet;
            if (view.first > first || view.last <= first) throw Error(`row ${first} is not drawn`);
            max_rows = Math.max(max_rows, rows.childElementCount);
            await new Promise((done) => requestAnimationFrame(done));
        }
        return max_rows; })()""")
    assert max_rows < 40
    assert f"run-{COUNT - 1:05d}" in names(page)
    page.evaluate("document.getElementById('scroll').scrollTop = 0")
    page.wait_for("tccmFleet.view.first === 0")


@pytest.mark.parametrize("key", ["name", "surfaces", "duration", "start"])
def test_a_click_on_a_title_sorts_and_another_one_reverses(page, key):
    column = [getattr(row, key) for row in rows() if getattr(row, key) is not None]
    seen = []
    for _ in range(2):
        page.click(f"#sort-{key}")
        seen.append(page.evaluate(
            f"tccmFleet.view.order.map((row) => row[tccmFleet.data.columns.indexOf('{key}')])"
        ))  # fmt: skip
    known = [[value for value in values if value is not None] for values in seen]
    assert sorted(map(tuple, known)) == sorted([tuple(sorted(column)),
                                                tuple(sorted(column, reverse=True))])  # fmt: skip
    if key == "surfaces":
        assert seen[0][-1] is seen[1][-1] is None, "what is not known is last"


def test_failures_and_words_are_found(page):
    page.click("#only-failed")
    assert names(page) == ["run-00005"]
    page.click("#only-failed")
    page.evaluate("""(() => { const s = document.getElementById('search'); s.value = 'RUN_123.';
        s.dispatchEvent(new Event('input')); })()""")
    assert names(page) == ["run-00123"]
    page.evaluate("""(() => { const s = document.getElementById('search'); s.value = '';
        s.dispatchEvent(new Event('input')); })()""")
    assert page.complaints() == []


def test_a_picture_of_a_recording_is_shown(folder, tmp_path):
    with Browser(tmp_path / "profile", 1280, 400) as browser:
        browser.open(write_page(folder))
        browser.wait_for("document.querySelector('.row img')?.naturalWidth === 60")
        image = np.asarray(Image.open(browser.screenshot(tmp_path / "page.png")).convert("RGB"))
        reports = browser.evaluate("[...document.querySelectorAll('.row a')].map((a) => a.href)")
        assert browser.complaints() == []
    assert (np.abs(image.astype(int) - (200, 30, 30)).max(axis=2) < 12).sum() > 500
    assert [link.rsplit("/", 2)[1:] for link in reports] == [["run-1", "report.html"],
                                                            ["run-3", ""]]  # fmt: skip
