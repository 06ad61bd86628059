"""A task replays a recording as `tccm replay` does, once; what goes wrong is told."""

import dataclasses
import shutil
import time
from types import SimpleNamespace

import pytest
from fleet_bags import contents, write_bad_recordings, write_recordings

from tccm_ros.config import Config
from tccm_ros.fleet import task
from tccm_ros.fleet.layout import RECORD
from tccm_ros.fleet.record import DoneRecord
from tccm_ros.fleet.recordings import Recording, find_recordings
from tccm_ros.fleet.task import Job, JobStatus, TaskResult, is_done, process
from tccm_ros.replay.replay import replay
from tccm_ros.results.folder_reader import read_json_or_none


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    return write_recordings(tmp_path_factory.mktemp("task") / "bags", 1)


@pytest.fixture
def job(bags, tmp_path):
    own = shutil.copytree(bags, tmp_path / "bags")
    return Job(Recording.of(str(own / "robot_0")), tmp_path / "fleet", Config(), pictures=False)


def test_the_results_are_those_of_a_single_replay(job, tmp_path):
    assert process(job) == TaskResult(JobStatus.DONE)
    replay(job.recording.source, tmp_path / "single", job.config, pictures=False)
    assert contents(job.results) == contents(tmp_path / "single")
    record = read_json_or_none(job.results / RECORD, DoneRecord)
    assert record.cost.peak_memory > 2**26
    assert record.cost.bytes_read == sum(f.size for f in record.files) > 0


def test_the_cost_is_without_the_kernels_that_a_machine_compiles_once(job, monkeypatch):
    now = 0.0

    def compile_for_an_hour(*_):
        nonlocal now
        now += 3600.0

    def replay_for_a_minute(*args, **kwargs):
        nonlocal now
        now += 60.0
        return replay(*args, **kwargs)

    monkeypatch.setattr(task, "compile_kernels", compile_for_an_hour)
    monkeypatch.setattr(task, "replay", replay_for_a_minute)
    clock = SimpleNamespace(monotonic=lambda: now, process_time=time.process_time)
    monkeypatch.setattr(task, "time", clock)
    process(job)
    assert now == 3660.0
    assert read_json_or_none(job.results / RECORD, DoneRecord).cost.seconds == 60.0


def test_finished_tasks_are_not_repeated(job):
    assert not is_done(job)
    process(job)
    before = (job.results / "surfaces.json").stat()
    assert is_done(job)
    assert process(job).outcome is JobStatus.UNCHANGED
    assert (job.results / "surfaces.json").stat() == before


def test_files_that_were_touched_are_read_and_left(job, tmp_path):
    process(job)
    (tmp_path / "bags" / "robot_0" / "metadata.yaml").touch()
    assert not is_done(job)
    assert process(job).outcome is JobStatus.UNCHANGED


def test_other_bytes_or_another_configuration_are_replayed(job, tmp_path):
    process(job)
    config = Config.model_validate({"surfaces": {"min_area": 0.2}})
    other = dataclasses.replace(job, config=config)
    assert not is_done(other)
    assert process(other).outcome is JobStatus.DONE
    (tmp_path / "bags" / "robot_0" / "stamps.csv").write_text("raw_scan_index,ipc_time,stamp\n")
    assert process(other).outcome is JobStatus.DONE


def test_failed_task_is_reported_and_leaves_no_files(bags, tmp_path):
    bad = write_bad_recordings(tmp_path / "bad", bags)
    recordings = [*find_recordings([str(bad)]), Recording.of(str(tmp_path / "missing.mcap"))]
    for recording in recordings:
        result = process(Job(recording, tmp_path / "fleet", Config()))
        assert result.outcome is JobStatus.FAILED
        assert recording.source in result.reason
        assert "\n" not in result.reason
    assert not list((tmp_path / "fleet").rglob("*.json"))
