"""The live page of running nodes, over DDS."""

import http.client
import json
import threading
import time

import pytest
from live_robot import START_NS, overrides, recording, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces

pytest.importorskip("aiohttp", reason="aiohttp (the extra 'view') is missing")
pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


PAGES = 10


class Page(threading.Thread):
    """Listens as a browser does."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.entities, self.events, self.status, self.pose, self.ended = {}, [], {}, None, False
        self.later_bytes = 0
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        self._connection.request("GET", "/events")
        self._stream = self._connection.getresponse()
        self.start()

    def run(self):
        while line := self._stream.readline():
            if not line.startswith(b"data: "):
                continue
            delta = json.loads(line[6:])
            self.later_bytes += 0 if delta.get("first") else len(line)
            for name in delta.get("gone", []):
                del self.entities[name]
            self.entities |= delta.get("set", {})
            self.events += delta.get("events", [])
            self.status |= delta.get("status", {})
            self.pose = delta.get("pose", self.pose)
            self.ended = self.ended or delta.get("ended", False)


def ask(page, name, values, answers):
    """Ask in a thread of its own, as the node is spun in this one."""

    def run():
        connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=60)
        connection.request("POST", f"/ask/{name}", json.dumps(values), {"X-Token": page.token})
        answer = connection.getresponse()
        answers.append((answer.status, json.loads(answer.read())))

    threading.Thread(target=run, daemon=True).start()


@pytest.mark.every_distro
def test_a_page_sees_the_map_grow_asks_and_hears_of_the_end(ros, tmp_path):
    from tccm_ros.nodes.view_node import ViewNode

    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path))
    settings = overrides({"view.port": 0})
    view = ros.add(ViewNode(context=ros.another_context(), parameter_overrides=settings))
    page = Page(view.page.port)
    robot = ros.robot()
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, view, "/surface_slam/events", "/surface_slam/surface_map", "/pose")
    robot.play(recording(4), tilt_node, node)

    def tables():
        return [
            s for n, s in page.entities.items() if n[:8] == "surface/" and s["label"] == "table"
        ]

    ros.spin_until(lambda: tables() and page.events and page.pose and page.status.get("ready"))
    [table] = tables()
    # The table of the room: 0.70 m high, its longer side 1.0 m; of the other one view sees a part.
    assert table["height"] == pytest.approx(0.70, abs=0.01)
    assert max(table["size"]) == pytest.approx(1.0, abs=0.1)
    assert page.events[0] == f"appeared: table {table['id']}"
    assert sum(name.startswith("wall/") for name in page.entities) >= 3

    answers = []

    def answered(question, /, **values):
        answers.clear()
        ask(view.page, question, values, answers)
        ros.spin_until(lambda: answers)
        return answers[0]

    status, reply = answered("rename", surface_id=table["id"], label="counter")
    assert (status, reply["message"]) == (200, f"surface {table['id']} was 'table'")
    ros.spin_until(lambda: page.entities[f"surface/{table['id']}"]["label"] == "counter")
    status, reply = answered("placements", surface_id=table["id"], size=[0.1, 0.1, 0.12])
    assert status == 200
    assert reply["placements"][0]["position"][2] == pytest.approx(0.70, abs=0.01)
    assert answered("save", name="home") == (200, {"message": "saved as home"})
    for name, values, why in (
        ("rename", {"surface_id": table["id"], "label": "throne"}, "no label 'throne'"),
        ("rename", {"surface_id": 2**40, "label": "table"}, "expected an id"),
        ("rename", {"surface_id": True, "label": "table"}, "expected an id"),
        ("rename", {"surface_id": 1, "label": 3}, "label must be a string"),
        ("rename", {"label": "table"}, "surface_id is missing"),
        ("placements", {"surface_id": 1, "size": [1, 2]}, "expected (length, width, height)"),
        ("placements", {"surface_id": 1, "size": ["x", 1, 1]}, "could not convert"),
        ("name", {"surface_id": 1, "name": 3}, "name must be a string"),
        ("name", {"surface_id": 1, "name": "a", "spot": [1]}, "expected (x, y)"),
        ("name", {"surface_id": 1, "name": "a", "spot": ["x", 1]}, "could not convert"),
        ("name", {"surface_id": 1, "name": "a"}, "nobody answers"),
        ("save", {"name": "../../etc/passwd"}, "cannot be the name of a map"),
        ("save", {"name": "home"}, "overwrite"),
    ):
        status, reply = answered(name, **values)
        assert (status, why in reply["error"]) == (400, True), reply
    assert {path.name for path in tmp_path.iterdir()} == {"home"}
    view.close()
    page.join(20)
    assert page.ended


def test_ten_pages_and_a_viewer_show_the_same_and_no_scan_is_dropped(ros, tmp_path):
    """The short form of bench/bench_live_page.py."""
    pytest.importorskip("datafusion", reason="rerun's dataframes need rerun-sdk[catalog]")
    from rerun_server import RerunServer, free_port, rows

    from tccm_ros.nodes.view_node import ViewNode

    viewer_port = free_port()
    server = RerunServer(viewer_port, tmp_path / "live.rrd")
    tilt_node, node = tccm(ros), slam(ros)
    settings = {"view.port": 0, "view.rerun": f"rerun+http://127.0.0.1:{viewer_port}/proxy"}
    view = ros.add(ViewNode(context=ros.another_context(), parameter_overrides=overrides(settings)))
    pages, begin_s = [Page(view.page.port) for _ in range(PAGES)], time.monotonic()
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, view, "/surface_slam/events", "/surface_slam/surface_map", "/pose")
    ros.robot().play(recording(4), tilt_node, node)
    ros.spin_until(lambda: all(p.entities.keys() >= {"surface/1", "wall/0"} for p in pages))
    first = pages[0]
    ros.spin_until(lambda: all(p.entities == first.entities and p.pose for p in pages))
    # 50 kB/s to a page; a second's worth may be saved up before the first of them.
    limit = 50_000 * (time.monotonic() - begin_s + 1.0)
    assert 0 < max(page.later_bytes for page in pages) <= limit
    for mapping in (tilt_node, node):
        assert not mapping.dropped, mapping.dropped
    view.close()
    server.close()
    stamps, [name, *_] = rows(server.store(), "/map/surfaces/1/name", "Points3D:labels")
    assert name[0].startswith(first.entities["surface/1"]["label"])
    assert stamps[0] == pytest.approx(START_NS * 1e-9, abs=10.0)
    assert len(rows(server.store(), "/map/base", "Transform3D:translation")[0])
