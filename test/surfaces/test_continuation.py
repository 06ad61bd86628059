"""Save, load, go on: as if nothing had been between."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from tccm_ros.bags.reader import DEFAULT_TOPICS, BagReader
from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.mapping.tccm import TccmProcessor
from tccm_ros.pipeline import Pipeline
from tccm_ros.pipeline.replay import replay
from tccm_ros.results.exports import planes_table, surfaces_table, trajectory_text, walls_table
from tccm_ros.results.map_file import load_map, save_map
from tccm_ros.results.numbers import json_text
from tccm_ros.snapshot import TABLE, freeze, thaw
from tccm_ros.surfaces.continuation import Continuation, LastSample

BAGS = Path(__file__).resolve().parents[2] / "bags"
CONFIG = Config()
RESULTS = (
    "surfaces.json",
    "objects.json",
    "planes.json",
    "walls.json",
    "graph.json",
    "trajectory.tum",
    "surfaces.ply",
    "cuboids.npz",
)


def read(name):
    with BagReader(BAGS / name) as reader:
        return [(role, record) for role, _, record in reader.records(DEFAULT_TOPICS)]


@pytest.fixture(scope="module")
def walkthrough():
    return read("walkthrough")


def feed(pipeline, records):
    for role, record in records:
        pipeline.add(role, record)
    return pipeline


def new_pipeline():
    return Pipeline(CONFIG, expects_odometry=True)


def texts(pipeline):
    """What a replay would write of a pipeline at the end of its input."""
    pipeline.finish()
    solution = pipeline.solve()
    cuboids = pipeline.tccm.map.cuboids()
    return {
        "surfaces": json_text(surfaces_table(solution.surfaces, solution.floor_z, "map")),
        "walls": json_text(walls_table(solution.slam.walls)),
        "planes": json_text(planes_table([*pipeline.earlier, *pipeline.cycles])),
        "trajectory": trajectory_text(solution.trajectory_ns, solution.trajectory),
        "cuboids": [cuboids.count.tobytes(), cuboids.s.tobytes(), cuboids.cycles.tobytes()],
        "counts": [pipeline.tccm.counts, pipeline.slam.counts],
        "dropped": [pipeline.tccm.dropped, pipeline.slam.dropped],
    }


def interrupted(records, where, tmp_path):
    """Feed a part, save, end that run, load, and return a pipeline that goes on."""
    first = feed(new_pipeline(), records[:where])
    run = first.interrupt()
    first.finish()
    solution = first.solve()
    save_map(tmp_path / "map.mcap", replace(first.slam.saved(solution), run=run), solution)
    second = new_pipeline()
    second.go_on_with(load_map(tmp_path / "map.mcap").run)
    return second


@pytest.fixture(scope="module")
def uninterrupted(walkthrough):
    return texts(feed(new_pipeline(), walkthrough))


@pytest.mark.parametrize("share", [0.003, 0.21, 0.5, 0.83, 0.999])
def test_it_goes_on_as_if_nothing_had_been_between(walkthrough, uninterrupted, share, tmp_path):
    where = int(share * len(walkthrough))
    second = feed(interrupted(walkthrough, where, tmp_path), walkthrough[where:])
    assert texts(second) == uninterrupted


def test_also_through_loops_and_over_several_files(tmp_path):
    records = read("flat")
    pipeline, before = new_pipeline(), 0
    for share in (0.45, 0.8):
        where = int(share * len(records))
        feed(pipeline, records[before:where])
        state = freeze({"tccm": pipeline.tccm, "slam": pipeline.slam}, CONFIG)
        got, before = thaw(state, CONFIG), where
        pipeline.tccm, pipeline.slam = got["tccm"], got["slam"]
        again = freeze(got, CONFIG)
        assert {k: v.tobytes() for k, v in again.items()} == {
            k: v.tobytes() for k, v in state.items()
        }
    went_on = texts(feed(pipeline, records[before:]))
    whole = texts(feed(new_pipeline(), records))
    assert whole["walls"].count('"id"') > 10
    assert went_on == whole


def test_the_window_of_the_tilting_laser_goes_on_alone(walkthrough):
    records = [record for role, record in walkthrough if role != "scan"]
    whole, half = (TccmProcessor(CONFIG, expects_odometry=True) for _ in range(2))
    expected = [r for record in records for r in whole.add(record)] + whole.finish()
    where = len(records) // 2
    results = [r for record in records[:where] for r in half.add(record)]
    half = thaw(freeze(half, CONFIG), CONFIG)
    results += [r for record in records[where:] for r in half.add(record)] + half.finish()
    assert json_text(planes_table(results)) == json_text(planes_table(expected))
    for one, other in zip(results, expected, strict=True):
        assert np.array_equal(one.surfaces.points, other.surfaces.points)
        assert np.array_equal(one.view.intervals, other.view.intervals)
    assert half.dropped == whole.dropped


def split(source: Path, share: float, folder: Path) -> list[Path]:
    """Cut a recording in two, as `ros2 bag record` begins a new file."""
    with source.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(log_time_order=True))
    where = int(share * len(messages))
    parts = []
    for k, part in enumerate((messages[:where], messages[where:])):
        parts.append(folder / f"part_{k}.mcap")
        with parts[-1].open("wb") as stream:
            writer = Writer(stream)
            writer.start(profile="ros2")
            schemas, channels = {}, {}
            for s, c, m in part:
                if s.id not in schemas:
                    schemas[s.id] = writer.register_schema(s.name, s.encoding, s.data)
                if c.id not in channels:
                    channels[c.id] = writer.register_channel(
                        c.topic, c.message_encoding, schemas[s.id], dict(c.metadata)
                    )
                writer.add_message(channels[c.id], m.log_time, m.data, m.publish_time, m.sequence)
            writer.finish()
    return parts


def test_a_recording_in_two_files_gives_the_results_of_one_in_another_process(tmp_path):
    first, second = split(BAGS / "walkthrough" / "walkthrough.mcap", 0.6, tmp_path)
    replay(BAGS / "walkthrough", tmp_path / "whole", CONFIG, pictures=False)
    replay(first, tmp_path / "one", CONFIG, pictures=False)
    command = ["replay", second, "--map", tmp_path / "one" / "map.mcap", "--out", tmp_path / "two"]
    done = subprocess.run(
        [sys.executable, "-m", "tccm_ros.cli", *map(str, command), "--no-pictures"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "goes on with the run that was saved" in done.stdout
    for name in RESULTS:
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_the_same_recording_again_is_a_new_session(walkthrough, tmp_path):
    pipeline = interrupted(walkthrough, 400, tmp_path)
    run = load_map(tmp_path / "map.mcap").run
    start = next(record for role, record in walkthrough if role == "odom")
    first = LastSample(start.stamp_ns, (start.frame_id, start.child_frame_id), (0.0, 0.0, 0.0))
    assert "after the saved run ended" in run.refusal(CONFIG, first)
    assert pipeline.last is None


def test_views_before_the_first_level_scan_leave_a_map_with_walls_alone(walkthrough):
    first = feed(new_pipeline(), walkthrough[: len(walkthrough) // 2])
    first.finish()
    solution = first.solve()
    saved = first.slam.saved(solution)
    later = Pipeline(CONFIG, expects_odometry=True, saved=saved)
    feed(later, [(role, record) for role, record in walkthrough if role != "scan"])
    later.finish()
    assert later.slam.counts["clouds"] > 0
    found = later.solve()
    assert not later.slam.is_placed(found)
    assert json_text(surfaces_table(found.surfaces, found.floor_z, "map")) == json_text(
        surfaces_table(solution.surfaces, solution.floor_z, "map")
    )
    kept = later.slam.saved(found)
    assert kept.walls is saved.walls
    assert kept.views == saved.views


LAST = LastSample(10_000_000_000, ("odom", "base"), (1.0, 2.0, 3.1))


def run_of(config=CONFIG):
    return Continuation.of({}, LAST, config)


@pytest.mark.parametrize(
    ("first", "reason"),
    [
        (LastSample(10_020_000_000, ("odom", "base"), (1.01, 2.0, -3.13)), ""),
        (LastSample(9_990_000_000, ("odom", "base"), (1.0, 2.0, 3.1)), ""),
        (LastSample(12_100_000_000, ("odom", "base"), (1.0, 2.0, 3.1)), "2.1 s after"),
        (LastSample(5_000_000_000, ("odom", "base"), (1.0, 2.0, 3.1)), "-5.0 s after"),
        (LastSample(10_020_000_000, ("odom", "base"), (0.0, 0.0, 0.0)), "odometry began anew"),
        (LastSample(10_020_000_000, ("odom", "base"), (1.0, 2.0, 1.0)), "odometry began anew"),
        (LastSample(10_020_000_000, ("odom", "other"), (1.0, 2.0, 3.1)), "other inputs"),
        (None, "other inputs"),
    ],
)
def test_what_does_not_go_on_with_clock_and_odometry_is_a_new_session(first, reason):
    found = run_of().refusal(CONFIG, first)
    assert reason in found
    assert bool(found) == bool(reason)


def test_another_configuration_or_software_is_a_new_session():
    first = LastSample(10_020_000_000, LAST.frames, LAST.pose)
    other = Config.model_validate({"walls": {"enabled": False}, "sync_timeout": 0.4})
    assert run_of().refusal(other, first).startswith("sync_timeout has another value")
    live = Config.model_validate({"save": {"autosave_minutes": 5.0}})
    assert run_of().refusal(live, first) == ""
    assert "version" in replace(run_of(), software="other").refusal(CONFIG, first)


def test_a_damaged_state_is_a_clear_error():
    run = run_of()
    state = {**run.state, TABLE: run.state[TABLE][:-1]}
    with pytest.raises(MapError, match="damaged"):
        replace(run, state=state).processors(CONFIG)
