"""An agent queries the map of running nodes with the official client."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from live_robot import recording, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces

mcp = pytest.importorskip("mcp", reason="mcp (the extra 'agents') is missing")
pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

import anyio  # noqa: E402

from tccm_ros.agents.server import make_server  # noqa: E402


@pytest.fixture
def server(ros, monkeypatch):
    from tccm_ros.nodes.clients.running_robot import live_robot

    monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain))
    with live_robot("surface_slam") as (source, _):
        yield make_server(source)


def ask(ros, server, tool, **arguments):
    """Return the whole answer of a tool, while the nodes are spun."""

    async def asked():
        async with mcp.Client(server) as client:
            return await client.call_tool(tool, arguments)

    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(anyio.run, asked)
        ros.spin_until(answer.done, what=tool)
    return answer.result()


def content(ros, server, tool, **arguments):
    answer = ask(ros, server, tool, **arguments)
    assert not answer.is_error, answer.content
    return answer.structured_content


def test_without_a_map_the_reason_is_reported(ros, server):
    answer = ask(ros, server, "overview")
    assert answer.is_error
    assert "no map has come from surface_slam yet" in answer.content[0].text


def test_surfaces_placements_and_changes_of_a_running_node(ros, server):
    tilt_node, node = tccm(ros), slam(ros)
    for topic in ("surfaces", "view", "object_boxes"):
        ros.connect(tilt_node, node, f"/tccm/{topic}")
    ros.spin_until(lambda: node.count_subscribers("/surface_slam/events"), what="the source")
    ros.robot().play(recording(4), tilt_node, node)

    def has_table():
        answer = ask(ros, server, "find_surfaces", words="table")
        return not answer.is_error and answer.structured_content["found"]

    ros.spin_until(has_table, what="a table")
    [table] = content(ros, server, "find_surfaces", words="table")["surfaces"]
    assert table["height_m"] == pytest.approx(0.70, abs=0.01)
    assert table["first_seen_s"] <= table["last_seen_s"]
    overview = content(ros, server, "overview")
    assert overview["surfaces"] == 1
    assert overview["map"]["stamp_s"] >= table["last_seen_s"] - 1e-3
    size = {"length_m": 0.1, "width_m": 0.1, "height_m": 0.12}
    places = content(ros, server, "find_placements", surface_id=table["id"], limit=2, **size)
    assert [p["surface_id"] for p in places["placements"]] == [table["id"]] * 2
    assert places["placements"][0]["position_m"][2] == pytest.approx(0.70, abs=0.01)
    way = content(
        ros, server, "how_to_approach", surface_id=table["id"], reach_m=1.5, robot_radius_m=0.1
    )
    assert way["note"]
    changes = content(ros, server, "changes_since", stamp_s=0.0)["changes"]
    assert [(c["kind"], c["surface_ids"]) for c in changes] == [("appeared", [table["id"]])]
