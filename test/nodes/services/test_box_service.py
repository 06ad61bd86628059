"""~/check_box without DDS: which map answers, and what is no box."""

from collections import Counter
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from std_msgs.msg import Header
from tccm_rig import config, part_of

from tccm_ros.cuboids.integration_map import IntegrationMap
from tccm_ros.cuboids.queries import MapQuery
from tccm_ros.nodes.interfaces import has_interfaces, service_class
from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.services.box_service import BoxService
from tccm_ros.robot.odometry import OdometryFilter

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")

UNKNOWN, OCCUPIED = 0, 2
FIRST, SECOND = [(0, 0, 7000)] * 5, [(10000, 0, 7000)] * 5
"""Points of two tilt cycles, 0.1 mm: at x = 0 and at x = 1 m, 0.7 m high."""


class Mapping:
    """A processor whose map gets one cuboid in each tilt cycle, and counts its snapshots."""

    def __init__(self):
        self.counts, self.queries = Counter(), 0
        self._config = config()
        self.map = IntegrationMap(self._config)

    def add(self, points) -> None:
        self.map.add(part_of(points, self.counts["cycles"], self._config))
        self.counts["cycles"] += 1

    def reset(self) -> None:
        self.map.clear()
        self.counts["resets"] += 1

    def query(self) -> MapQuery:
        self.queries += 1
        return MapQuery(self.map)


class Waiting:
    """What a worker gives that is busy until the coroutine is resumed."""

    def __init__(self, job):
        self._job = job

    def __await__(self):
        yield
        return self._job()


class Asking:
    """The service of a node whose worker is busy."""

    def __init__(self):
        self.processor = Mapping()
        offered = []
        motion = SimpleNamespace(odom_frame="odom", odometry=OdometryFilter())
        node = SimpleNamespace(
            robot=SimpleNamespace(robot=SimpleNamespace(motion=motion)),
            config=config(),
            types=RosidlMessages(),
            create_service=lambda *words: offered.append(words),
            worker=SimpleNamespace(call=lambda job, _: Waiting(job)),
        )
        self.service = BoxService(node, self.processor)
        ((_, _, self._call),) = offered
        self.waited = 0

    def ask(self, x=0.0, edge=0.1, frame="odom", w=1.0):
        kind = service_class("CheckBox")
        pose = Pose(position=Point(x=x, z=0.7), orientation=Quaternion(w=w))
        request = kind.Request(
            pose=PoseStamped(header=Header(frame_id=frame), pose=pose),
            size=Vector3(x=edge, y=0.1, z=0.1),
        )
        asked = self._call(request, kind.Response())
        self.waited = 0
        while True:
            try:
                asked.send(None)
            except StopIteration as end:
                return end.value
            self.waited += 1


@pytest.fixture
def asking():
    return Asking()


def test_only_the_first_question_waits_for_the_worker(asking):
    asking.processor.add(FIRST)
    asking.service.refresh()
    assert (asking.ask().state, asking.waited) == (OCCUPIED, 1)
    assert (asking.ask().state, asking.waited) == (OCCUPIED, 0)
    asking.processor.add(SECOND)
    # The worker is still busy with that tilt cycle: the map before it answers.
    assert (asking.ask(x=1.0).state, asking.waited) == (UNKNOWN, 0)
    asking.service.refresh()
    answer = asking.ask(x=1.0)
    assert (answer.state, answer.cycle, asking.waited) == (OCCUPIED, 1, 0)


def test_nothing_is_prepared_while_nobody_asks(asking):
    asking.processor.add(FIRST)
    asking.service.refresh()
    assert asking.processor.queries == 0
    asking.ask()
    for cycle in range(3):
        asking.processor.add([(20000 + 1000 * cycle, 0, 7000)])
        asking.service.refresh()
    assert asking.processor.queries == 2
    assert (asking.ask().state, asking.waited) == (OCCUPIED, 1)


def test_a_map_that_was_forgotten_answers_no_more(asking):
    asking.processor.add(FIRST)
    asking.service.refresh()
    assert asking.ask().state == OCCUPIED
    asking.processor.reset()
    asking.service.refresh()
    assert (asking.ask().state, asking.ask().cycle) == (UNKNOWN, -1)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"edge": -0.1}, "expected positive edges"),
        ({"edge": float("nan")}, "expected positive edges"),
        ({"edge": 11.0}, "at most 10 m"),
        ({"frame": ""}, "the box has no frame_id"),
        ({"w": 0.0}, "the box"),
    ],
)
def test_invalid_box_is_refused_with_a_sentence(asking, wrong, sentence):
    asking.processor.add(FIRST)
    answer = asking.ask(**wrong)
    assert (answer.success, sentence in answer.message) == (False, True), answer.message


def test_before_the_first_tilt_cycle_there_is_no_answer(asking):
    answer = asking.ask()
    assert (answer.success, answer.message) == (False, "no tilt cycle has been mapped yet")
