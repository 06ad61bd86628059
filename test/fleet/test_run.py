"""Runs of a fleet: whole results or none, whatever ends; the rest is done by the next run.

Scheduler, workers and the command are processes of their own, over TCP.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress

import pytest
from fleet_bags import contents, write_bad_recordings, write_recordings

from tccm_ros.config import Config
from tccm_ros.errors import FleetError
from tccm_ros.fleet import run
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.run import run_fleet
from tccm_ros.fleet.task import JobStatus
from tccm_ros.replay.replay import replay

PATIENCE_S = 300.0


COUNT = 3
"""Recordings: one may end while a test waits for another that is replayed."""


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    return write_recordings(tmp_path_factory.mktemp("fleet") / "bags", COUNT)


@pytest.fixture(scope="module")
def single(bags, tmp_path_factory):
    """The files of a single replay."""
    out = tmp_path_factory.mktemp("single") / "out"
    replay(bags / "robot_0", out, Config(), pictures=False)
    return contents(out)


def _heed_interrupts():
    """What a shell starts in the background ignores interrupts, and so do its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def started(*command):
    """Start a process; whatever happens, it and its children are gone at the end."""
    process = subprocess.Popen(
        [sys.executable, *map(str, command)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        preexec_fn=_heed_interrupts,
    )  # fmt: skip
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextmanager
def scheduled():
    """Start a scheduler; yield its address and its process."""
    with started("-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
                 "--no-dashboard") as process:  # fmt: skip
        for line in process.stdout:
            found = re.search(r"Scheduler at:\s+(tcp://\S+)", line)
            if found:
                yield found[1], process
                return
        pytest.fail("the scheduler did not start")


@pytest.fixture
def scheduler():
    """The address of a scheduler in a process of its own."""
    with scheduled() as (address, _):
        yield address


@pytest.fixture(scope="module")
def cluster():
    """The address of a scheduler with two workers, and these."""
    with ExitStack() as stack:
        address, _ = stack.enter_context(scheduled())
        yield address, [stack.enter_context(worker(address)) for _ in range(2)]


def worker(address):
    return started("-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny",
                   "--no-dashboard")  # fmt: skip


def fleet(bags, out, *more):
    return started("-m", "tccm_ros.cli", "fleet", bags, "--out", out, "--no-pictures", *more)


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.02)


def unfinished(out):
    return [path for path in out.glob("recordings/.*") if ".tccm-new-" in path.name]


def finished(out):
    return {path.name.partition("-")[0]: path for path in out.glob("recordings/[!.]*")}


def assert_whole(out, single, count=COUNT):
    """Assert that each recording has the results of a single replay, and nothing else is there."""
    found = finished(out)
    assert set(found) == {f"robot_{k}" for k in range(count)}
    for folder in found.values():
        assert contents(folder) == single
    assert unfinished(out) == []


def test_two_workers_over_tcp_write_the_files_of_a_replay(cluster, bags, single, tmp_path):
    bad, out = write_bad_recordings(tmp_path / "bad", bags), tmp_path / "out"
    with fleet(bags, out, bad, "--scheduler", cluster[0], "--json") as process:
        text, _ = process.communicate(timeout=PATIENCE_S)
    summary = json.loads(text)
    assert process.returncode == 1
    assert (summary["done"], summary["unchanged"], summary["failed"]) == (COUNT, 0, 5)
    assert_whole(out, single)
    failures = [json.loads(path.read_text()) for path in (out / "failures").iterdir()]
    assert {f["source"] for f in failures} == {str(path) for path in bad.iterdir()}
    assert all(f["reason"] for f in failures)


def test_a_worker_that_is_killed_costs_nothing_but_time(scheduler, bags, single, tmp_path):
    out = tmp_path / "out"
    with worker(scheduler) as first, fleet(bags, out, "--scheduler", scheduler) as process:
        wait_until(lambda: unfinished(out), "a recording that is replayed")
        first.kill()
        with worker(scheduler):
            text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, text
    assert f"{COUNT} replayed, 0 unchanged, 0 failed" in text
    assert_whole(out, single)


