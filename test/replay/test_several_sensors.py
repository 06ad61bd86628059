"""Two tilting lasers at once, each with its own frame and joint, make one map."""

import json

import numpy as np
import pytest
from depth_room import MS, START_NS, TABLE, TOP, base_at, lengths
from message_families import TYPESTORE

from tccm_ros.bags.writer import BagWriter
from tccm_ros.config.reader import read_config
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.records import JointSample, Odometry, RobotDescription, Scan
from tccm_ros.replay.replay import replay
from tccm_ros.ros.writing import scan_message
from tccm_sim.sensor_messages import (
    joint_sample_message,
    odometry_message,
    robot_description_message,
)

MOUNTS = {"left": 0.5, "right": -0.5}
"""y of the lasers, m. The left one sees the left half of the table, the right one the rest."""

LINKS = "".join(f'<link name="{n}_head"/><link name="{n}_eye"/>' for n in MOUNTS)
JOINTS = "".join(
    f'<joint name="{n}_tilt" type="revolute"><parent link="base"/><child link="{n}_head"/>'
    f'<origin xyz="0 {y} 1.3"/><axis xyz="0 1 0"/>'
    '<limit lower="0" upper="1.5" effort="1" velocity="9"/></joint>'
    f'<joint name="{n}_mount" type="fixed"><parent link="{n}_head"/><child link="{n}_eye"/></joint>'
    for n, y in MOUNTS.items()
)
URDF = f'<robot name="two"><link name="base"/>{LINKS}{JOINTS}</robot>'


def tilt_at(name, ms):
    """Return the tilt, rad: triangles of which the right one comes half a period later."""
    phase = (ms / 1000.0 + 0.5 * (name == "right")) % 2.0
    return 0.25 + 0.8 * (phase if phase < 1.0 else 2.0 - phase)


def scan_at(name, ms):
    side = 1.0 if name == "left" else -1.0
    bearings = np.linspace(-0.55, 0.55, 111)
    T = base_at(ms) @ pose_from_rpy([0, MOUNTS[name], 1.3, 0, tilt_at(name, ms), 0])
    ranges = lengths(T, np.column_stack([np.cos(bearings), np.sin(bearings), 0 * bearings]))
    ends = T[:3, 3] + (np.column_stack([np.cos(bearings), np.sin(bearings), 0 * bearings])
                       @ T[:3, :3].T) * ranges[:, None]  # fmt: skip
    ranges = np.where(side * ends[:, 1] > 0.0, ranges, np.nan)
    step = float(bearings[1] - bearings[0])
    return Scan(
        START_NS + ms * MS, f"{name}_eye", -0.55, step, 0.0, 0.05, 30.0, ranges.astype(np.float32)
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("two") / "bag"
    with BagWriter(path, typestore=TYPESTORE) as writer:
        text = robot_description_message(TYPESTORE, RobotDescription(URDF))
        writer.write("/robot_description", "std_msgs/msg/String", START_NS, text)
        for ms in range(0, 6000, 20):
            now = START_NS + ms * MS
            odometry = odometry_message(TYPESTORE, Odometry(now, "odom", "base", base_at(ms)))
            writer.write("/odom", "nav_msgs/msg/Odometry", now, odometry)
            names = tuple(f"{name}_tilt" for name in MOUNTS)
            tilts = np.array([tilt_at(name, ms) for name in MOUNTS])
            joints = joint_sample_message(TYPESTORE, JointSample(now, names, tilts))
            writer.write("/joint_states", "sensor_msgs/msg/JointState", now, joints)
            for name in MOUNTS:
                scan = scan_message(TYPESTORE, scan_at(name, ms))
                writer.write(f"/{name}/tilt_scan", "sensor_msgs/msg/LaserScan", now, scan)
    return path


def tables(bag, out, topics):
    config = read_config(None, [f"sensors.tilt_scans=[{','.join(topics)}]"])
    summary = replay(bag, out, config, pictures=False)
    found = json.loads((out / "surfaces.json").read_text())["surfaces"]
    return summary.content.counts, [s for s in found if abs(s["height"] - TOP) < 0.1]


def test_two_tilting_lasers_map_the_table_of_which_each_sees_a_half(bag, tmp_path):
    width = TABLE[1][1] - TABLE[1][0]
    for name in MOUNTS:
        _, found = tables(bag, tmp_path / name, [f"{name}/tilt_scan"])
        (half,) = found
        y = np.array(half["boundary"])[:, 1]
        assert np.ptp(y) == pytest.approx(0.5 * width, abs=0.06)  # three cells of 20 mm
    counts, found = tables(bag, tmp_path / "both", [f"{name}/tilt_scan" for name in MOUNTS])
    (whole,) = found
    y = np.array(whole["boundary"])[:, 1]
    assert np.ptp(y) == pytest.approx(width, abs=0.06)
    assert whole["height"] == pytest.approx(TOP, abs=0.003)
    assert counts.cycles >= 4
    # Before the first reversal and after the last one nothing is certain.
    assert set(counts.dropped) <= {"short tilt cycle", "no joint samples", "no odometry"}
