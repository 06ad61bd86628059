"""The examples, beside nodes that a player feeds with bundled bags: they say what is true."""

import json
import re
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import shapely
from bag_player import play_bag
from example_process import EXAMPLES, example, printed, run_example
from live_robot import Listener, end_input, slam, tccm, wait_until_done
from rclpy.node import Node
from shapely import Point, Polygon
from std_srvs.srv import Trigger

from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.qos import latched_qos
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.surface_messages import SURFACE, SURFACE_EVENT, SURFACE_MAP

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

BAGS = Path(__file__).resolve().parents[2] / "bags"

STOOL_LEAVES_S = 12.3
"""Before the stool of the walkthrough is carried away."""

LAST_METRES_S = 97.0
"""In the flat."""

NEAR_M = 0.1
"""A middle is so near to the truth: the side of a box that nobody saw is not measured."""

MUG_M, RADIUS_M, MAX_DISTANCE_M = 0.10, 0.25, 0.80
"""What the example asks for."""

CELL_M = 0.05
"""Edge of a cell of the occupancy grid, in which the base is free."""

TABLES = {"table", "kitchen table", "coffee table", "side table", "desk"}
"""What bears the label table in the map has such a name in the truth."""


MIN_TABLE_M2 = 0.3
"""A smaller table, as the flat's side table of 0.2 m2, has the label `other`
(docs/design/shapes.md, labels)."""


class Item(NamedTuple):
    """A line of list_counters.py."""

    height: float
    xyz: np.ndarray


def numbers(text: str) -> np.ndarray:
    """Return the numbers in a text."""
    return np.array(re.findall(r"-?\d+\.\d*", text), float)


def listed(text: str) -> list[Item]:
    """Return the objects that list_counters.py prints."""
    items, height = [], np.nan
    for line in text.splitlines():
        if line.startswith("  object"):
            items.append(Item(height, numbers(line)))
        else:
            (height,) = numbers(line)
    return items


def truth(bag: str) -> dict:
    return json.loads((BAGS / bag / "truth.json").read_text())


def outline(top: dict) -> Polygon:
    return Polygon(np.array(top["boundary"])[:, :2])


def bottom(item: dict) -> float:
    return item["center"][2] - 0.5 * item["size"][2]


def on_tables(world: dict) -> list[tuple[dict, dict]]:
    """Return each true object on what the map calls a counter or table, with that."""
    return [
        (item, top)
        for item in world["objects"]
        for top in world["surfaces"]
        if top["label"] in TABLES | {"counter"}
        and top["area"] > MIN_TABLE_M2
        and abs(bottom(item) - top["height"]) < 0.03
        and outline(top).contains(Point(item["center"][:2]))
    ]


def assert_all_true_objects_are_listed(text: str, bag: str) -> None:
    """Assert that each true object on what the map calls a counter or table is listed there."""
    items, world = listed(text), truth(bag)
    places = np.array([item.xyz for item in items])
    for true, top in on_tables(world):
        errors = np.abs(places - true["center"]).max(axis=1)
        assert errors.min() < NEAR_M, true["name"]
        assert items[errors.argmin()].height == pytest.approx(top["height"], abs=0.01)


def assert_nothing_else_is_listed(text: str, bag: str) -> None:
    """Assert it for the walkthrough alone: in the flat a second side of the toaster, and what was
    seen of the wall behind the counter, may be listed as well."""
    assert len(listed(text)) == len(on_tables(truth(bag))), text


def box(item: dict) -> Polygon:
    """Return the footprint of a true object."""
    (x, y, _), half, yaw = item["center"], 0.5 * np.array(item["size"][:2]), item["yaw"]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return Polygon(corners @ R.T + (x, y))


def both_nodes(ros, **values):
    """Add both nodes with one robot, as in all_in_one."""
    tilt_node = tccm(ros, context=ros.context)
    return tilt_node, slam(ros, context=ros.context, shared=tilt_node.robot, **values)


def map_all(ros, nodes) -> None:
    """Have everything mapped and solved that has come."""
    tilt_node, node = nodes
    end_input(tilt_node)
    wait_until_done(ros, node)
    ros.spin_until(
        lambda: node.solver.newest and node.solver.newest.stamp_ns >= node.session.newest_ns,
        what="the solution with all that has come",
    )


def test_no_example_has_more_than_30_lines():
    assert all(len(p.read_text().splitlines()) <= 30 for p in EXAMPLES.glob("*.py"))


def test_a_map_that_comes_before_the_services_are_found_is_listed(ros):
    from tccm_ros.nodes.clients.map_client import MAP_SERVICES

    kind = message_class(SURFACE_MAP)
    node = ros.add(Node("surface_slam", context=ros.another_context()))
    table = message_class(SURFACE)(id=7, label="table", height=0.7)
    node.create_publisher(kind, "~/surface_map", latched_qos()).publish(kind(surfaces=[table]))
    with example(ros, "list_counters.py") as listing:
        ros.spin_until(lambda: node.count_subscribers("~/surface_map"))
        for service, path in MAP_SERVICES.items():
            node.create_service(service, f"~/{path}", lambda _, answer: answer)
        assert printed(ros, listing) == "table 7 at 0.70 m\n"


