"""A browser on the live page, while nodes map a part of bags/flat."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml
from bag_player import play_bag
from chromium import Browser
from live_robot import overrides, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces

pytest.importorskip("aiohttp", reason="aiohttp (the extra 'view') is missing")
pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

FLAT = Path(__file__).resolve().parents[2] / "bags" / "flat"
LOOK_S, MORE_S = 6.0, 13.0
"""Parts of the bag: the first view, at 2.5 s, has a table, the second, at 15.4 s, a seat."""


IS_OBJECT_ON_SURFACE = """tccmLive.ofKind('object').every((o) => {
    const { v } = tccmLive.entities.get(`surface/${o.surface}`).shape;
    const middle = (k) => o.corners.reduce((s, c) => s + c[k], 0) / o.corners.length;
    return o.corners.length === 4 && [0, 1].every((k) => {
        const along = v.filter((_, i) => i % 3 === k);
        return Math.min(...along) <= middle(k) && middle(k) <= Math.max(...along);
    });
})"""
"""Whether the middle of each object on the page is within the bounds of its surface."""


class Page:
    """A browser in a thread of its own, while the nodes are spun in this one."""

    def __init__(self, ros, browser):
        self.ros, self.browser, self.pool = ros, browser, ThreadPoolExecutor(1)

    def run(self, call, *args):
        done = self.pool.submit(call, *args)
        self.ros.spin_until(done.done, what=str(args))
        return done.result()

    def wait(self, condition):
        self.run(self.browser.wait_for, condition)

    def value(self, expression):
        return self.run(self.browser.evaluate, expression)

    def click(self, selector):
        self.run(self.browser.click, selector)

    def click_at(self, point):
        """Click where a point of the map (x, y, z), a JavaScript expression, is shown."""
        x, y = self.value(
            "(() => { const { canvas } = tccmLive.report, v = tccmLive.report.view();"
            f"const p = [...{point}, 1], box = canvas.getBoundingClientRect();"
            "const [x, y, , w] = [0, 1, 2, 3].map((r) => p.reduce((s, c, i) => "
            "s + c * v.matrix[4 * i + r], 0));"
            "return [box.x + (x / w + 1) / 2 * box.width, box.y + (1 - y / w) / 2 * box.height];"
            "})()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.run(lambda k=kind: self.browser.mouse(k, x, y, button="left", clickCount=1))

    def text(self, selector):
        return self.value(f"document.querySelector('{selector}').textContent")

    def answer(self, selector):
        """Return what the page says after a click on a button."""
        self.value("document.querySelector('#answer').textContent = ''")
        self.click(selector)
        self.wait("!['', '...'].includes(document.querySelector('#answer').textContent)")
        return self.text("#answer")


@pytest.fixture
def page(ros, tmp_path):
    with Browser(tmp_path / "profile", 1100, 900) as browser:
        made = Page(ros, browser)
        yield made
        made.pool.shutdown()


def serve(ros, port=0):
    from tccm_ros.nodes.view_node import ViewNode

    settings = overrides({"view.port": port})
    return ros.add(ViewNode(context=ros.another_context(), parameter_overrides=settings))


def test_a_user_sees_the_flat_grow_corrects_asks_and_names(ros, page, tmp_path):
    from tccm_ros.nodes.approach_node import ApproachNode

    names = tmp_path / "names.yaml"
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path / "maps"))
    view = serve(ros)
    settings = overrides({"approach.names": str(names), "approach.reach": 0.9})
    driver = ros.add(ApproachNode(context=ros.another_context(), parameter_overrides=settings))
    for topic in ("surfaces", "view", "object_boxes"):
        ros.connect(tilt_node, node, f"/tccm/{topic}")
    ros.connect(node, view, "/surface_slam/events", "/surface_slam/surface_map", "/pose")
    ros.connect(node, driver, "/surface_slam/surface_map")
    page.run(lambda: page.browser.call("Page.navigate", url=view.page.url))
    page.wait("window.tccmLive")
    assert page.value("tccmLive.ofKind('surface').length") == 0

    play_bag(ros, FLAT, tilt_node, node, duration=LOOK_S)
    page.wait("tccmLive.ofKind('surface').some((s) => s.label === 'table')")
    page.wait("tccmLive.pose && tccmLive.report.frames > 0")
    seen = page.value("tccmLive.ofKind('surface').length")
    play_bag(ros, FLAT, tilt_node, node, start=LOOK_S, duration=MORE_S)
    page.wait(f"tccmLive.ofKind('surface').length > {seen}")
    page.wait("document.querySelector('#events').textContent.includes('appeared: ')")

    # A click near a corner of the table, where nothing is on it, picks it.
    page.value("tccmLive.report.camera.set(tccmLive.report.camera.above)")
    number = page.value("tccmLive.ofKind('surface').find((s) => s.label === 'table').id")
    page.value(f"window.table = tccmLive.entities.get('surface/{number}')")
    page.click_at("table.at.map((v, i) => 0.2 * v + 0.8 * table.shape.v[i])")
    page.wait("document.querySelector('#picked').textContent.startsWith('table ')")
    picked, spot = page.value("[tccmLive.picked, tccmLive.spot]")
    assert picked == number
    middle, corner = page.value("[table.at, table.shape.v.slice(0, 3)]")
    assert spot[2] == pytest.approx(0.74, abs=0.01)
    # A pixel is 1 to 2 cm wide.
    assert spot == pytest.approx([0.2 * m + 0.8 * c for m, c in zip(middle, corner)], abs=0.05)

    page.value("document.querySelector('#label').value = 'counter'")
    assert page.answer("#rename button") == f"surface {number} was 'table'"
    page.wait(f"tccmLive.entities.get('surface/{number}').label === 'counter'")
    assert page.answer("#placement button").startswith("put it at ")
    page.wait("tccmLive.found")
    page.wait("!document.querySelector('#naming').hidden")
    page.value("document.querySelector('#spot').value = 'flat/plate'")
    assert page.answer("#naming button") == "flat/plate: a new name"
    assert yaml.safe_load(names.read_text())["flat/plate"]["ids"] == [number]
    page.value("document.querySelector('#spot').value = 'no name'")
    assert "is no name" in page.answer("#naming button")

    # Everything on the table is drawn within it.
    assert page.value(f"tccmLive.ofKind('object').filter((o) => o.surface === {number}).length")
    assert page.value(IS_OBJECT_ON_SURFACE)
    assert page.value(f"tccmLive.entities.get('free/{number}').rings.length > 0")
    page.wait("document.querySelector('#diagnostics').textContent.includes('surface_slamOK: ok')")
    assert page.answer("#save button") == "saved as map"
    assert (tmp_path / "maps" / "map" / "surfaces.json").is_file()

    # A reload shows all of it.
    entities = "JSON.stringify([...tccmLive.entities].sort())"
    before = page.value(entities)
    page.run(lambda: page.browser.call("Page.reload"))
    page.wait(f"window.tccmLive && {entities} === {before!r}")
    page.wait("document.querySelector('#events').textContent.includes('appeared: ')")

    # The page's node is started again: the page comes back with the whole map.
    port, before = view.page.port, page.value("[...tccmLive.entities.keys()].sort()")
    view.close()
    page.wait("document.querySelector('#headline').textContent.startsWith('the node has ended')")
    ros.remove(view)
    again = serve(ros, port)
    page.wait("!document.querySelector('#headline').classList.contains('lost')")
    page.wait(f"tccmLive.entities.size >= {len(before)}")
    assert page.value("[...tccmLive.entities.keys()].sort()") == before
    assert "the token is wrong" in page.answer("#save button")
    again.close()
    driver.close()


NOTE_HEADLINES = (
    "window.headlines = []; new MutationObserver(() => headlines.push("
    "document.querySelector('#headline').textContent)).observe("
    "document.querySelector('#headline'), {childList: true}); true"
)


def test_a_page_survives_a_restart_of_slam_node(ros, page):
    tilt_node, node, view = tccm(ros), slam(ros), serve(ros)

    def connect(node):
        for topic in ("surfaces", "view", "object_boxes"):
            ros.connect(tilt_node, node, f"/tccm/{topic}")
        ros.connect(node, view, "/surface_slam/events", "/surface_slam/surface_map", "/pose")

    def labels():
        """Return the labels of the surfaces that the page has."""
        return set(page.value("tccmLive.ofKind('surface').map((s) => s.label)"))

    connect(node)
    page.run(lambda: page.browser.call("Page.navigate", url=view.page.url))
    play_bag(ros, FLAT, tilt_node, node, duration=LOOK_S)
    page.wait("window.tccmLive && tccmLive.ofKind('surface').some((s) => s.label === 'table')")
    page.wait("document.querySelector('#headline').textContent.includes('tracking')")
    page.value(NOTE_HEADLINES)
    first = page.value("Math.max(...tccmLive.ofKind('surface').map((s) => s.last))")
    ros.remove(node)
    page.wait("document.querySelector('#headline').classList.contains('lost')")
    assert page.text("#headline") == "slam_node does not run"
    assert "table" in labels(), "the last map stays in view"
    # The new node has no map: it has that of the second view alone, without the table.
    again = slam(ros)
    connect(again)
    page.wait("!document.querySelector('#headline').classList.contains('lost')")
    play_bag(ros, FLAT, tilt_node, again, start=LOOK_S, duration=MORE_S)
    page.wait("tccmLive.ofKind('surface').some((s) => s.label === 'seat')")
    page.wait("document.querySelector('#headline').textContent.includes('tracking')")
    newest = again.solver.newest.stamp_ns * 1e-9
    page.wait(f"tccmLive.ofKind('surface').every((s) => s.last <= {newest + 1.0})")
    shown = page.value("tccmLive.ofKind('surface').map((s) => s.first)")
    assert shown
    assert min(shown) > first, "surfaces of the new map alone"
    assert "table" not in labels()
    # They are drawn, too: each label of the picture is of a surface of the new map.
    page.wait("!tccmLive.report.waiting")
    drawn = page.value(
        "[...document.querySelectorAll('#labels span.surface')].map((s) => s.textContent)"
    )
    assert any(text.startswith("seat ") for text in drawn), drawn
    assert not any(text.startswith("table ") for text in drawn), drawn
    headlines = page.value("headlines")
    ended = headlines.index("slam_node does not run")
    assert all("tracking" in text for text in headlines[:ended]), headlines
    assert "tracking" in headlines[-1], headlines
    assert page.text("#headline") == headlines[-1]
    view.close()
