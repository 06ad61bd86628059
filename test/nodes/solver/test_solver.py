"""The process that solves: the same bytes as in the node's own, also after it was killed."""

import errno
import os
import signal
import threading
from types import SimpleNamespace

import plan
import pytest
from live_robot import URDF, recording
from written_map import write_map

from tccm_ros.config import Config
from tccm_ros.errors import MapError, OutputError
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.nodes.saving.map_folder import save_archive
from tccm_ros.nodes.solver import process
from tccm_ros.nodes.solver import solver as solver_module
from tccm_ros.nodes.solver.channel import (
    Began,
    Begin,
    Failed,
    Journal,
    Localised,
    PoseStamp,
    Solved,
    read_events,
)
from tccm_ros.nodes.solver.process import SolverProcess
from tccm_ros.nodes.solver.solver import Solver
from tccm_ros.records import RobotDescription
from tccm_ros.replay.processors import Pipeline
from tccm_ros.results.map_file import load_map

MAX_DEATHS = 3  # deaths without a solution, after which no process is started

PATIENCE_S = 120.0
TOPICS = frozenset({"surfaces", "map"})


@pytest.fixture(scope="module")
def drive():
    """Events of a drive, and the processor that has had them."""
    events = []

    class Recorded(Pipeline):
        def add(self, role, record):
            if role == "tilt_scan":
                events.append(PoseStamp(record.stamp_ns))
            return super().add(role, record)

    pipeline = Recorded(Config(), expects_odometry=True)
    plain = pipeline.slam.add
    pipeline.slam.add = lambda event: (
        events.append(event) if pipeline.slam.takes(event) else None,
        plain(event),
    )[1]
    pipeline.add("robot_description", RobotDescription(URDF.format(p="", kind="revolute")))
    for topic, record in recording(6, speed=0.3):
        pipeline.add(topic, record)
    pipeline.finish()
    return events, pipeline.slam


@pytest.fixture
def solver():
    answers = []
    solver = Solver(Config(), answers.append)
    solver.answers = answers
    yield solver
    solver.close()


def solved(solver) -> Solved:
    number = solver.solve(TOPICS)
    assert solver.wait(number, PATIENCE_S)
    assert solver.newest is not None, solver.answers
    assert solver.newest.number == number
    return solver.newest


def test_unusable_answer_is_reported_and_the_next_one_is_taken(drive):
    events, _ = drive
    numbers, errors, is_second = [], [], threading.Event()

    def take(answer):
        if isinstance(answer, Failed):
            errors.append(answer.error)
        elif isinstance(answer, Solved):
            numbers.append(answer.number)
            if len(numbers) == 1:
                raise ValueError("other fields")
            is_second.set()

    solver = Solver(Config(), take)
    try:
        half = len(events) // 2
        for part in (events[:half], events[half:]):
            for event in part:
                solver.add(event)
            assert solver.wait(solver.solve(TOPICS), PATIENCE_S)
        assert is_second.wait(PATIENCE_S)
        assert errors == ["ValueError: other fields"]
    finally:
        solver.close()