def assert_the_next_run_completes(bags, out, single, workers):
    """Assert that the next run does what is missing, and that alone."""
    done = len(finished(out))
    assert 0 < done < COUNT
    summary = run_fleet([str(bags)], out, Config(), workers=workers, pictures=False)
    assert summary.counts == {JobStatus.DONE: COUNT - done, JobStatus.UNCHANGED: done}
    assert_whole(out, single)


def is_midway(out):
    return finished(out) and unfinished(out)


def test_a_run_that_is_killed_is_gone_on_with(bags, single, tmp_path):
    """Both with a worker of its own."""
    out = tmp_path / "out"
    with fleet(bags, out, "--workers", "1") as process:
        wait_until(lambda: is_midway(out), "the second recording")
        process.kill()
        process.wait()
    assert_the_next_run_completes(bags, out, single, Workers())


def test_a_client_that_is_killed_leaves_scheduler_and_workers_to_the_next(
    cluster, bags, single, tmp_path
):
    address, working = cluster
    out, options = tmp_path / "out", ("--scheduler", address)
    with fleet(bags, out, *options) as process:
        wait_until(lambda: is_midway(out), "the last recording")
        process.kill()
        process.wait()
    with fleet(bags, out, *options) as process:
        text, _ = process.communicate(timeout=PATIENCE_S)
    assert all(one.poll() is None for one in working)
    assert process.returncode == 0, text
    assert ", 0 failed" in text
    assert_whole(out, single)


def test_a_scheduler_that_is_killed_ends_the_run_with_a_word(cluster, bags, single, tmp_path):
    out = tmp_path / "out"
    with ExitStack() as stack:
        address, scheduling = stack.enter_context(scheduled())
        stack.enter_context(worker(address))
        process = stack.enter_context(fleet(bags, out, "--scheduler", address))
        wait_until(lambda: is_midway(out), "the second recording")
        scheduling.kill()
        text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, text
    assert "the scheduler ended; run the same command again" in text
    assert "Traceback" not in text
    assert_the_next_run_completes(bags, out, single, Workers(scheduler=cluster[0]))


def test_an_interrupt_stops_cleanly(bags, single, tmp_path):
    out = tmp_path / "out"
    with fleet(bags, out, "--workers", "1") as process:
        wait_until(lambda: unfinished(out), "the first recording")
        os.killpg(process.pid, signal.SIGINT)  # as a terminal sends it: to all of them
        text, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, text
    assert "Traceback" not in text
    assert "run the same command again" in text
    assert unfinished(out) == []
    for folder in finished(out).values():
        assert contents(folder) == single


def test_a_recording_that_kills_its_workers_is_set_aside(bags, tmp_path, monkeypatch):
    def dies_for_one(job):
        if "robot_1" in job.recording.source:
            with open(job.out / "deaths", "a") as file:
                file.write("x")
            os.kill(os.getpid(), signal.SIGKILL)
        from tccm_ros.fleet.task import JobStatus, TaskResult

        return TaskResult(JobStatus.DONE)

    monkeypatch.setattr(run, "process", dies_for_one)
    summary = run_fleet([str(bags)], tmp_path / "out", Config())
    assert summary.counts == {JobStatus.DONE: COUNT - 1, JobStatus.FAILED: 1}
    (failure,) = summary.failures.values()
    assert failure.reason.startswith("its worker died, 3 times")
    assert (tmp_path / "out" / "deaths").read_text() == "xxx"


def test_a_fleet_without_recordings_is_an_error(tmp_path):
    with pytest.raises(FleetError, match="no recording"):
        run_fleet([str(tmp_path)], tmp_path / "out", Config())
    assert not (tmp_path / "out").exists()
