"""Scans with their poses: bracketed or counted once, and arrival order does not show."""

from dataclasses import replace

import numpy as np
import pytest
from fed import role_of
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import (
    MS,
    START,
    TILTING,
    description,
    joint,
    joints_at,
    odometry_at,
    robot,
    scan_at,
    transform_at,
)

from tccm_ros.config.reader import read_config
from tccm_ros.errors import TopicError
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import (
    JointSample,
    MapReset,
    Odometry,
    PosedScan,
    RobotDescription,
    Scan,
    StreamComplete,
    TiltAngle,
    TransformSample,
)
from tccm_ros.robot import Robot
from tccm_ros.robot.base_motion import MotionSource
from tccm_ros.sensors.laser_scan import TILT_SCAN, project, used_beams
from tccm_ros.sensors.registry import default_streams


class Taken:
    """A robot whose scans are all of one laser, and the events that came of its records."""

    def __init__(self, settings=(), scans="tilt_scan", **options):
        self.robot = Robot(read_config(None, list(settings)), default_streams(), **options)
        self.sensor = self.robot.sensors[scans]
        self.dropped = self.sensor.dropped
        self.events = []

    def add(self, record):
        """Add one record; return the scans that are posed now."""
        return self._note(self.robot.add(role_of(record, self.sensor.stream.role), record))

    def flush(self):
        return self._note(self.robot.flush())

    def _note(self, events):
        self.events += events
        return [event for event in events if isinstance(event, PosedScan)]

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]


def play(taken, records):
    return [posed for record in records for posed in taken.add(record)] + taken.flush()


