"""An agent asks a saved map with the package's own client."""

import json
import subprocess
import sys
from functools import partial

import anyio
import pytest

mcp = pytest.importorskip("mcp", reason="mcp (the extra 'agents') is missing")

from tccm_ros.agents.saved_source import SavedMapSource  # noqa: E402
from tccm_ros.agents.server import make_server  # noqa: E402

MAX_ANSWER = 10_000
"""Characters; an answer has 20 items at most."""


@pytest.fixture(scope="module")
def folder(session_files):
    return session_files.replayed("walkthrough")


@pytest.fixture(scope="module")
def server(folder):
    return make_server(SavedMapSource.load(folder))


def call(server, tool, **arguments):
    """Return the whole answer of a tool."""

    async def asked():
        async with mcp.Client(server) as client:
            return await client.call_tool(tool, arguments)

    return anyio.run(asked)


def ask(server, tool, **arguments):
    """Return the values of an answer that is no error."""
    answer = call(server, tool, **arguments)
    assert not answer.is_error, answer.content
    assert len(json.dumps(answer.structured_content)) < MAX_ANSWER
    return answer.structured_content


def content(folder, name):
    return json.loads((folder / f"{name}.json").read_text())


def test_all_tools_are_typed_and_only_read(server):
    async def listed():
        async with mcp.Client(server) as client:
            return (await client.list_tools()).tools

    tools = anyio.run(listed)
    assert [tool.name for tool in tools] == [
        "overview", "find_surfaces", "objects_on", "find_objects", "find_placements",
        "how_to_approach", "changes_since",
    ]  # fmt: skip
    for tool in tools:
        assert tool.description
        assert tool.output_schema
        assert tool.annotations.read_only_hint is True


def test_surfaces_are_those_of_the_map_with_its_stamp(folder, server):
    known = [s for s in content(folder, "surfaces")["surfaces"] if s["label"] != "floor"]
    answer = ask(server, "find_surfaces", limit=20)
    assert answer["found"] == len(known) > 0
    assert answer["map"]["stamp_s"] == pytest.approx(max(s["last_seen"] for s in known), abs=1.0)
    floor = content(folder, "surfaces")["floor_z"] or 0.0
    by_id = {s["id"]: s for s in known}
    for found in answer["surfaces"]:
        surface = by_id[found["id"]]
        assert found["label"] == surface["label"]
        assert found["height_m"] == pytest.approx(surface["height"] - floor, abs=1e-3)
        assert found["area_m2"] == pytest.approx(surface["area"], abs=1e-3)
    areas = [found["area_m2"] for found in answer["surfaces"]]
    assert areas == sorted(areas, reverse=True)


def test_words_height_and_size_choose_surfaces(server):
    every = ask(server, "find_surfaces", limit=20)["surfaces"]
    label, height = every[0]["label"], every[0]["height_m"]
    same = ask(server, "find_surfaces", words=label.upper(), limit=20)["surfaces"]
    assert [s["id"] for s in same] == [s["id"] for s in every if s["label"] == label]
    near = ask(
        server, "find_surfaces", min_height_m=height - 0.01, max_height_m=height + 0.01, limit=20
    )
    assert every[0]["id"] in [s["id"] for s in near["surfaces"]]
    longer = every[0]["length_m"] + 0.01
    long = ask(server, "find_surfaces", min_length_m=longer)["surfaces"]
    assert all(s["length_m"] >= longer for s in long)
    assert ask(server, "find_surfaces", words="nosuchthing")["found"] == 0


def test_objects_placements_and_ways_belong_to_the_surface(folder, server):
    objects = content(folder, "objects")["objects"]
    [surface] = ask(server, "find_surfaces", limit=1)["surfaces"]
    on = ask(server, "objects_on", surface_id=surface["id"])
    assert [o["id"] for o in on["objects"]] == [
        o["id"] for o in objects if o["surface"] == surface["id"]
    ]
    size = {"length_m": 0.1, "width_m": 0.1, "height_m": 0.1}
    places = ask(server, "find_placements", surface_id=surface["id"], limit=2, **size)
    assert 0 < len(places["placements"]) <= 2
    for place in places["placements"]:
        assert place["surface_id"] == surface["id"]
        assert place["position_m"][2] == pytest.approx(surface["center_m"][2], abs=0.05)
    ways = ask(server, "how_to_approach", surface_id=surface["id"], reach_m=1.5, robot_radius_m=0)
    for way in ways["placements"]:
        assert way["base_poses"]
        x, y, _ = way["position_m"]
        for base in way["base_poses"]:
            assert (base["x_m"] - x) ** 2 + (base["y_m"] - y) ** 2 <= 1.5**2 + 1e-3
    huge = ask(server, "find_placements", length_m=9.0, width_m=9.0, height_m=0.1)
    assert huge["placements"] == []
    assert huge["note"].startswith("0 placements")


def test_changes_are_those_after_the_stamp_the_newest_first(server):
    every = ask(server, "changes_since", stamp_s=0.0, limit=20)
    assert every["found"] >= len(every["changes"]) > 0
    stamps = [change["stamp_s"] for change in every["changes"]]
    assert stamps == sorted(stamps, reverse=True)
    assert ask(server, "changes_since", stamp_s=stamps[0])["found"] == 0
    assert "tccm compare" in every["note"]


def test_search_by_words_skips_objects_without_class_with_a_note(server):
    answer = ask(server, "find_objects", words="cup")
    assert answer["objects"] == []
    assert answer["note"].startswith("0 of ")


@pytest.mark.parametrize(
    ("tool", "arguments", "why"),
    [
        ("objects_on", {"surface_id": 99999}, "there is no surface 99999"),
        ("objects_on", {}, "Field required"),
        ("objects_on", {"surface_id": "; rm -rf /"}, "valid integer"),
        ("find_surfaces", {"limit": 1000}, "less than or equal to 20"),
        ("find_surfaces", {"words": "x" * 201}, "at most 200"),
        ("find_surfaces", {"min_height_m": "nan"}, "finite number"),
        ("find_placements", {"length_m": -1, "width_m": 1, "height_m": 1}, "greater than 0"),
        ("changes_since", {"stamp_s": "inf"}, "finite number"),
        ("save_map", {}, "Unknown tool"),
    ],
)
def test_a_wrong_question_is_answered_with_the_reason(server, tool, arguments, why):
    answer = call(server, tool, **arguments)
    assert answer.is_error
    assert why in answer.content[0].text


def test_the_command_serves_on_standard_input(folder):
    asked = partial(subprocess.run, capture_output=True, text=True, check=False)
    missing = asked([sys.executable, "-m", "tccm_ros.cli", "mcp", str(folder / "none")])
    assert missing.returncode == 1
    assert "no such map" in missing.stderr
    assert "Traceback" not in missing.stderr
    parameters = mcp.StdioServerParameters(
        command=sys.executable, args=["-m", "tccm_ros.cli", "mcp", str(folder)]
    )

    async def overview():
        async with mcp.Client(mcp.stdio_client(parameters)) as client:
            return await client.call_tool("overview", {})

    answer = anyio.run(overview).structured_content
    surfaces = [s for s in content(folder, "surfaces")["surfaces"] if s["label"] != "floor"]
    assert answer["surfaces"] == len(surfaces)


@pytest.mark.parametrize("arguments", [[], ["map", "--live"]])
def test_the_command_wants_one_map(arguments):
    command = [sys.executable, "-m", "tccm_ros.cli", "mcp", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "give a saved map, or --live" in done.stderr
