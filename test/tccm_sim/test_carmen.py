import bz2
import gzip
import math
from collections import Counter
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_data import shared

from tccm_ros.bags.reader import BagReader
from tccm_ros.errors import LogError, OutputError, TccmError
from tccm_ros.geometry import compose2, planar
from tccm_ros.records import Odometry, RobotDescription, Scan, TransformSample
from tccm_sim.carmen import import_carmen
from tccm_sim.log_times import increasing_stamps, without_resets

START = 976_052_857


def flaser(time, odometry=(0.0, 0.0, 0.0), laser=None, ranges=None):
    ranges = [1.5] * 180 if ranges is None else ranges
    laser = odometry if laser is None else laser
    numbers = " ".join(f"{r:.2f}" for r in ranges)
    poses = " ".join(f"{v:.6f}" for v in (*laser, *odometry))
    return f"FLASER {len(ranges)} {numbers} {poses} {time:.6f} nohost {time - START:.6f}"


def write_log(path, lines):
    path.write_text("\n".join(lines) + "\n")
    return path


def records(bag):
    with BagReader(bag) as reader:
        found = [record for _, _, record in reader.records()]
        assert not reader.dropped
    return found


def scans_of(bag):
    return [record for record in records(bag) if isinstance(record, Scan)]


def test_a_log_becomes_a_bag_that_needs_no_setting(tmp_path):
    poses = [(0.1 * k, 0.0, 0.01 * k) for k in range(10)]
    lines = ["# a comment", "PARAM robot_frontlaser_offset 0.1"]
    lines += [flaser(START + 0.2 * k, poses[k]) for k in range(10)]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    got = records(tmp_path / "bag")
    assert (found.scans, found.odometry, found.damaged, found.kind) == (10, 10, 0, "FLASER")
    assert Counter(type(r) for r in got) == {
        Scan: 10, Odometry: 10, TransformSample: 1, RobotDescription: 1,
    }  # fmt: skip
    odometry = [r for r in got if isinstance(r, Odometry)]
    np.testing.assert_allclose([planar(o.T_odom_base) for o in odometry], poses, atol=1e-9)
    assert [o.stamp_ns for o in odometry] == [s.stamp_ns for s in scans_of(tmp_path / "bag")]
    (mount,) = [r for r in got if isinstance(r, TransformSample)]
    assert (mount.parent, mount.child, mount.is_static) == ("base_link", "laser", True)
    assert {o.child_frame_id for o in odometry} == {"base_link"}


@pytest.mark.parametrize(
    ("beams", "first", "last"),
    [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (541, -135, 135)],
)
def test_bearings_follow_the_number_of_beams(tmp_path, beams, first, last):
    log = write_log(tmp_path / "a.clf", [flaser(START, ranges=[1.0] * beams)])
    import_carmen(log, tmp_path / "bag")
    (scan,) = scans_of(tmp_path / "bag")
    assert math.degrees(scan.angle_min) == pytest.approx(first, abs=1e-4)
    end = scan.angle_min + (beams - 1) * scan.angle_increment
    assert math.degrees(end) == pytest.approx(last, abs=1e-4)


@pytest.mark.parametrize("offset", [(-0.04, 0.0, 0.0), (0.2, -0.1, 0.5)])
def test_laser_offset_is_pose_minus_odometry_despite_wrong_lines(tmp_path, offset):
    rng = np.random.default_rng(0)
    lines = []
    for k in range(50):
        odometry = rng.normal(size=3)
        laser = compose2(odometry, offset)
        if k % 10 == 0:
            laser = laser + 1.0
        lines.append(flaser(START + k, odometry, laser))
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    np.testing.assert_allclose(found.laser, offset, atol=2e-4)
    (mount,) = [r for r in records(tmp_path / "bag") if isinstance(r, TransformSample)]
    np.testing.assert_allclose(planar(mount.T_parent_child), offset, atol=2e-4)
    (urdf,) = [r for r in records(tmp_path / "bag") if isinstance(r, RobotDescription)]
    assert 'xyz="' + f"{found.laser[0]:g} {found.laser[1]:g} 0" in urdf.urdf


