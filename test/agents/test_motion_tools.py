"""An agent drives a base with the package's own client: only if it may, and it stops."""

import threading

import anyio
import numpy as np
import pytest

mcp = pytest.importorskip("mcp", reason="mcp (the extra 'agents') is missing")

from tccm_ros.agents.facts import ApproachFacts  # noqa: E402
from tccm_ros.agents.server import make_server  # noqa: E402
from tccm_ros.errors import RequestError  # noqa: E402
from tccm_ros.ros.map_records import MapSurface  # noqa: E402


class Room:
    """A map with one table."""

    stamp_ns = 5_000_000_000
    surfaces = (
        MapSurface(
            3, "table", "", np.eye(4), np.array([1.2, 0.8]), 0.7, 0.96, np.zeros((0, 3)), (),
            1_000_000_000, stamp_ns,
        ),
    )  # fmt: skip


class Base:
    """Notes what is asked of it; the drive to `far` lasts until it is stopped."""

    def __init__(self):
        self.asked, self.started, self.ended = [], threading.Event(), threading.Event()

    def approach(self, surface_id, spot, gap_m):
        self.asked.append(("approach", surface_id, spot, gap_m))
        if spot == "far":
            self.started.set()
            assert self.ended.wait(60.0)
        if spot == "nowhere":
            raise RequestError("no spot is called 'nowhere'")
        return ApproachFacts(3, 0.05, 0.01, False)

    def retreat(self, distance_m):
        self.asked.append(("retreat", distance_m))
        return distance_m

    def stop(self):
        self.asked.append(("stop",))
        self.ended.set()


@pytest.fixture
def base():
    return Base()


@pytest.fixture
def server(base):
    return make_server(Room(), base)


def call(server, tool, timeout_s=None, **arguments):
    async def asked():
        async with mcp.Client(server) as client:
            return await client.call_tool(tool, arguments, timeout_s)

    return anyio.run(asked)


def tools(server):
    async def listed():
        async with mcp.Client(server) as client:
            return (await client.list_tools()).tools, client.instructions

    return anyio.run(listed)


def test_only_a_server_that_may_move_has_tools_that_move(server):
    still, instructions = tools(make_server(Room()))
    assert {tool.name for tool in still}.isdisjoint({"approach", "retreat"})
    assert "drive" not in instructions
    moving, instructions = tools(server)
    changed = {tool.name for tool in moving if not tool.annotations.read_only_hint}
    assert changed == {"approach", "retreat"} == {t.name for t in moving} - {t.name for t in still}
    assert "approach and retreat drive the robot's base" in instructions


def test_the_base_gets_the_goal_and_the_agent_the_outcome(server, base):
    answer = call(server, "approach", surface_id=3, gap_m=0.1).structured_content
    assert answer["approach"] == {
        "surface_id": 3, "gap_m": 0.05, "yaw_error_rad": 0.01, "has_moved": False
    }  # fmt: skip
    assert answer["map"]["stamp_s"] == 5.0
    assert call(server, "retreat", distance_m=0.4).structured_content["distance_m"] == 0.4
    call(server, "approach", spot="home")
    assert base.asked == [
        ("approach", 3, "", 0.1), ("retreat", 0.4), ("approach", -1, "home", 0.0)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("tool", "arguments", "why"),
    [
        ("approach", {}, "give a surface_id or a spot"),
        ("approach", {"surface_id": 3, "spot": "home"}, "give a surface_id or a spot"),
        ("approach", {"surface_id": 4}, "there is no surface 4"),
        ("approach", {"surface_id": 3, "gap_m": 1.5}, "less than or equal to 1"),
        ("approach", {"surface_id": 3, "gap_m": "nan"}, "finite number"),
        ("approach", {"surface_id": "3; true"}, "valid integer"),
        ("approach", {"spot": "x" * 201}, "at most 200"),
        ("retreat", {}, "Field required"),
        ("retreat", {"distance_m": -1.0}, "greater than or equal to 0.01"),
        ("retreat", {"distance_m": 3.0}, "less than or equal to 2"),
    ],
)
def test_a_bad_goal_is_refused_before_the_base_hears_of_it(server, base, tool, arguments, why):
    answer = call(server, tool, **arguments)
    assert answer.is_error
    assert why in answer.content[0].text
    assert base.asked == []


def test_failed_drive_is_reported_with_its_reason(server):
    answer = call(server, "approach", spot="nowhere")
    assert answer.is_error
    assert "no spot is called 'nowhere'" in answer.content[0].text


def test_a_call_that_is_given_up_stops_the_base(server, base):
    async def give_up():
        async with mcp.Client(server) as client, anyio.create_task_group() as group:
            group.start_soon(client.call_tool, "approach", {"spot": "far"})
            await anyio.to_thread.run_sync(base.started.wait)
            group.cancel_scope.cancel()

    anyio.run(give_up)
    assert base.ended.wait(60.0)
    assert base.asked[-1] == ("stop",)
