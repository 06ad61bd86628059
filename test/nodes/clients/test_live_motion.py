"""An agent drives a simulated base by approach_node with the official client."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from approach_world import simple_flat
from live_robot import overrides

from tccm_ros.nodes.interfaces import has_interfaces

mcp = pytest.importorskip("mcp", reason="mcp (the extra 'agents') is missing")
pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

import anyio  # noqa: E402

from tccm_ros.agents.server import make_server  # noqa: E402

CORNERS = [0.25, 0.22, -0.25, 0.22, -0.25, -0.22, 0.25, -0.22]


@pytest.fixture
def robot(ros):
    """A base and the map of its flat."""
    from approach_robot import ApproachRobot

    return ApproachRobot(ros, simple_flat(None, (0.2, -0.1, 0.2)))


@pytest.fixture
def server(ros, robot, monkeypatch):
    from tccm_ros.nodes.clients.running_robot import live_robot

    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain))
    with live_robot("surface_slam", "approach") as (source, motion):
        yield make_server(source, motion)


@pytest.fixture
def drive(ros, robot):
    """The node that drives, ready."""
    from tccm_ros.nodes.approach_node import ApproachNode

    named = {"use_sim_time": True, "qos.reliability": "reliable", "approach.footprint": CORNERS}
    node = ros.add(
        ApproachNode(context=ros.another_context(), parameter_overrides=overrides(named))
    )
    inputs = "/odom", "/scan", "/tccm/surfaces", "/tccm/obstacles"
    ros.connect(robot.node, node, *inputs)
    ros.connect(node, robot.node, "/cmd_vel")
    ros.connect(robot.map_node, node, "/map", "/surface_slam/localisation")
    ros.spin_until(lambda: node._client.surfaces and node._grid, what="the map")
    # The clients' first goal is refused if it comes before the discovery of find_surfaces.
    services = node._client._clients.values()
    ros.spin_until(lambda: any(c.service_is_ready() for c in services), what="find_surfaces")
    robot.driver = node
    for _ in range(12):
        robot.step()
    yield node
    node.close()


async def asked(server, tool, arguments):
    async with mcp.Client(server) as client:
        return await client.call_tool(tool, arguments)


def ask(robot, server, tool, **arguments):
    """Return the whole answer of a tool, while the base drives."""
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(anyio.run, partial(asked, server, tool, arguments))
        robot.drive_until(answer.done)
    return answer.result()


def test_without_the_node_the_reason_is_reported(robot, server):
    robot.ros.spin_until(
        lambda: robot.map_node.count_subscribers("/surface_slam/surface_map"), what="the client"
    )
    answer = ask(robot, server, "retreat", distance_m=0.2)
    assert answer.is_error
    assert "is approach_node there?" in answer.content[0].text


def test_an_agent_drives_to_a_table_and_back_and_a_call_given_up_stops(robot, server, drive):
    answer = ask(robot, server, "approach", surface_id=1, gap_m=0.08)
    assert not answer.is_error, answer.content
    there = answer.structured_content["approach"]
    gap, _ = robot.base.true_figures()
    assert (there["surface_id"], there["has_moved"]) == (1, True)
    assert there["gap_m"] == pytest.approx(gap, abs=0.01)
    assert gap == pytest.approx(0.08, abs=0.02)
    back = ask(robot, server, "retreat", distance_m=0.3)
    assert back.structured_content["distance_m"] == pytest.approx(0.3, abs=0.01)
    unknown = ask(robot, server, "approach", spot="no/where")
    assert unknown.is_error
    assert "no spot is called 'no/where'" in unknown.content[0].text

    async def give_up():
        async with mcp.Client(server) as client, anyio.create_task_group() as group:
            group.start_soon(client.call_tool, "retreat", {"distance_m": 1.5})
            while robot.base.speed < 0.05:
                await anyio.sleep(0.01)
            group.cancel_scope.cancel()

    with ThreadPoolExecutor(1) as pool:
        ended = pool.submit(anyio.run, give_up)
        robot.drive_until(lambda: ended.done() and robot.commands[-1] == (0.0, 0.0))
    ended.result()
    for _ in range(15):
        robot.step()
    place = robot.base.truth.copy()
    for _ in range(5):
        robot.step()
    np.testing.assert_allclose(robot.base.truth, place, atol=1e-4)
    assert robot.base.contacts == 0