def test_corrected_poses_are_not_taken_for_an_offset(tmp_path):
    rng = np.random.default_rng(0)
    lines = ["PARAM robot_frontlaser_offset 0.12"]
    lines += [flaser(START + k, rng.normal(size=3), rng.normal(size=3)) for k in range(20)]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert found.laser == (0.12, 0.0, 0.0)


@pytest.mark.parametrize(
    ("sentinel", "range_max"), [(81.91, 80.0), (81.83, 80.0), (50.0, 50.0), (8.1, 8.1)]
)
def test_no_return_becomes_infinite(tmp_path, sentinel, range_max):
    rng = np.random.default_rng(2)
    ranges = rng.uniform(0.5, 7.0, size=(20, 180))
    ranges[:, 50:70] = sentinel
    lines = [flaser(START + k, ranges=row) for k, row in enumerate(ranges)]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert found.range_max == pytest.approx(range_max)
    for scan, row in zip(scans_of(tmp_path / "bag"), ranges):
        assert np.isposinf(scan.ranges[50:70]).all()
        finite = np.isfinite(scan.ranges)
        assert finite.sum() == 160
        np.testing.assert_allclose(scan.ranges[finite], row[finite], atol=0.006)
        assert scan.range_max == pytest.approx(range_max)


def test_far_walls_are_not_taken_for_no_return(tmp_path):
    bearings = np.radians(np.arange(-90, 90))
    wall = np.minimum(
        6.0 / np.maximum(np.cos(bearings), 1e-3), 20.0 / np.abs(np.sin(bearings - 0.1))
    )
    lines = [flaser(START + k, ranges=np.minimum(wall, 30)) for k in range(30)]
    import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert all(np.isfinite(scan.ranges).all() for scan in scans_of(tmp_path / "bag"))


ROBOTLASER = (
    "ROBOTLASER1 0 -1.570796 3.141593 0.017453 {limit} 0.010000 0 4 1.00 2.00 30.00 {limit} 0 "
    "{x} 0.0 0.0 {y} 0.0 0.0 0.0 0.0 0.5 0.5 100000 {time} host 1.5"
)


def test_robotlaser_lines_are_read(tmp_path):
    lines = [
        ROBOTLASER.format(limit=50, x=k + 0.2, y=k, time=f"{START + k}.250000") for k in range(6)
    ]
    found = import_carmen(write_log(tmp_path / "a.log", lines), tmp_path / "bag")
    assert found.kind == "ROBOTLASER1"
    assert found.laser == (0.2, 0.0, 0.0)
    first = scans_of(tmp_path / "bag")[0]
    assert first.ranges.tolist() == [1.0, 2.0, 30.0, np.inf]
    assert first.stamp_ns == START * 10**9 + 250_000_000
    assert first.angle_increment == pytest.approx(0.017453)
    assert first.range_max == 50.0


@pytest.mark.parametrize("blank", ["  {}", "{}\r", "\t{}  "])
def test_blanks_and_tabs_separate_words(tmp_path, blank):
    lines = [flaser(START + 0.2 * k, (0.1 * k, 0.0, 0.0)) for k in range(4)]
    lines = [blank.format(line.replace(" ", "\t", 1)) for line in lines]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert (found.scans, found.odometry, found.damaged) == (4, 4, 0)


def test_raw_scans_take_odometry_from_its_own_lines(tmp_path):
    lines = []
    for k in range(6):
        lines.append(f"ODOM {k}.0 0 0 0 0 0 {START + k}.000000 host 0")
        lines.append(f"RAWLASER1 0 -1.5 3.1 0.5 80 0.01 0 3 1 2 3 0 {START + k}.500000 host 0")
    found = import_carmen(write_log(tmp_path / "a.log", lines), tmp_path / "bag")
    assert (found.kind, found.scans, found.odometry) == ("RAWLASER1", 6, 6)
    odometry = [r for r in records(tmp_path / "bag") if isinstance(r, Odometry)]
    assert [planar(o.T_odom_base)[0] for o in odometry] == [0, 1, 2, 3, 4, 5]


def brute_force_stamps(times, step):
    """Return the isotonic fit by its min-max formula: max over i <= k of min over j >= k."""
    y = [Fraction(t - k * step) for k, t in enumerate(times)]
    n = len(y)
    fit = [
        max(min(sum(y[i : j + 1]) / (j - i + 1) for j in range(k, n)) for i in range(k + 1))
        for k in range(n)
    ]
    return [math.floor(value) + k * step for k, value in enumerate(fit)]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.integers(0, 50_000), min_size=1, max_size=9))
