"""A map and a question about it go over DDS and come back as they were."""

from array import array

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from rclpy.action import ActionClient, ActionServer
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

pytest.importorskip("tccm_interfaces", reason="tccm_interfaces is not generated")

from tccm_interfaces.action import ScanHere
from tccm_interfaces.msg import (
    FreeArea,
    Localisation,
    PlaneWithCovariance,
    Ring,
    Sign,
    Surface,
    SurfaceArray,
    SurfaceMap,
    SurfaceObject,
    Wall,
)
from tccm_interfaces.srv import FindSurfaces

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
HEADER = Header(stamp=Time(sec=1_700_000_000, nanosec=5), frame_id="map")
CORNERS = [Point(x=x, y=y, z=0.7) for x, y in ((0.0, 0.0), (1.2, 0.0), (1.2, 0.8), (0.0, 0.8))]


def surface(identity: int, label: str) -> Surface:
    """Return a table whose far side was hidden by the object on it."""
    edges = [Surface.EDGE_SEEN, Surface.EDGE_SEEN, Surface.EDGE_HIDDEN, Surface.EDGE_CUT]
    plane = PlaneWithCovariance(normal=Vector3(z=1.0), offset=0.7, covariance=[1e-6] * 9)
    return Surface(
        header=HEADER, id=identity, merged_ids=array("i", [7, 8]), label=label, confidence=0.9,
        size_x=1.2, size_y=0.8, height=0.7, plane=plane, shape=Surface.SHAPE_RECTANGLE,
        boundary=Ring(points=CORNERS), edges=edges, hidden_by_objects=[-1, -1, 9, -1],
        area=0.96, area_seen=0.9, points=1000, first_seen=HEADER.stamp, last_seen=HEADER.stamp,
        view_stamps=[1_700_000_000_000_000_005], view_keyframes=[-1], view_points=[1000],
        near_signs=["A 301"], room="kitchen",
    )  # fmt: skip


def whole_map() -> SurfaceMap:
    """Return a map that has something of everything."""
    return SurfaceMap(
        header=HEADER, name="flat", floor_z=0.0,
        surfaces=[surface(4, "table"), surface(5, "counter")],
        objects=[SurfaceObject(header=HEADER, id=9, surface_id=4, size=Vector3(x=0.1, z=0.2))],
        free_areas=[FreeArea(surface_id=4, size_x=0.2, outlines=[Ring(points=CORNERS)])],
        walls=[Wall(header=HEADER, phi=1.0, rho=2.0, endpoints=CORNERS[:2], corner_ids=[1, 2])],
        signs=[Sign(header=HEADER, id=1, text="A 301", wall_id=-1, covariance=[0.01] * 9)],
        localisation=Localisation(header=HEADER, state=Localisation.TRACKING, sign_id=-1),
    )  # fmt: skip


@pytest.fixture
def robot(ros):
    return ros.add(Node("robot", context=ros.context))


@pytest.fixture
def program(ros):
    return ros.add(Node("program", context=ros.another_context()))


@pytest.mark.every_distro
def test_a_late_listener_gets_the_whole_map(ros, robot, program):
    robot.create_publisher(SurfaceMap, "surface_map", LATCHED).publish(whole_map())
    heard = []
    program.create_subscription(SurfaceMap, "surface_map", heard.append, LATCHED)
    ros.spin_until(lambda: heard, what="the map")
    assert heard == [whole_map()]


@pytest.mark.every_distro
def test_a_question_is_answered(ros, robot, program):
    def answer(request, response):
        found = [s for s in whole_map().surfaces if s.label in request.filter.labels]
        response.success, response.message = bool(found), f"{len(found)} found"
        response.surfaces = SurfaceArray(header=HEADER, surfaces=found)
        return response

    robot.create_service(FindSurfaces, "find_surfaces", answer)
    client = program.create_client(FindSurfaces, "find_surfaces")
    request = FindSurfaces.Request()
    request.filter.labels = ["counter", "shelf"]
    response = ros.call(client, request)
    assert (response.success, response.message) == (True, "1 found")
    assert response.surfaces == SurfaceArray(header=HEADER, surfaces=[surface(5, "counter")])


@pytest.mark.every_distro
def test_action_reports_phase_and_result(ros, robot, program):
    def scan(goal):
        goal.publish_feedback(
            ScanHere.Feedback(phase=ScanHere.Feedback.MOVING, progress=goal.request.max_tilt)
        )
        goal.succeed()
        return ScanHere.Result(success=True, surfaces=SurfaceArray(surfaces=[surface(4, "table")]))

    server = ActionServer(robot, ScanHere, "scan_here", scan)
    client = ActionClient(program, ScanHere, "scan_here")
    ros.spin_until(client.server_is_ready, what="the action")
    phases = []
    goal = client.send_goal_async(
        ScanHere.Goal(max_tilt=0.5), lambda message: phases.append(message.feedback)
    )
    ros.spin_until(goal.done, what="the goal")
    result = goal.result().get_result_async()
    ros.spin_until(lambda: result.done() and phases, what="the result")
    assert phases == [ScanHere.Feedback(phase=ScanHere.Feedback.MOVING, progress=0.5)]
    assert result.result().result.surfaces.surfaces == [surface(4, "table")]
    client.destroy()
    server.destroy()
