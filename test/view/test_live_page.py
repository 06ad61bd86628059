"""The live page's server: what it tells, what it refuses, and what a browser makes of it."""

import asyncio
import http.client
import json
import os
import random
import socket

import numpy as np
import pytest
from chromium import Browser

from tccm_ros.errors import OutputError, RequestError
from tccm_ros.view.live_state import path_entity, surface_entity

pytest.importorskip("aiohttp", reason="aiohttp (the extra 'view') is missing")

from tccm_ros.view.live_page import LivePage

QUESTIONS = frozenset({"rename", "placements", "save"})
SQUARE = np.array([[0.0, 0, 0.7], [1.2, 0, 0.7], [1.2, 0.8, 0.7], [0, 0.8, 0.7]])
UP = np.array([0.0, 0, 1])
REQUESTS = int(os.environ.get("TCCM_REQUESTS", "2000"))


def surface(number, label="table", shift=0.0):
    facts = {"id": number, "label": label, "height": 0.7, "size": [1.2, 0.8], "area": 0.96,
             "views": 3, "points": 900, "std": 0.002,
             "first": 5.0, "last": 9.0, "room": "12"}  # fmt: skip
    ring = SQUARE + np.array([shift, 0.0, 0.0])
    return surface_entity(facts, ring, [], UP, ring.mean(axis=0).tolist())


WORLD = {"ground": 0.0, "start": 0.0, "extent": [[-1.0, -1.0], [4.0, 3.0]]}
MAP = {
    "world": WORLD,
    "surface/3": surface(3),
    "wall/0": {"id": 0, "ends": [[-0.5, -0.5], [3.0, -0.5]], "length": 3.5, "observations": 9},
    "object/7": {"id": 7, "surface": 3, "on": "table (surface 3)", "size": [0.1, 0.1, 0.2],
                 "corners": [[0.1, 0.1], [0.2, 0.1], [0.2, 0.2], [0.1, 0.2]],
                 "low": 0.7, "high": 0.9},
    "sign/2": {"id": 2, "text": "Room 12", "at": [1.0, -0.49, 1.5], "normal": [0.0, 1.0, 0.0]},
    "path": path_entity(np.array([[2.0, 0.0], [2.5, 1.0]])),
}  # fmt: skip


class Robot:
    """Stands for the node: a map, and answers to questions."""

    def __init__(self, port=0):
        self.asked = []
        self.page = LivePage(self.answer, QUESTIONS, "127.0.0.1", port)
        self.show(MAP)

    def show(self, entities):
        def change(state):
            state.entities = dict(entities)
            state.pose = [2.5, 1.0, 0.3]
            state.status = {"ready": True, "localisation": "tracking",
                            "nodes": {"surface_slam": "OK: 5 scans/s"}}  # fmt: skip

        self.page.update(change)

    async def answer(self, name, values):
        self.asked.append((name, values))
        if name == "rename":
            self.show({**MAP, "surface/3": surface(3, values["label"])})
            self.page.update(lambda state: state.add_event(f"renamed to {values['label']}"))
            return {"message": "surface 3 was 'table'"}
        if name == "placements":
            return {"placements": [{"position": [0.5, 0.4, 0.7], "clearance": 0.2}], "message": ""}
        raise RequestError("a map of this name is there: say overwrite")


@pytest.fixture
def robot():
    made = Robot()
    yield made
    made.page.close()


def request(page, method, path, body=None, **headers):
    """Return status and JSON of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=20)
    connection.request(method, path, body, {k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content


def first_messages(page, count):
    """Return the first messages of a page that opens."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=20)
    connection.request("GET", "/events")
    stream = connection.getresponse()
    found = []
    while len(found) < count:
        line = stream.readline()
        assert line, "the stream has ended"
        if line.startswith(b"data: "):
            found.append(json.loads(line[6:]))
    stream.close()
    connection.close()
    return found


def test_a_change_after_the_end_is_left_out(robot):
    robot.page.close()
    changed = []
    robot.page.update(changed.append)
    assert changed == []


def test_page_gets_the_map_and_its_changes(robot):
    messages, entities = first_messages(robot.page, 1), {}
    while entities.keys() != MAP.keys():
        messages = first_messages(robot.page, 1)
        entities = messages[0]["set"]
    assert entities == MAP
    assert messages[0]["pose"] == [2.5, 1.0, 0.3]


def test_writing_needs_the_token(robot):
    body = json.dumps({"surface_id": 3, "label": "counter"})
    for token in ("", "wrong", robot.page.token[:-1], "ü"):
        status, content = request(robot.page, "POST", "/ask/rename", body, X_Token=token.encode())
        assert status == 403
        assert b"token" in content
    assert robot.asked == []
    status, content = request(robot.page, "POST", "/ask/rename", body, X_Token=robot.page.token)
    assert (status, json.loads(content)) == (200, {"message": "surface 3 was 'table'"})
    assert robot.asked == [("rename", {"surface_id": 3, "label": "counter"})]


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1:1"},
    ],
)
def test_other_origins_and_hosts_are_refused_even_with_the_token(robot, headers):
    token = robot.page.token
    assert request(robot.page, "POST", "/ask/save", "{}", X_Token=token, **headers)[0] == 403
    assert request(robot.page, "GET", "/events", **headers)[0] == 403
    assert robot.asked == []
    own = f"http://127.0.0.1:{robot.page.port}"
    assert request(robot.page, "GET", "/", Origin=own)[0] == 200