def test_stamps_are_the_exact_isotonic_fit(times):
    stamps = increasing_stamps(times)
    assert stamps == brute_force_stamps(times, 1000)
    assert all(b - a >= 1000 for a, b in pairwise(stamps))
    if all(b - a >= 1000 for a, b in pairwise(times)):
        assert stamps == times


def test_file_order_is_kept_and_stamps_csv_says_so(tmp_path):
    times = [START + t for t in (0.0, 0.2, 0.1, 0.3, 0.4)]
    lines = [flaser(t, ranges=[1.0 + k] * 180) for k, t in enumerate(times)]
    lines.insert(2, "FLASER 180 1.0 broken")
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    scans = scans_of(tmp_path / "bag")
    assert [float(s.ranges[0]) for s in scans] == [1, 2, 3, 4, 5]
    table = np.genfromtxt(tmp_path / "bag" / "stamps.csv", delimiter=",", names=True, dtype=None)
    assert table["raw_scan_index"].tolist() == [0, 1, 3, 4, 5]
    text = (tmp_path / "bag" / "stamps.csv").read_text().splitlines()
    assert text[0] == "raw_scan_index,ipc_time,stamp"
    assert text[1] == f"0,{START}.000000000,{START}.000000000"
    stamps = [s.stamp_ns - START * 10**9 for s in scans]
    assert stamps == [0, 149_999_500, 150_000_500, 300_000_000, 400_000_000]
    assert (found.steps_back, found.damaged) == (1, 1)
    assert found.moved_s == pytest.approx(0.05, abs=1e-5)


def test_a_scan_with_a_stamp_far_from_its_neighbours_is_left_out(tmp_path):
    times = [START + 0.2 * k for k in range(20)]
    times[7] += 1e8
    lines = [flaser(t) for t in times]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert (found.scans, found.damaged, found.moved_s) == (19, 1, 0.0)


def test_scans_after_a_pause_are_kept(tmp_path):
    times = [START + 100.0 * k for k in range(10)]
    found = import_carmen(
        write_log(tmp_path / "a.clf", [flaser(t) for t in times]), tmp_path / "bag"
    )
    assert (found.scans, found.moved_s) == (10, 0.0)


@pytest.mark.parametrize("pack", [bz2.compress, gzip.compress])
def test_compressed_logs_are_read(tmp_path, pack):
    text = "\n".join(flaser(START + k) for k in range(3)).encode()
    (tmp_path / "a.log").write_bytes(pack(text))
    assert import_carmen(tmp_path / "a.log", tmp_path / "bag").scans == 3


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b"", "no scans"),
        (b"ODOM 0 0 0 0 0 0 1.0 host 0\n", "lines found: 1 ODOM"),
        (bytes(range(256)) * 10, "no scans"),
        (b"BZh91AY garbage", "cannot be read"),
        (gzip.compress(b"FLASER" * 10_000, mtime=0)[:40], "cannot be read"),
        (b"FLASER 1000000000 1.0\n", r"1 FLASER \(1 damaged\)"),
    ],
)
def test_logs_without_scans_are_errors(tmp_path, content, cause):
    (tmp_path / "a.clf").write_bytes(content)
    with pytest.raises(LogError, match=cause):
        import_carmen(tmp_path / "a.clf", tmp_path / "bag")
    assert [p.name for p in tmp_path.iterdir()] == ["a.clf"]


def test_missing_logs_and_outputs_that_are_no_folder_are_errors(tmp_path):
    with pytest.raises(LogError, match="absent"):
        import_carmen(tmp_path / "absent.clf", tmp_path / "bag")
    log = write_log(tmp_path / "a.clf", [flaser(START)])
    with pytest.raises(OutputError, match="name a folder"):
        import_carmen(log, tmp_path / "bag.mcap")


def test_the_same_log_gives_the_same_bytes(tmp_path):
    log = write_log(tmp_path / "a.clf", [flaser(START + k) for k in range(5)])
    for name in ("one", "two"):
        import_carmen(log, tmp_path / name / "bag")
    for file in ("bag.mcap", "metadata.yaml", "stamps.csv"):
        first, second = (tmp_path / name / "bag" / file for name in ("one", "two"))
        assert first.read_bytes() == second.read_bytes()


