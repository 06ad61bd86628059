"""Nodes that a lifecycle manager configures and activates, driven by a client of its own."""

from contextlib import suppress
from pathlib import Path

import pytest
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetState
from live_robot import (
    CYCLE_SCANS,
    START_NS,
    STEP_NS,
    Listener,
    overrides,
    recording,
    wait_until_done,
)
from nav_msgs.msg import Path as PathMessage
from processes import read_until, settings, started, stop
from rcl_interfaces.msg import Log
from rclpy.node import NodeNameNonExistentError
from std_srvs.srv import SetBool, Trigger

from tccm_ros.nodes.managed import ManagedNode, ManagedSlamNode, ManagedTccmNode
from tccm_ros.nodes.process import ending
from tccm_ros.nodes.tccm_node import CUBOIDS_FILE
from tccm_ros.results.labels_file import MAP_FILE

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED


class Manager:
    """Changes the state of one node, as Nav2's lifecycle manager does."""

    def __init__(self, ros, name: str):
        self.ros, self.name = ros, name
        self.node = Listener(ros, "manager").node
        self._change = self.node.create_client(ChangeState, f"/{name}/change_state")
        self._get = self.node.create_client(GetState, f"/{name}/get_state")

    def change(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.ros.call(self._change, request).success

    @property
    def state(self) -> int:
        return self.ros.call(self._get, GetState.Request()).current_state.id

    def to(self, transition: int, state: int) -> None:
        assert self.change(transition)
        assert self.state == state

    def offers(self, service: str) -> bool:
        """Return whether the node has a service, as far as the graph is known by now."""
        servers: list = []

        def is_known() -> bool:
            with suppress(NodeNameNonExistentError):
                servers[:] = self.node.get_service_names_and_types_by_node(self.name, "/")
            return f"/{self.name}/get_state" in dict(servers)

        self.ros.spin_until(is_known)
        return f"/{self.name}/{service}" in dict(servers)

    def ask(self, service: str, kind=Trigger, **fields):
        client = self.node.create_client(kind, f"/{self.name}/{service}")
        return self.ros.call(client, kind.Request(**fields))


def managed(ros, kind: type[ManagedNode], **values) -> ManagedNode:
    named = {name.replace("__", "."): value for name, value in values.items()}
    named.setdefault("qos.reliability", "reliable")
    return ros.add(kind(context=ros.another_context(), parameter_overrides=overrides(named)))


def later(start: int, cycles: int = 3):
    """Return a recording that begins so many tilt cycles after the first one."""
    return list(recording(cycles, start_ns=START_NS + start * CYCLE_SCANS * STEP_NS))


@pytest.mark.every_distro
def test_a_managed_tccm_node_maps_while_it_is_active_and_only_then(ros):
    node, robot = managed(ros, ManagedTccmNode), ros.robot()
    manager = Manager(ros, "tccm")
    assert manager.state == UNCONFIGURED
    assert not manager.offers("pause")
    assert not node.has_parameter("map.cell_size")
    manager.to(CONFIGURE, INACTIVE)
    assert node.kernels.is_done
    assert node.has_parameter("map.cell_size")
    answer = manager.ask("pause", SetBool, data=True)
    assert (answer.success, answer.message) == (False, "tccm is not active; have it activated")
    assert not node.is_paused
    assert robot.node.count_subscribers("/tilt_scan") == 0
    manager.to(ACTIVATE, ACTIVE)
    robot.play(later(0), node)
    first = node.processor.counts["cycles"]
    assert first >= 2
    assert manager.ask("pause", SetBool, data=False).success
    manager.to(DEACTIVATE, INACTIVE)
    ros.spin_until(lambda: robot.node.count_subscribers("/tilt_scan") == 0)
    for topic, record in later(3):
        robot.publish(topic, robot.message(record))
    assert not list(node.inputs)
    assert not node.all_problems()
    kept = len(node.processor.map.cuboids())
    assert kept > 0
    manager.to(ACTIVATE, ACTIVE)
    robot._heard.clear()
    robot.play(later(6), node)
    # What was sent while it was inactive is not mapped; what came before and after is.
    assert node.inputs.counts()["/tilt_scan"] == 60
    assert first + 2 <= node.processor.counts["cycles"] <= 8
    assert len(node.processor.map.cuboids()) >= kept
    manager.to(DEACTIVATE, INACTIVE)
    manager.to(CLEANUP, UNCONFIGURED)
    assert not hasattr(node, "processor")
    ros.spin_until(lambda: not manager.offers("pause"))
    ros.spin_until(lambda: robot.node.count_publishers("/tccm/surfaces") == 0)
    manager.to(CONFIGURE, INACTIVE)
    assert len(node.processor.map.cuboids()) == 0


@pytest.mark.every_distro
def test_a_managed_slam_node_keeps_its_map_over_a_pause(ros, tmp_path):
    node, robot = managed(ros, ManagedSlamNode, save__directory=str(tmp_path)), ros.robot()
    manager, viewer = Manager(ros, "surface_slam"), Listener(ros)
    paths = viewer.listen(PathMessage, "/surface_slam/path", latched=True)
    for _ in range(2):  # the second time after a cleanup
        manager.to(CONFIGURE, INACTIVE)
        manager.to(ACTIVATE, ACTIVE)
        robot._heard.clear()
        robot.play([x for x in later(0) if x[0] in ("scan", "odom", "joint_states")], node)
        before = node.processor.counts["level scans"]
        assert before > 10
        manager.to(DEACTIVATE, INACTIVE)
        assert "not active" in manager.ask("save_map").message
        manager.to(ACTIVATE, ACTIVE)
        robot._heard.clear()
        robot.play([x for x in later(4) if x[0] in ("scan", "odom", "joint_states")], node)
        wait_until_done(ros, node)
        assert node.processor.counts["level scans"] > before
        assert manager.ask("save_map").success
        ros.spin_until(lambda n=before: paths and len(paths[-1].poses) > n)
        paths.clear()
        solver = node.solver.pid
        manager.to(DEACTIVATE, INACTIVE)
        manager.to(CLEANUP, UNCONFIGURED)
        assert not Path(f"/proc/{solver}").exists()


@pytest.mark.parametrize(
    ("state", "transition"), [(UNCONFIGURED, ACTIVATE), (INACTIVE, CONFIGURE), (INACTIVE, 250)]
)
def test_a_transition_that_is_not_possible_is_refused(ros, state, transition):
    managed(ros, ManagedTccmNode)
    manager = Manager(ros, "tccm")
    if state == INACTIVE:
        manager.to(CONFIGURE, INACTIVE)
    assert not manager.change(transition)
    assert manager.state == state


@pytest.mark.every_distro
def test_a_wrong_parameter_is_an_error_of_configure_with_its_reason(ros):
    viewer = Listener(ros)
    events = viewer.listen(TransitionEvent, "/tccm/transition_event")
    log = viewer.listen(Log, "/rosout", latched=True, depth=1000)
    node = managed(ros, ManagedTccmNode, map__cell_size=-1.0)
    ros.connect(node, viewer.node, "/tccm/transition_event", "/rosout")
    manager = Manager(ros, "tccm")
    assert not manager.change(CONFIGURE)
    assert manager.state == UNCONFIGURED
    ros.spin_until(lambda: len(events) >= 3)
    assert State.TRANSITION_STATE_ERRORPROCESSING in [e.goal_state.id for e in events]
    ros.spin_until(lambda: any("configure failed: " in m.msg for m in log))
    (reason,) = [m.msg for m in log if "configure failed" in m.msg]
    assert "parameter map.cell_size: -1.0 is out of range" in reason
    assert not manager.change(CONFIGURE)  # nothing of the first attempt is in the way


@pytest.mark.parametrize("end", [CLEANUP, Transition.TRANSITION_ACTIVE_SHUTDOWN])
@pytest.mark.parametrize(
    ("kind", "name", "file"),
    [(ManagedTccmNode, "tccm", CUBOIDS_FILE), (ManagedSlamNode, "surface_slam", MAP_FILE)],
)
def test_cleanup_and_shutdown_save_as_the_plain_node_does(
    ros, tmp_path, monkeypatch, kind, name, file, end
):
    """However long that takes: a transition has no deadline, as a signal has."""
    monkeypatch.setattr(ending, "WORK_S", 0.0)
    node = managed(ros, kind, save__on_shutdown=True, save__directory=str(tmp_path))
    manager, robot = Manager(ros, name), ros.robot()
    manager.to(CONFIGURE, INACTIVE)
    manager.to(ACTIVATE, ACTIVE)
    robot.play(later(0), node)
    assert not list(tmp_path.rglob(file))
    if end == CLEANUP:
        manager.to(DEACTIVATE, INACTIVE)
    manager.to(end, UNCONFIGURED if end == CLEANUP else FINALIZED)
    assert (tmp_path / file).exists()


def test_managed_process_reports_waiting_and_ends_at_a_signal(ros):
    with started(ros.domain, "managed_tccm_node", *settings(qos__silence=60.0)) as process:
        read_until(process, "unconfigured; waits for tccm/change_state")
        manager = Manager(ros, "tccm")
        manager.to(CONFIGURE, INACTIVE)
        read_until(process, "inactive; waits to be activated")
        manager.to(ACTIVATE, ACTIVE)
        read_until(process, "ready: nothing is known of the robot yet; waits for /tilt_scan, /odom")
        status, _ = stop(process)
    assert status == 0


def test_a_signal_ends_a_process_that_loads_its_kernels(ros, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    with started(ros.domain, "managed_tccm_node", *settings(qos__silence=60.0)) as process:
        manager = Manager(ros, "tccm")
        ros.spin_until(manager._change.service_is_ready)
        request = ChangeState.Request(transition=Transition(id=CONFIGURE))
        future = manager._change.call_async(request)
        read_until(process, r"compiled, once: \d+ s")
        assert not future.done()
        status, text = stop(process)
    assert (status, "Traceback" in text) == (0, False)
