"""report.html: one file, repeatable, escaped, and interactive in a real browser."""

import base64
import json
import re
import zlib

import numpy as np
import pytest
from chromium import Browser
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from result_folder import write_folder

from tccm_ros.errors import OutputError
from tccm_ros.report import palette
from tccm_ros.report.array_pack import ArrayPack, differences
from tccm_ros.report.html_report import LAYERS, TIMING_END, TIMING_START, write_report
from tccm_ros.results.folder_reader import load_results


@pytest.fixture(scope="module")
def report(flat):
    return write_report(flat)


@pytest.fixture(scope="module")
def opened(report, tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile"), 900, 760) as browser:
        browser.open(report)
        browser.wait_for("window.tccmReport && tccmReport.frames > 0")
        yield browser


@pytest.fixture
def page(opened):
    """Return the page as it opened, without cuboids.

    A processor that stands in for the graphics card takes its time over those.
    """
    for name, (_, on) in LAYERS.items():
        opened.evaluate(f"tccmReport.setLayer('{name}', {json.dumps(on and name != 'cuboids')})")
    opened.evaluate("tccmReport.setCycle(24)")
    opened.evaluate("tccmReport.camera.set(tccmReport.camera.home)")
    return opened


def still(page):
    """Wait until nothing is left to draw."""
    page.wait_for("!tccmReport.waiting")


def test_writing_again_gives_the_same_bytes(flat, report):
    before = report.read_bytes()
    assert write_report(flat).read_bytes() == before


def test_only_the_timing_differs_between_runs(flat_copy, report):
    timing = {"seconds": {"reading": 0.9}, "real_time_factor": 11.0}
    (flat_copy / "timing.json").write_text(json.dumps(timing))
    cut = re.compile(re.escape(TIMING_START) + ".*?" + re.escape(TIMING_END), re.DOTALL)
    a, b = (p.read_text(encoding="utf-8") for p in (report, write_report(flat_copy)))
    assert a != b
    assert cut.sub("", a) == cut.sub("", b)


def test_the_page_loads_nothing_from_elsewhere(report):
    text = report.read_text(encoding="utf-8")
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!data:)""", text)
    assert not re.search(r"https?://|@import|url\((?!data:)", text)


def test_text_from_files_is_escaped(flat_copy):
    evil = "</script><script>alert(1)</script><b>&\"'"
    for name in ("surfaces.json", "summary.json", "timing.json", "graph.json", "signs.json"):
        tree = json.loads((flat_copy / name).read_text())
        if name == "surfaces.json":
            tree["surfaces"][3]["label"] = evil
        elif name == "graph.json":
            tree["loops"][0]["reason"] = evil
        elif name == "signs.json":
            tree["signs"][0]["text"] = evil
        elif name == "timing.json":
            tree["seconds"][evil] = 1.0
        else:
            tree["counts"]["dropped"][evil] = 1
            tree["versions"][evil] = evil
        (flat_copy / name).write_text(json.dumps(tree))
    text = write_report(flat_copy).read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert text.count("&lt;/script&gt;&lt;script&gt;") >= 7


def test_a_folder_with_the_required_files_alone_has_a_report(flat_copy):
    for name in ("planes.json", "cycles.npz", "cuboids.npz", "objects.json", "timing.json",
                 "summary.json", "graph.json", "signs.json", "racks.json"):  # fmt: skip
        (flat_copy / name).unlink()
    assert TIMING_START not in write_report(flat_copy).read_text(encoding="utf-8")


def test_a_path_that_cannot_be_written_is_an_error(flat_copy):
    (flat_copy / "report.html").unlink(missing_ok=True)
    (flat_copy / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html: cannot be written"):
        write_report(flat_copy)


def test_the_page_draws_without_errors_in_the_browser(page, tmp_path, flat):
    page.evaluate("tccmReport.setLayer('cuboids', true)")
    still(page)
    assert page.complaints() == []
    width, height = page.evaluate("[tccmReport.canvas.width, tccmReport.canvas.height]")
    assert width > 600
    assert height > 300
    image = np.asarray(Image.open(page.screenshot(tmp_path / "report.png")).convert("RGB"))
    table = np.array(palette_rgb(flat, 3)) * 0.86 + 255 * 0.14
    near = np.abs(image - table).max(axis=2) < 40
    assert near.sum() > 200


def palette_rgb(flat, index):
    colors = palette.surface_colors(load_results(flat).surfaces)
    return [int(colors[index][i : i + 2], 16) for i in (1, 3, 5)]


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_can_be_hidden_and_shown(page, name):
    page.evaluate(f"tccmReport.setLayer('{name}', true)")
    page.evaluate(f"tccmReport.setCycle({9 if name in ('planes', 'other_planes') else 24})")
    before = shown(page)
    page.click(f"#layer-{name}")
    assert shown(page) != before
    page.click(f"#layer-{name}")
    assert shown(page) == before
    assert page.complaints() == []


def shown(page):
    """Return the content of the canvas and the number of labels as one value to compare."""
    still(page)
    return page.evaluate("""(() => {
        tccmReport.draw();
        const { gl, canvas } = tccmReport;
        const pixels = new Uint32Array(canvas.width * canvas.height);
        gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE,
                      new Uint8Array(pixels.buffer));
        let sum = 2166136261;
        for (const pixel of pixels) sum = Math.imul(sum ^ pixel, 16777619);
        const labels = [...document.querySelectorAll('#labels span')].filter((s) => !s.hidden);
        return `${sum} ${labels.length}`;
    })()""")


def test_the_slider_shows_the_map_of_each_cycle(page):
    seen = []
    for cycle in range(24):
        page.evaluate(f"tccmReport.setCycle({cycle})")
        look = page.evaluate(
            "(() => { const l = tccmReport.cuboidLook(); const c = l.set.cycle;"
            "return [c[l.first], c[l.first + l.count - 1]]; })()"
        )
        seen.append(look)
    assert seen == [[max(0, k - 9), k] for k in range(24)]
    assert "cycle 23" in page.evaluate("document.getElementById('cycle-text').textContent")
    assert page.complaints() == []


def test_pointing_at_a_table_shows_its_values(page):
    page.evaluate("tccmReport.setLayer('path', false)")
    still(page)
    x, y = page.evaluate("""(() => {
        const table = tccmReport.scene.surfaces.find((s) => s.id === 3);
        const { canvas } = tccmReport;
        const v = tccmReport.view();
        const m = v.matrix, [a, b, c] = [table.at[0] + 0.3, table.at[1], table.at[2]];
        const p = [0, 1, 3].map((r) => m[r] * a + m[4 + r] * b + m[8 + r] * c + m[12 + r]);
        const box = canvas.getBoundingClientRect();
        const [right, up] = [p[0] / p[2], p[1] / p[2]];
        return [box.x + (right + 1) / 2 * box.width, box.y + (1 - up) / 2 * box.height];
    })()""")
    page.mouse("mouseMoved", x, y)
    page.wait_for("!document.getElementById('hover').hidden")
    text = page.evaluate("document.getElementById('hover').innerText")
    assert "table (surface 3)" in text
    assert "0.740 m" in text
    assert "1.26 m²" in text
    assert re.search(r"views\s+3", text)


def test_dragging_rotates_the_view(page):
    before = page.evaluate("tccmReport.camera.azimuth")
    x, y = page.evaluate(
        "(() => { const b = tccmReport.canvas.getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    page.mouse("mousePressed", x, y, button="left", buttons=1, clickCount=1)
    page.mouse("mouseMoved", x + 80, y, button="left", buttons=1)
    page.mouse("mouseReleased", x + 80, y, button="left", clickCount=1)
    assert page.evaluate("tccmReport.camera.azimuth") < before - 0.2
    assert page.complaints() == []


def test_the_report_of_fifty_cycles_is_small(tmp_path_factory):
    folder = write_folder(tmp_path_factory.mktemp("big") / "flat", cycles=50, max_range=4.0)
    results = load_results(folder)
    assert len(results.cycles) == 50
    assert write_report(folder).stat().st_size < 15e6


@given(st.lists(st.integers(-32000, 32000), max_size=30))
def test_packed_differences_sum_to_the_values(values):
    pack = ArrayPack()
    pack.add(np.zeros(3), "f4")
    kind, offset, count = pack.add(differences(np.array(values, np.int64)), "i2")
    assert (kind, offset, count) == ("i2", 16, len(values))
    content = zlib.decompress(base64.b64decode(pack.text()))
    steps = np.frombuffer(content, "<i2", count, offset)
    assert np.cumsum(steps, dtype=np.int16).tolist() == values