HEADER = """\
# CARMEN Logfile
# file format is one message per line
# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp
# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta
PARAM robot_use_laser on nohost 0
PARAM robot_frontlaser_offset 0.0 nohost 0
SYNC dummy 0 nohost 0
TRUEPOS 0 0 0 0 0 0 0 nohost 0"""


def test_other_lines_are_skipped_and_a_truncated_last_line_is_damaged(tmp_path):
    whole = [flaser(START + k, (0.1 * k, 0.0, 0.0)) for k in range(5)]
    lines = [HEADER, *whole[:4], f"MARKER 1 2 3 {START} nohost 0", whole[4][: len(whole[4]) // 2]]
    (tmp_path / "a.clf").write_text("\n".join(lines))
    found = import_carmen(tmp_path / "a.clf", tmp_path / "bag")
    assert (found.scans, found.odometry, found.damaged) == (4, 4, 1)


def test_one_reading_more_than_stated_on_all_lines_is_read(tmp_path):
    """`FLASER 180` with 181 readings: the bearings are those of 181, and the poses are found."""
    rows = [[1.0 + 0.01 * i for i in range(181)] for _ in range(6)]
    poses = [(0.1 * k, 0.2, 0.3) for k in range(6)]
    lines = [flaser(START + k, poses[k], ranges=row) for k, row in enumerate(rows)]
    lines = [line.replace("FLASER 181", "FLASER 180") for line in lines]
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert (found.scans, found.damaged) == (6, 0)
    got = records(tmp_path / "bag")
    scan = next(r for r in got if isinstance(r, Scan))
    np.testing.assert_allclose(scan.ranges, rows[0], atol=0.006)
    assert math.degrees(scan.angle_increment) == pytest.approx(1.0)
    odometry = [planar(r.T_odom_base) for r in got if isinstance(r, Odometry)]
    np.testing.assert_allclose(odometry, poses, atol=1e-9)


def test_one_reading_more_than_stated_on_one_line_is_damage(tmp_path):
    lines = [flaser(START + k) for k in range(6)]
    lines[3] = lines[3].replace("1.50", "1. 50", 1)
    found = import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    assert (found.scans, found.damaged) == (5, 1)


def test_remission_values_are_skipped(tmp_path):
    line = (
        "ROBOTLASER1 0 -1.570796 3.141593 0.785398 50 0.010000 1 5 1.00 2.00 3.00 4.00 5.00 "
        "5 100 200 300 400 500 {x}.2 0.0 0.0 {x}.0 0.0 0.0 0.1 0.0 0.5 0.5 100000 {time} host 1.5"
    )
    lines = [line.format(x=k, time=f"{START + k}.500000") for k in range(5)]
    found = import_carmen(write_log(tmp_path / "a.log", lines), tmp_path / "bag")
    assert (found.scans, found.damaged, found.laser) == (5, 0, (0.2, 0.0, 0.0))
    got = records(tmp_path / "bag")
    scan = next(r for r in got if isinstance(r, Scan))
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert scan.stamp_ns == START * 10**9 + 500_000_000
    odometry = [planar(r.T_odom_base)[0] for r in got if isinstance(r, Odometry)]
    assert odometry == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("step", [-3600.0, -float(START)])
def test_stamps_increase_after_a_clock_was_set_back(tmp_path, step):
    times = [START + 0.2 * k + (step if k >= 10 else 0.0) for k in range(20)]
    found = import_carmen(
        write_log(tmp_path / "a.clf", [flaser(t) for t in times]), tmp_path / "bag"
    )
    stamps = [s.stamp_ns for s in scans_of(tmp_path / "bag")]
    # Microseconds of the log's text.
    np.testing.assert_allclose(np.diff(stamps), 200_000_000, atol=2_000)
    assert (found.scans, found.damaged, found.steps_back) == (20, 0, 1)


def test_odometry_is_shifted_with_the_scans_after_a_clock_was_set_back(tmp_path):
    lines = []
    for k in range(20):
        time = START + k - (5000 if k >= 10 else 0)
        lines.append(f"ODOM {k}.0 0 0 0 0 0 {time}.000000 host 0")
        lines.append(f"RAWLASER1 0 -1.5 3.1 0.5 80 0.01 0 3 1 2 3 0 {time}.500000 host 0")
    import_carmen(write_log(tmp_path / "a.log", lines), tmp_path / "bag")
    got = records(tmp_path / "bag")
    odometry = [r.stamp_ns for r in got if isinstance(r, Odometry)]
    scans = [r.stamp_ns for r in got if isinstance(r, Scan)]
    between = np.array([t for pair in zip(odometry, scans) for t in pair])
    assert len(between) == 40
    assert (np.diff(between) > 0).all()


@pytest.mark.parametrize(("logged", "step"), [(0.2, 200_000_000), (0.0, 1_000)])
def test_the_clock_of_the_logger_is_used_where_the_other_one_is_constant(tmp_path, logged, step):
    lines = [flaser(START).rsplit(" ", 1)[0] + f" {5 + logged * k:.6f}" for k in range(8)]
    import_carmen(write_log(tmp_path / "a.clf", lines), tmp_path / "bag")
    stamps = [s.stamp_ns for s in scans_of(tmp_path / "bag")]
    np.testing.assert_array_equal(np.diff(stamps), step)
    text = (tmp_path / "bag" / "stamps.csv").read_text().splitlines()
    assert text[1].startswith(f"0,{START}.000000000,")


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 9 * 10**9), min_size=1, max_size=20))
def test_only_a_clock_set_back_by_far_is_changed(times):
    assert without_resets(times) == times
    assert without_resets([t + 10**11 for t in times] + times)[: len(times)] == [
        t + 10**11 for t in times
    ]