def test_a_table_is_waited_for_by_its_sign_though_others_move_before(ros):
    """What moves before: a table by no sign, one by another sign, and a shelf by the sign."""
    kind, event = message_class(SURFACE_MAP), message_class(SURFACE_EVENT)
    node = ros.add(Node("surface_slam", context=ros.another_context()))
    events = node.create_publisher(event, "~/events", 10)
    signs = {3: [], 7: ["OFFICE", "KITCHEN"], 9: ["OFFICE"]}
    tables = [
        message_class(SURFACE)(id=k, label="table", near_signs=near) for k, near in signs.items()
    ]
    shelf = message_class(SURFACE)(id=11, label="shelf", near_signs=["KITCHEN"])
    node.create_publisher(kind, "~/surface_map", latched_qos()).publish(
        kind(surfaces=[*tables, shelf])
    )

    def moved(identity, x):
        message = event(
            kind=event.MOVED, surface_ids_before=[identity], surface_ids_after=[identity]
        )
        message.pose_before.position.x, message.pose_after.position.x = 1.0, x
        return message

    with example(ros, "wait_for_move.py", "table", "KITCHEN") as waiting:
        ros.spin_until(lambda: node.count_subscribers("~/surface_map"))
        ros.spin_until(lambda: events.get_subscription_count(), what="the example to listen")
        for identity, x in ((3, 3.0), (9, 9.0), (11, 11.0), (7, 7.0)):
            events.publish(moved(identity, x))
        said = printed(ros, waiting)
    assert said == "table 7 moved from [1. 0.]\nto [7. 0.]\n"


def test_walkthrough_removes_the_stool_and_puts_both_boxes_on_the_table(ros):
    tilt_node, node = nodes = both_nodes(ros)
    events = Listener(ros).listen(message_class(SURFACE_EVENT), "/surface_slam/events")
    with example(ros, "wait_for_move.py", "seat") as waiting:
        ros.spin_until(lambda: node.count_subscribers("/surface_slam/events") == 2)
        play_bag(ros, BAGS / "walkthrough", tilt_node, node, duration=STOOL_LEAVES_S)
        ros.spin_until(lambda: any(e.label == "seat" for e in events), what="the stool")
        assert waiting.poll() is None
        play_bag(ros, BAGS / "walkthrough", tilt_node, node, start=STOOL_LEAVES_S)
        said = printed(ros, waiting)
    (stool,) = truth("walkthrough")["gone"]
    assert re.match(r"seat \d+ gone from", said)
    # The middle of what was seen of it, which no view need show whole.
    assert outline(stool).contains(Point(numbers(said)))
    map_all(ros, nodes)
    text = run_example(ros, "list_counters.py")
    assert_all_true_objects_are_listed(text, "walkthrough")
    assert_nothing_else_is_listed(text, "walkthrough")


def test_objects_on_tables_of_the_flat_are_listed_and_the_mug_is_placed(
    ros, session_files, tmp_path
):
    """The saved map of the flat is loaded, and the robot drives its last metres once more."""
    folder = shutil.copytree(session_files.replayed("flat"), tmp_path / "map")
    nodes = both_nodes(ros, save__directory=str(folder))
    load = nodes[1].create_client(Trigger, "/surface_slam/load_map")
    assert ros.call(load, Trigger.Request()).success
    play_bag(ros, BAGS / "flat", *nodes, start=LAST_METRES_S)
    map_all(ros, nodes)
    assert_all_true_objects_are_listed(run_example(ros, "list_counters.py"), "flat")
    found, mug, base = run_example(ros, "put_down_mug.py").splitlines()
    assert found == "1 placement"
    assert_mug_stands_on_nearest_table(numbers(mug))
    assert_base_stands_free(numbers(base), numbers(mug))


def assert_mug_stands_on_nearest_table(xyz: np.ndarray) -> None:
    """Assert that it stands wholly on the table that is nearest to the robot, and on nothing."""
    world = truth("flat")
    robot = Point(np.loadtxt(BAGS / "flat" / "truth.tum")[-1, 1:3])
    tables = [top for top in world["surfaces"] if top["label"] in TABLES]
    nearest = min(tables, key=lambda top: outline(top).distance(robot))
    mug = Point(xyz[:2]).buffer(0.5 * MUG_M)
    assert outline(nearest).contains(mug)
    assert xyz[2] == pytest.approx(nearest["height"], abs=0.01)
    assert not shapely.intersects([box(item) for item in world["objects"]], mug).any()


def assert_base_stands_free(xy: np.ndarray, mug: np.ndarray) -> None:
    """Assert that the base touches neither wall nor furniture, and that the arm reaches the mug."""
    base, walls = Point(xy), json.loads((BAGS / "flat" / "truth_walls.json").read_text())["walls"]
    solids = [shapely.LineString(wall["endpoints"]) for wall in walls]
    solids += [outline(top) for top in truth("flat")["surfaces"]]
    assert shapely.distance(solids, base).min() > RADIUS_M - CELL_M
    assert np.hypot(*(xy - mug[:2])) <= MAX_DISTANCE_M + 1e-3