@pytest.mark.parametrize(
    "path",
    ["/etc/passwd", "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd",
     "/live.css/..",
     "/ask/../live.js", "/viewer/main.js", "/live.html", "/ask/rename"],
)  # fmt: skip
def test_no_path_of_the_disk_is_reached(robot, path):
    status, content = request(robot.page, "GET", path)
    assert status in (403, 404, 405)
    assert b"root:" not in content


@pytest.mark.parametrize(
    ("path", "body", "expected"),
    [
        ("/ask/nothing", "{}", 404),
        ("/ask/rename", "{", 400),
        ("/ask/rename", "[" * 5000, 400),
        ("/ask/rename", "[1]", 400),
        ("/ask/save", "{}", 400),
        ("/ask/rename", "x" * 20_000, 413),
    ],
)
def test_a_wrong_question_is_answered_with_its_status(robot, path, body, expected):
    status, _ = request(robot.page, "POST", path, body, X_Token=robot.page.token)
    assert status == expected


def test_random_requests_end_nothing(robot):
    """Requests, most of them malformed; then the page answers as before."""
    chance, own = random.Random(0), f"127.0.0.1:{robot.page.port}"
    words = [
        "/",
        "/events",
        "/ask/rename",
        "/ask/save",
        "/live.js",
        "/..",
        "%00",
        "%ff",
        "?a=b",
        "//",
    ]

    def made():
        method = chance.choice(["GET", "POST", "PUT", "HEAD", "OPTIONS", "\x00", "G" * 300])
        path = "".join(chance.choices(words, k=chance.randint(1, 4)))
        path = "/" if path == "/events" else path  # that one would stay open
        body = chance.randbytes(chance.randint(0, 60))
        lines = [
            f"{method} {path} HTTP/1.1",
            f"Host: {chance.choice([own, 'x', ''])}",
            f"Content-Length: {chance.choice([len(body), -1, 'x', 10**12, len(body)])}",
            f"X-Token: {chance.choice([robot.page.token, 'x' * 100, ''])}",
            *(["Transfer-Encoding: chunked"] if chance.random() < 0.1 else []),
            *(["Origin: http://x"] if chance.random() < 0.1 else []),
            "Connection: close",
        ]
        return "\r\n".join(lines).encode("latin-1") + b"\r\n\r\n" + body

    async def one(limit):
        async with limit:
            reader, writer = await asyncio.open_connection("127.0.0.1", robot.page.port)
            try:
                writer.write(made())
                writer.write_eof()
                await asyncio.wait_for(reader.read(2000), 20)
            except ConnectionError:
                pass
            finally:
                writer.close()

    async def all_of_them():
        limit = asyncio.Semaphore(50)
        await asyncio.gather(*(one(limit) for _ in range(REQUESTS)))

    asyncio.run(all_of_them())
    assert request(robot.page, "GET", "/")[0] == 200
    assert first_messages(robot.page, 1)[0]["set"] == MAP


def test_a_port_that_is_taken_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=f"127.0.0.1:{port}: the live page cannot be served"):
            LivePage(None, QUESTIONS, "127.0.0.1", port)


def test_a_browser_shows_the_map_asks_and_comes_back(tmp_path):
    robot = Robot()
    with Browser(tmp_path, 1100, 900) as browser:
        browser.call("Page.navigate", url=robot.page.url)
        browser.wait_for(
            "window.tccmLive && tccmLive.entities.size === 6 && tccmLive.report.frames > 0"
        )
        for kind, text in (("surface", "table 0.70 m"), ("sign", "Room 12")):
            shown = f"document.querySelector('#labels span.{kind}').textContent"
            assert browser.evaluate(shown) == text
        browser.wait_for(
            "document.querySelector('#headline').textContent.startsWith('1 surfaces, 1 obj')"
        )
        assert "5 scans/s" in browser.evaluate("document.querySelector('#diagnostics').textContent")
        # A click on the table, where its name stands, picks it.
        browser.evaluate("tccmLive.report.camera.set(tccmLive.report.camera.above)")
        browser.wait_for("!tccmLive.report.waiting")
        browser.click("#labels span.surface")
        browser.wait_for(
            "document.querySelector('#picked').textContent.startsWith('table 3: 0.700 m')"
        )
        browser.evaluate("document.querySelector('#label').value = 'counter'")
        browser.click("#rename button")
        browser.wait_for(
            "document.querySelector('#answer').textContent === \"surface 3 was 'table'\""
        )
        browser.wait_for(
            "document.querySelector('#labels span:not(.mark)').textContent === 'counter 0.70 m'"
        )
        browser.wait_for("document.querySelector('#events').textContent === 'renamed to counter'")
        browser.click("#placement button")
        browser.wait_for(
            "document.querySelector('#answer').textContent.startsWith('put it at 0.50, 0.40')"
        )
        browser.click("#save button")
        browser.wait_for(
            "document.querySelector('#answer').textContent.startsWith('a map of this name')"
        )
        # The node ends: the page says so; another begins under the same address: the page goes on.
        robot.page.close()
        browser.wait_for("document.querySelector('#headline').classList.contains('lost')")
        again = Robot(robot.page.port)
        again.show({**MAP, "surface/4": surface(4, "shelf", 2.0)})
        browser.wait_for("tccmLive.entities.size === 7")
        browser.wait_for("!document.querySelector('#headline').classList.contains('lost')")
        assert robot.page.token != again.page.token
        again.page.close()
        # Chromium itself tells of the connection that was lost, nothing else is amiss.
        messages = [line for line in map(str, browser.complaints()) if "net::ERR" not in line]
        assert not [line for line in messages if "400 (Bad Request)" not in line]