words = st.sampled_from(
    [
        *("FLASER", "ROBOTLASER1", "RAWLASER1", "ODOM", "PARAM", "1", "2", "0", "-1", "1e400"),
        *("nan", "1.5", "\n", "99999999999", "x", "", "1_0", "\u0661", "2147483648.0", "\0"),
    ]
)


@settings(max_examples=150, deadline=None)
@given(st.lists(words, max_size=60), st.booleans())
def test_any_text_is_a_bag_or_an_error(parts, with_scan):
    text = " ".join(parts)
    if with_scan:
        text += "\n" + "\n".join([flaser(START), "FLASER 2 " + text, flaser(START + 1)])
    with TemporaryDirectory() as folder:
        log = Path(folder) / "a.clf"
        log.write_bytes(text.encode("utf-8", "surrogateescape"))
        with suppress(TccmError):
            found = import_carmen(log, Path(folder) / "bag")
            assert len(scans_of(Path(folder) / "bag")) == found.scans


@settings(max_examples=60, deadline=None)
@given(place=st.integers(0, 10**6), piece=st.binary(min_size=1, max_size=3))
def test_damaged_bytes_damage_one_line_only(place, piece):
    data = bytearray("\n".join(flaser(START + k) for k in range(4)).encode())
    at = 3 + place % (len(data) - len(piece) - 3)  # the first three tell a compressed file
    data[at : at + len(piece)] = piece
    with TemporaryDirectory() as folder:
        log = Path(folder) / "a.clf"
        log.write_bytes(data)
        assert import_carmen(log, Path(folder) / "bag").scans >= 2


def path_length(bag):
    poses = np.array([planar(r.T_odom_base) for r in records(bag) if isinstance(r, Odometry)])
    return np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()


@pytest.mark.parametrize(
    ("name", "scans", "length", "back"), [("intel", 13631, 508, 631), ("mit-csail", 1988, 374, 0)]
)
def test_real_logs_are_imported(tmp_path, name, scans, length, back):
    found = import_carmen(shared(f"carmen/{name}.clf.bz2"), tmp_path / "bag")
    assert (found.scans, found.steps_back, found.laser) == (scans, back, (0.0, 0.0, 0.0))
    assert (found.damaged, found.range_max) == (0, 80.0)
    assert path_length(tmp_path / "bag") == pytest.approx(length, abs=1.0)
    table = np.genfromtxt(tmp_path / "bag" / "stamps.csv", delimiter=",", names=True)
    reference = np.loadtxt(shared(f"carmen/{name}_reference.txt"))
    rows = reference[:, 0].astype(int)
    np.testing.assert_allclose(table["ipc_time"][rows], reference[:, 1], atol=1e-6)
    assert (np.diff(table["stamp"]) > 0).all()