def test_a_stage_that_fails_is_left_out_of_the_map_and_named(drive, tmp_path, monkeypatch):
    events, _ = drive
    # Read by the process that solves, as it starts.
    (tmp_path / "sitecustomize.py").write_text(
        "from tccm_ros.mapping import surface_slam\n"
        "def find_rooms(walls, grid):\n"
        "    raise ValueError('no ring closes')\n"
        "surface_slam.find_rooms = find_rooms\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("TCCM_STRICT")
    answers = []
    solver = Solver(Config(), answers.append)
    try:
        for event in events:
            solver.add(event)
        number = solver.solve(TOPICS)
        assert solver.wait(number, PATIENCE_S)
        assert dict(solver.newest.failed_stages) == {"rooms: ValueError: no ring closes": 1}
        assert len(solver.newest.messages["surfaces"]) > 1000
        assert not list(solver.problems())
    finally:
        solver.close()


def files(folder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_saved_map_equals_that_of_the_processor_also_after_a_kill(drive, solver, tmp_path):
    events, slam = drive
    write_map(tmp_path / "offline", slam, slam.solve())
    half = len(events) // 2
    for event in events[:half]:
        solver.add(event)
    solved(solver)
    os.kill(solver.pid, signal.SIGKILL)
    for event in events[half:]:
        solver.add(event)
    found = solved(solver)
    assert solver.restarts == 1
    assert found.content.views == len(slam.map.views)
    assert set(found.messages) == TOPICS
    save_archive(found.archive, tmp_path / "live")
    assert files(tmp_path / "live") == files(tmp_path / "offline")


def test_repeated_deaths_are_reported_and_the_newest_solution_stays(drive, solver, tmp_path):
    events, _ = drive
    for event in events:
        solver.add(event)
    found = solved(solver)
    assert list(solver.problems()) == []
    for death in range(MAX_DEATHS):
        pid = solver.pid
        os.kill(pid, signal.SIGKILL)
        with solver._changed:
            changed = solver._changed.wait_for(
                lambda p=pid: solver.is_dead or solver.pid != p, PATIENCE_S
            )
        assert changed, death
        assert len(list(solver.problems())) == 1
    assert solver.is_dead
    assert not solver.is_solving
    solver.add(events[-1])
    assert solver.wait(solver.solve(TOPICS), PATIENCE_S)
    save_archive(found.archive, tmp_path)
    assert load_map(tmp_path / "map.mcap").views


def test_map_is_loaded_and_a_damaged_one_leaves_the_session_unchanged(drive, solver, tmp_path):
    events, slam = drive
    write_map(tmp_path, slam, slam.solve())
    for event in events:
        solver.add(event)
    before = solved(solver)
    for path in (tmp_path / "nowhere.mcap", tmp_path / "walls.json"):
        with pytest.raises(MapError, match=path.name):
            solver.begin(path)
    assert solver.newest is before
    expected = SurfaceSlam.from_saved(
        Config(), load_map(tmp_path / "map.mcap")
    ).wall_slam.first_keyframe
    assert solver.begin(tmp_path / "map.mcap") == expected
    os.kill(solver.pid, signal.SIGKILL)
    (tmp_path / "map.mcap").unlink()
    assert solved(solver).content.views == before.content.views


def test_a_map_that_is_loaded_at_the_start_is_answered_by_its_own_session(drive, tmp_path):
    """The process is asked for two sessions before it has answered the first."""
    slam = drive[1]
    write_map(tmp_path, slam, slam.solve())
    expected = SurfaceSlam.from_saved(
        Config(), load_map(tmp_path / "map.mcap")
    ).wall_slam.first_keyframe
    assert expected[0] > 0
    (tmp_path / "damaged.mcap").write_bytes((tmp_path / "map.mcap").read_bytes()[:-5000])
    solver = Solver(Config(), lambda answer: None)
    try:
        with pytest.raises(MapError, match="damaged"):
            solver.begin(tmp_path / "damaged.mcap")
        assert solver.begin(tmp_path / "map.mcap") == expected
    finally:
        solver.close()
    solver = Solver(Config(), lambda answer: None)
    try:
        assert solver.begin(tmp_path / "map.mcap") == expected
    finally:
        solver.close()


def test_trajectory_beside_the_map_is_reported_and_equals_a_replay(solver, tmp_path):
    """The map is that of a ring of corridors; the robot drives 3 m in a room."""
    ring = SurfaceSlam(Config())
    for scan in plan.drive(plan.ring(), plan.route([(0, 0), (12, 0), (12, 5)])).scans:
        ring.add(scan)
    write_map(tmp_path / "ring", ring, ring.solve())
    solver.begin(tmp_path / "ring" / "map.mcap")
    slam = SurfaceSlam.from_saved(Config(), load_map(tmp_path / "ring" / "map.mcap"))
    room, route = plan.box(0.0, 0.0, 7.0, 4.5), plan.route([(1, 1), (4, 1)])
    for scan in plan.drive(room, route, start_ns=2 * 10**18).scans:
        slam.add(scan)
        solver.add(scan)
    assert slam.wall_slam.is_unjoined
    found = solved(solver)
    localised = [a for a in solver.answers if isinstance(a, Localised)][-1]
    assert "beside the map" in localised.waits_for
    assert localised.map.is_unjoined
    assert found.map.is_localised
    assert found.map.is_unjoined
    write_map(tmp_path / "offline", slam, slam.solve())
    save_archive(found.archive, tmp_path / "live")
    assert files(tmp_path / "live") == files(tmp_path / "offline")


def test_answers_of_a_session_that_was_forgotten_are_not_taken(drive, solver):
    events, _ = drive
    for event in events:
        solver.add(event)
    old = solver.solve(TOPICS)
    solver.begin()
    assert solver.newest is None
    assert solver.wait(old, 0.0)
    assert solved(solver).content.is_empty
    assert not [a for a in solver.answers if not solver.is_of_session(a)]


def test_final_solution_is_a_batch_if_the_newest_one_is_not(drive, solver):
    for event in drive[0][:50]:
        solver.add(event)
    first = solved(solver)
    assert first.is_batch, "a small graph is solved as a batch"
    assert solver.solve(TOPICS, is_final=True) == first.number
    solver.newest = first._replace(is_batch=False)
    assert not solver.is_batch
    assert solver.solve(TOPICS) == first.number
    again = solver.solve(TOPICS, is_final=True)
    assert again > first.number
    assert solver.wait(again, PATIENCE_S)
    assert solver.is_batch


def test_a_reset_starts_a_process_again_that_died_too_often(drive, solver):
    events, _ = drive
    for _ in range(MAX_DEATHS):
        pid = solver.pid
        os.kill(pid, signal.SIGKILL)
        with solver._changed:
            assert solver._changed.wait_for(
                lambda p=pid: solver.is_dead or solver.pid != p, PATIENCE_S
            )
    assert solver.is_dead
    solver.begin()
    for event in events:
        solver.add(event)
    assert solved(solver).content.keyframes
    assert list(solver.problems()) == []


def test_a_process_that_cannot_be_started_again_is_started_later(drive, solver, monkeypatch):
    """As after the memory of the machine ran out."""
    events, _ = drive
    plain, refused = solver_module.spawn, []

    def spawned(module):
        if not refused:
            refused.append(True)
            raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
        return plain(module)

    monkeypatch.setattr(solver_module, "spawn", spawned)
    os.kill(solver.pid, signal.SIGKILL)
    for event in events:
        solver.add(event)
    assert solved(solver).content.keyframes
    assert refused
    assert solver.restarts == 1


def test_any_error_of_a_map_that_is_loaded_is_its_answer(monkeypatch):
    def no_memory(begin):
        raise MemoryError("1 GB")

    monkeypatch.setattr(process, "_read_map", no_memory)
    journal, sent = Journal(), []
    begin = Begin(Config().model_dump_json(), 7, "map.mcap", journal=os.dup(journal.fileno()))
    SolverProcess(SimpleNamespace(send=sent.append)).do(begin)
    assert sent == [Began(7, error="MemoryError: 1 GB")]
    with pytest.raises(OSError, match=r"[Bb]ad file descriptor"):
        os.fstat(begin.journal)


def test_a_batch_that_the_disk_takes_in_parts_is_whole_or_absent(monkeypatch):
    plain, journal, left = os.pwrite, Journal(), [10_000]

    def pwrite(file, data, offset):
        taken = min(len(data), 40, left[0])
        left[0] -= taken
        if not taken:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return plain(file, data[:taken], offset)

    monkeypatch.setattr(os, "pwrite", pwrite)
    batches = [[str(k) * 500, k] for k in range(3)]
    journal.append(batches[0])
    left[0] = 41
    with pytest.raises(OutputError, match="no space left"):
        journal.append(batches[1])
    left[0] = 10_000
    journal.append(batches[2])
    assert list(read_events(journal.fileno(), 0, journal.length)) == [*batches[0], *batches[2]]