def times(posed):
    return [(p.scan.stamp_ns - START) // MS for p in posed]


def stamp(ms):
    return START + round(ms * MS)


def drive(end_ms, *, scans=25, joints=10, odometry=20, without=()):
    """A robot that drives at 1 m/s and tilts at 1 rad/s, in order of stamps."""
    records = [description()]
    for ms in range(0, end_ms + 1):
        if ms % joints == 0 and "joints" not in without:
            records.append(joints_at(stamp(ms), tilt=ms / 1000))
        if ms % odometry == 0 and "odometry" not in without:
            records.append(odometry_at(stamp(ms), (ms / 1000, 0, 0, 0, 0, 0)))
        if ms % scans == 0 and ms <= end_ms - 20 and "scans" not in without:
            records.append(scan_at(stamp(ms), time_increment=0.005))
    return records


def test_every_scan_gets_the_poses_of_its_beams():
    posed = play(Taken(), drive(1000))
    assert times(posed) == list(range(0, 1000, 25))[: len(posed)]
    assert len(posed) == 40
    for p in posed:
        begin, end = p.scan.stamp_ns, p.scan.end_ns
        assert end == begin + 10 * MS
        assert p.pose_stamps_ns[0] == begin
        assert p.pose_stamps_ns[-1] == end
        assert (np.diff(p.pose_stamps_ns) > 0).all()
        assert (np.diff(p.pose_stamps_ns) <= 10 * MS).all()
        seconds = (p.pose_stamps_ns - START) * 1e-9
        np.testing.assert_allclose(p.T_odom_base[:, 0, 3], seconds, atol=1e-9)
        for t, T in zip(seconds, p.T_base_laser):
            expected = pose_from_rpy((0.1, 0, 1, 0, t, 0)) @ pose_from_rpy((0.05, 0, 0.02, 0, 0, 0))
            np.testing.assert_allclose(T, expected, atol=1e-9)


def with_increments(records, factor):
    """Return records with the time increments of scans multiplied, as in another unit."""
    return [
        replace(r, time_increment=r.time_increment * factor) if isinstance(r, Scan) else r
        for r in records
    ]


def test_scans_whose_times_are_in_milliseconds_are_dropped_and_named():
    taken = Taken()
    posed = play(taken, with_increments(drive(1000), 1000.0))
    assert posed == []
    assert dict(taken.dropped) == {
        "lasts longer than the time between stamps: look at the unit of its times": 40
    }


def test_scans_with_times_in_a_wrong_unit_are_used_and_reported():
    taken = Taken()
    posed = play(taken, with_increments(drive(1000), 0.001))
    assert len(posed) == 40
    (remark,) = taken.robot.remarks
    assert "less than 1 % of the time between stamps: look at their unit" in remark


def test_pose_samples_include_the_samples_within_the_scan():
    records = drive(200, without=["scans"])
    records.append(scan_at(stamp(95), time_increment=0.030, ranges=(1.0, 1.0)))
    records += drive(1500, without=["scans"])[1:]
    (posed,) = play(Taken(), records)
    inside = {100, 110, 120}  # joints; odometry's are among them
    assert inside < set((posed.pose_stamps_ns - START) // MS)


def test_a_scan_whose_beams_have_one_time_has_one_pose_sample():
    records = [*drive(500, without=["scans"]), scan_at(stamp(333)), *drive(500)[:0]]
    (posed,) = play(Taken(), records)
    assert posed.pose_stamps_ns.tolist() == [stamp(333)]
    assert posed.T_odom_base.shape == (1, 4, 4)


def test_the_poses_of_beams_stamped_backwards_begin_at_the_last_beam():
    records = [*drive(500), scan_at(stamp(510), time_increment=-0.005)]
    records += [joints_at(stamp(520), tilt=0.52), odometry_at(stamp(520), (0.52, 0, 0, 0, 0, 0))]
    posed = play(Taken(), records)[-1]
    assert posed.pose_stamps_ns[0] == stamp(500)
    assert posed.pose_stamps_ns[-1] == stamp(510)


@pytest.mark.parametrize("lost", ["joints", "odometry"])
def test_a_gap_in_the_samples_drops_the_scans_in_it(lost):
    kind = {"joints": JointSample, "odometry": Odometry}[lost]
    gap = (stamp(1000), stamp(1400))
    records = [r for r in drive(2000) if not (isinstance(r, kind) and gap[0] < r.stamp_ns < gap[1])]
    taken = Taken()
    posed = play(taken, records)
    reason = {"joints": "no joint samples", "odometry": "no odometry"}[lost]
    # those that begin within the gap; the one before may reach into it
    lost_scans = {*range(1000, 1400, 25)}
    assert not lost_scans & set(times(posed))
    assert taken.dropped[reason] >= len(lost_scans)
    assert taken.dropped.total() + len(posed) == taken.sensor.received == 80


def test_a_short_gap_in_the_samples_is_interpolated():
    records = [
        r
        for r in drive(1000)
        if not (isinstance(r, JointSample) and stamp(400) < r.stamp_ns < stamp(640))
    ]
    taken = Taken()
    assert len(play(taken, records)) == 40
    assert not taken.dropped


def test_a_silent_joint_is_named():
    taken = Taken()
    records = drive(2000, without=["joints"])
    records.insert(5, joints_at(stamp(1), tild=0.0))
    assert play(taken, records) == []
    assert taken.dropped == {"no joint samples": 80}
    assert "joint 'tilt'" in str(taken.sensor.problem)
    assert "did you mean 'tild'" in str(taken.sensor.problem)


def test_no_way_to_the_laser_is_counted_and_explained():
    taken = Taken()
    records = [r for r in drive(1000) if not isinstance(r, RobotDescription)]
    records.insert(0, description(TILTING.replace("laser", "lidar")))
    assert play(taken, records) == []
    assert taken.dropped == {"no way from base to sensor": 40}
    assert "no frame 'laser'" in str(taken.sensor.problem)


def test_scans_wait_no_longer_than_the_timeout():
    taken = Taken()
    for record in drive(300):
        taken.add(record)
    late = [scan_at(stamp(ms)) for ms in range(325, 1000, 25)]
    dropped = []
    for record in late:
        taken.add(record)
        dropped.append(taken.dropped.total())
    assert dropped[0] == 0
    assert dropped[-1] > 0
    first = next(i for i, n in enumerate(dropped) if n)
    assert 800 <= 325 + 25 * first <= 900


def test_a_stream_that_lags_but_comes_is_waited_for():
    """After a stall the executor hands out one message per topic in turn: slow topics lead."""
    scans = [r for r in drive(4000) if isinstance(r, Scan)]
    rest = [r for r in drive(4000) if not isinstance(r, Scan)]
    taken, posed = Taken(), []
    for record in rest[:60]:
        posed += taken.add(record)
    rest = rest[60:]
    while scans or rest:  # scans at 40 Hz, 150 other records a second: behind by up to 2.9 s
        for queue in (scans, rest):
            if queue:
                posed += taken.add(queue.pop(0))
    posed += taken.flush()
    assert len(posed) == 160
    assert not taken.dropped


# -- odometry --------------------------------------------------


def test_without_odometry_the_base_stands_still():
    taken = Taken()
    posed = play(taken, drive(2000, without=["odometry"]))
    assert len(posed) == 80
    assert taken.robot.motion.source is MotionSource.STILL
    assert (posed[-1].T_odom_base == np.eye(4)).all()
    assert not taken.of(MapReset)


def test_an_expected_odometry_is_not_replaced():
    taken = Taken(expects_odometry=True)
    assert play(taken, drive(2000, without=["odometry"])) == []
    assert taken.dropped == {"no odometry": 80}


def test_odometry_that_comes_late_begins_a_new_map():
    records = [r for r in drive(2000) if not (isinstance(r, Odometry) and r.stamp_ns < stamp(1000))]
    taken = Taken()
    posed = play(taken, records)
    assert len(taken.of(MapReset)) == 1
    assert taken.robot.motion.source is MotionSource.ODOMETRY
    assert posed[-1].T_odom_base[0, 0, 3] > 1.5


@pytest.mark.parametrize("odom_frame", ["odom", "world_odom"])
def test_tf_gives_the_motion_of_the_base_where_there_is_no_odometry(odom_frame):
    records = []
    for record in drive(2000):
        if isinstance(record, Odometry):
            x = record.T_odom_base[0, 3]
            record = transform_at(record.stamp_ns, odom_frame, "base", (x, 0, 0, 0, 0, 0))
        records.append(record)
    taken = Taken()
    posed = play(taken, records)
    assert taken.robot.motion.source is MotionSource.TF
    assert taken.robot.motion.odom_frame == odom_frame
    assert len(posed) == 80
    reference = play(Taken(), drive(2000))
    for a, b in zip(posed, reference):
        np.testing.assert_allclose(a.T_odom_base, b.T_odom_base, atol=1e-12)


def test_odometry_of_another_frame_is_moved_to_the_base():
    text = robot(
        [
            joint("feet", "fixed", "footprint", "base", xyz="0 0 0.25"),
            joint("tilt", "revolute", "base", "laser", xyz="0 0 1"),
        ]
    )
    records = [description(text)]
    for k in range(0, 100, 10):
        records += [joints_at(stamp(k), tilt=0.0), odometry_at(stamp(k), child="footprint")]
    records.append(scan_at(stamp(50)))
    (posed,) = play(Taken(["frames.base=base"]), records)
    np.testing.assert_allclose(posed.T_odom_base[0, :3, 3], [0, 0, 0.25])
    np.testing.assert_allclose(posed.T_base_laser[0, :3, 3], [0, 0, 1])
    (posed,) = play(Taken(), records)
    np.testing.assert_allclose(posed.T_odom_base[0, :3, 3], [0, 0, 0])
    np.testing.assert_allclose(posed.T_base_laser[0, :3, 3], [0, 0, 1.25])


# -- stamps --------------------------------------------------


def test_scans_with_bad_stamps_are_counted():
    records = drive(1000)
    at = next(i for i, r in enumerate(records) if isinstance(r, Scan) and r.stamp_ns == stamp(500))
    records.insert(at + 1, scan_at(stamp(500)))
    records.insert(at + 3, scan_at(stamp(300)))
    records.insert(at + 5, scan_at(stamp(3_600_000)))
    records.insert(at + 9, joints_at(stamp(3_600_000), tilt=0.0))
    records.insert(at + 11, odometry_at(stamp(-3_600_000)))
    taken = Taken()
    posed = play(taken, records)
    assert len(posed) == 40
    assert taken.dropped["duplicate stamp"] == 1
    assert taken.dropped["out of order"] == 1
    assert taken.dropped["future stamp"] == 1
    assert taken.robot.refused["joint_states: future stamp"] == 1
    assert taken.robot.refused["odom: out of order"] == 1
    assert taken.sensor.received == len(posed) + taken.dropped.total()


def test_an_arm_with_a_clock_of_its_own_harms_nothing():
    records = drive(2000)
    for k in range(200):
        records.insert(10 + 2 * k, joints_at(stamp(3_600_000 + 10 * k), elbow=0.0))
    assert len(play(Taken(), records)) == 80


def test_malformed_records_are_counted():
    records = drive(1000)
    bad = [
        scan_at(stamp(201), ranges=()),
        scan_at(stamp(202), time_increment=np.nan),
        scan_at(stamp(203), angle_min=np.inf),
        scan_at(stamp(204), time_increment=1e6),
        odometry_at(stamp(205), (np.nan, 0, 0, 0, 0, 0)),
        transform_at(stamp(206), "a", "b", (np.inf, 0, 0, 0, 0, 0)),
    ]
    records = sorted(records[1:] + bad, key=lambda r: r.stamp_ns)
    taken = Taken()
    assert len(play(taken, [description(), *records])) == 40
    assert taken.dropped["empty"] == 1
    assert taken.dropped["malformed"] == 3
    assert taken.robot.refused == {"odom: malformed": 1, "tf: malformed": 1}


def test_scans_that_overtake_each_other_come_out_in_order():
    records = drive(2000)
    rng = np.random.default_rng(3)
    arrivals = [getattr(r, "stamp_ns", 0) for r in records]
    late = [a + rng.integers(0, 50 * MS) * isinstance(r, Scan) for a, r in zip(arrivals, records)]
    mixed = [records[k] for k in np.argsort(late, kind="stable")]
    for window_s, is_lossless in ((0.05, True), (0.0, False)):
        taken = Taken([f"reorder_window={window_s}"])
        posed = play(taken, mixed)
        assert times(posed) == sorted(times(posed))
        assert (len(posed) == 80) == is_lossless
        assert (taken.dropped["out of order"] == 0) == is_lossless


def test_a_clock_jump_is_an_event_and_scans_are_posed_again_after_it():
    taken = Taken()
    posed = []
    for record in drive(1000):
        posed += taken.add(record)
    assert not taken.of(MapReset)
    earlier = [scan_at(r.stamp_ns) if isinstance(r, Scan) else r for r in drive(1000)]
    shift = 3_600_000 * MS
    for record in earlier[1:]:
        moved = {f: getattr(record, f) for f in record.__slots__}
        moved["stamp_ns"] -= shift
        posed += taken.add(type(record)(**moved))
    posed += taken.flush()
    assert len(taken.of(MapReset)) == 1
    assert sum(p.scan.stamp_ns < START - shift // 2 for p in posed) == 40
    assert taken.sensor.received == 80
    assert taken.sensor.posed + taken.dropped.total() == 80


def test_waiting_scans_are_bounded():
    taken = Taken(["sync_timeout=60"])
    taken.add(description())
    for k in range(TILT_SCAN.max_waiting + 50):
        taken.add(scan_at(stamp(k)))
    assert taken.dropped["overload"] > 0
    assert len(taken.sensor.waiting) == TILT_SCAN.max_waiting


# -- arrival order --------------------------------------------------


def faulty_streams(lost, seed):
    """Streams with losses, duplicates, reordering and outliers, each in its own order."""
    end, random = 1500, np.random.default_rng(seed)
    scans = [scan_at(stamp(ms), time_increment=0.005) for ms in range(0, end, 50)]
    tilts = [joints_at(stamp(ms), tilt=ms / 1000) for ms in range(0, end, 20)]
    lifts = [joints_at(stamp(ms + 3), lift=0.0) for ms in range(0, end, 40)]
    moves = [odometry_at(stamp(ms + 7), (ms / 1000, 0, 0, 0, 0, 0)) for ms in range(-40, end, 30)]
    for stream, (first, count) in zip((scans, tilts, moves), lost):
        del stream[first : first + count]
        i = random.integers(0, len(stream) - 1)
        stream.insert(i, stream[i + 1])
        i = random.integers(1, len(stream) - 1)
        stream.insert(i, outlier(stream[i]))
    return scans, tilts, lifts, moves


def outlier(record):
    fields = {f: getattr(record, f) for f in record.__slots__}
    fields["stamp_ns"] += 3600 * 1000 * MS
    return type(record)(**fields)


def arrivals(streams, seed):
    """Interleave streams, each in its own order; topics differ by up to 0.2 s."""
    random, arriving = np.random.default_rng(seed), []
    for stream in streams:
        at = -np.inf
        for record in stream:
            if record.stamp_ns < stamp(10_000):
                at = max(at, record.stamp_ns + random.uniform(0, 200) * MS)
            arriving.append((at, len(arriving), record))
    return [record for *_, record in sorted(arriving, key=lambda a: a[:2])]


def outcome(records):
    taken = Taken(expects_odometry=True)
    posed = play(taken, [description(LIFTED), *records])
    scans = [
        (
            p.scan.stamp_ns,
            hash((p.pose_stamps_ns.tobytes(), p.T_odom_base.tobytes(), p.T_base_laser.tobytes())),
        )
        for p in posed
    ]
    received = taken.sensor.received
    counts = received, taken.sensor.posed, taken.robot.refused, len(taken.of(MapReset))
    return scans, taken.dropped, counts, hash(tuple(taken.of(TiltAngle)))


LIFTED = robot(
    [
        joint("lift", "prismatic", "base", "waist", axis="0 0 1"),
        joint("tilt", "revolute", "waist", "laser", xyz="0 0 1"),
    ]
)


losses = st.tuples(st.integers(0, 12), st.integers(0, 16))


@given(st.tuples(losses, losses, losses), st.integers(0, 999), st.integers(0, 999))
@settings(max_examples=80, deadline=None)
def test_result_is_independent_of_arrival_order(lost, seed, order_seed):
    streams = faulty_streams(lost, seed)
    first = outcome(arrivals(streams, order_seed))
    assert first == outcome(arrivals(streams, order_seed + 1))
    scans, dropped, counts, _ = first
    assert [s[0] for s in scans] == sorted({s[0] for s in scans})
    assert len(scans) + dropped.total() == counts[0]


def test_stationary_without_odometry_is_the_same_however_topics_interleave():
    records = drive(1500, without=["odometry"])
    delayed = sorted(
        records[1:], key=lambda r: r.stamp_ns + (150 * MS if isinstance(r, Scan) else 0)
    )
    a, b = (play(Taken(), order) for order in (records, [records[0], *delayed]))
    assert times(a) == times(b)
    assert all((p.T_base_laser == q.T_base_laser).all() for p, q in zip(a, b))


# -- anything at all --------------------------------------------------

stamps = st.one_of(st.integers(-(2**31), 2**31), st.integers(0, 30)).map(lambda s: s * 100 * MS)
numbers = st.floats(width=32)
frames = st.sampled_from(["base", "/base", "laser", "cradle", "odom", "", "x"])


@st.composite
def anything(draw):
    """A record with any values that a message can have."""
    kind, at = draw(st.integers(0, 4)), draw(stamps)
    if kind == 0:
        ranges = draw(st.lists(numbers, max_size=4))
        fields = {
            name: draw(numbers)
            for name in ("time_increment", "angle_min", "angle_increment", "range_min", "range_max")
        }
        return scan_at(at, draw(frames), ranges, **fields)
    if kind == 1:
        names = draw(st.lists(st.sampled_from(["tilt", "", "a"]), max_size=3))
        values = draw(st.lists(numbers, max_size=3))
        return JointSample(at, tuple(names), np.array(values))
    T = np.eye(4)
    T[:3, 3] = draw(st.tuples(numbers, numbers, numbers))
    if kind == 2:
        return Odometry(at, draw(frames), draw(frames), T)
    return TransformSample(at, draw(frames), draw(frames), T, kind == 3)


@given(st.lists(anything(), max_size=30), st.booleans())
@settings(max_examples=150, deadline=None)
def test_every_scan_is_posed_or_counted(records, with_description):
    taken = Taken()
    if with_description:
        taken.add(description())
    posed = play(taken, records)
    assert len(posed) + taken.dropped.total() == taken.sensor.received
    assert taken.sensor.received == sum(isinstance(r, Scan) for r in records)
    for p in posed:
        assert p.pose_stamps_ns[0] <= p.scan.stamp_ns <= p.pose_stamps_ns[-1]
        with np.errstate(all="ignore"):
            project(p, used_beams(p, read_config(None)))


# -- several sensors --------------------------------------------------


def both_lasers(end_ms=1500):
    """The records of `drive`, by role, and scans of a level laser among them."""
    records = [(role_of(record), record) for record in drive(end_ms)]
    for ms in range(0, end_ms - 20, 40):
        record = scan_at(stamp(ms), frame="front_laser", time_increment=0.001)
        at = next(i for i, (_, r) in enumerate(records[1:], 1) if r.stamp_ns >= record.stamp_ns)
        records.insert(at, ("scan", record))
    return records


def posed_bytes(events, role):
    return [
        (e.stamp_ns, e.pose_stamps_ns.tobytes(), e.T_odom_base.tobytes(), e.T_base_laser.tobytes())
        for e in events
        if isinstance(e, PosedScan) and e.role == role
    ]


def events_of(records, **options):
    """Return the robot and all events of (role, record)."""
    one = Robot(read_config(None), default_streams(), **options)
    return one, [e for role, record in records for e in one.add(role, record)] + one.flush()


@pytest.mark.parametrize("role", ["tilt_scan", "scan"])
def test_each_of_two_lasers_on_a_robot_is_posed_as_if_alone(role):
    records = both_lasers()
    one, together = events_of(records)
    alone = events_of([r for r in records if r[0] not in ("tilt_scan", "scan") or r[0] == role])[1]
    assert len(posed_bytes(alone, role)) > 30
    assert posed_bytes(together, role) == posed_bytes(alone, role)
    assert one.sensors[role].received == len(posed_bytes(together, role))


def test_each_laser_has_its_own_counts_and_problem():
    records = [
        (role, scan_at(r.stamp_ns, frame="nowhere") if role == "scan" else r)
        for role, r in both_lasers()
    ]
    one, events = events_of(records)
    assert not one.sensors["tilt_scan"].dropped
    assert one.sensors["tilt_scan"].problem is None
    assert set(one.sensors["scan"].dropped) == {"no way from base to sensor"}
    assert "nowhere" in str(one.sensors["scan"].problem)
    assert one.dropped == one.sensors["scan"].dropped
    assert len(posed_bytes(events, "tilt_scan")) == one.sensors["tilt_scan"].received


@given(st.integers(0, 999))
@settings(max_examples=20, deadline=None)
def test_result_is_independent_of_interleaving_of_two_lasers(seed):
    records = both_lasers(800)
    by_role = [[r for r in records[1:] if r[0] == role] for role in dict(records[1:])]
    random, arriving = np.random.default_rng(seed), []
    for stream in by_role:
        at = -np.inf
        for role, record in stream:
            at = max(at, record.stamp_ns + random.uniform(0, 200) * MS)
            arriving.append((at, len(arriving), (role, record)))
    interleaved = [records[0], *(item for *_, item in sorted(arriving, key=lambda a: a[:2]))]
    (one, straight), (other, late) = events_of(records), events_of(interleaved)
    for role in ("tilt_scan", "scan"):
        assert posed_bytes(late, role) == posed_bytes(straight, role)
        assert other.sensors[role].dropped == one.sensors[role].dropped
    for kind in (TiltAngle, Odometry):
        # The last samples are there in both, whenever they came.
        stamps = [
            [e.stamp_ns for e in events if isinstance(e, kind)] for events in (straight, late)
        ]
        assert stamps[0] == stamps[1]


def test_events_come_in_an_order_to_rely_on():
    """Motion and tilt angles that bracket a scan come before it, and nothing after completeness."""
    _, events = events_of(both_lasers(3000))
    moved = tilted = -1
    complete = {"tilt_scan": -1, "scan": -1}
    for event in events:
        if isinstance(event, Odometry):
            moved = event.stamp_ns
        elif isinstance(event, TiltAngle):
            assert event.role == "tilt_scan"
            assert event.stamp_ns > tilted
            tilted = event.stamp_ns
        elif isinstance(event, PosedScan):
            assert event.scan.end_ns <= moved
            assert event.role == "scan" or event.scan.end_ns <= tilted
            assert event.stamp_ns >= complete[event.role]
        elif isinstance(event, StreamComplete):
            assert event.until_ns >= complete[event.role]
            complete[event.role] = event.until_ns
    # Message time has gone on to the end, less what a scan waits for and how long it takes.
    assert complete["tilt_scan"] > stamp(3000 - 500 - 10 - 40)


def test_a_record_that_no_stream_takes_is_an_error():
    one = Robot(read_config(None), default_streams())
    with pytest.raises(TopicError, match=r"no stream takes a Scan on 'scans'.*'scan'"):
        one.add("scans", scan_at(START))
    with pytest.raises(TopicError, match="no stream takes a Scan on 'odom'"):
        one.add("odom", scan_at(START))


def test_no_pose_is_extrapolated():
    records = [description()]
    records += [joints_at(stamp(ms), tilt=0.0) for ms in range(0, 300, 10)]
    records += [odometry_at(stamp(ms)) for ms in range(0, 600, 10)]
    scans = [scan_at(stamp(ms)) for ms in (-1, 0, 145, 290, 291, 300)]
    taken = Taken()
    posed = play(taken, [*records, *scans])
    assert times(posed) == [0, 145, 290]
    assert taken.dropped == {"no joint samples": 2, "no odometry": 1}
