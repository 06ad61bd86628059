"""Known errors of a simulated rig are recovered within the stated standard deviations."""

from pathlib import Path

import numpy as np
import pytest
from shared_data import shared

from tccm_ros.calibrate.calibration import Calibration, calibrate
from tccm_ros.calibrate.quality import select
from tccm_ros.calibrate.recording import CycleScans
from tccm_ros.calibrate.surroundings import near_another
from tccm_ros.config.reader import read_config
from tccm_sim.options import Options
from tccm_sim.recording import run as run_room
from tccm_sim.recording import simulate

CORNER = 0.08  # m: nearer hits could be of either plane

FLOOR_Z = 0.0

CASES = {
    "zero and scale": {"tilt_offset": 0.14, "tilt_scale": 0.965},
    "mount and delay": {"laser_roll": 0.02, "laser_height": 0.03, "joint_time_offset": 0.012},
    "level laser": {"level_error": (0.03, -0.02, 0.0, 0.0, 0.0, 0.02)},
    "clutter and people": {"tilt_offset": -0.05, "clutter": 40, "ramp": True, "people": True},
    # The laser looks down by 0.3 rad at most: the floor begins 2 m away.
    "floor far away": {
        "tilt_offset": 0.14, "tilt_scale": 0.965, "laser_roll": 0.02, "laser_height": 0.03,
        "joint_time_offset": 0.012, "clutter": 40, "ramp": True, "people": True,
        "tilt_limits": (-0.9, 0.3),
    },
}  # fmt: skip


def run(folder: Path, **options) -> Calibration:
    settings = {
        "tilt_beams": 181, "sigma": 0.006, "cycle_period": 2.0, "base_tilt": 0.0, "people": False,
    } | options  # fmt: skip
    simulate("room", folder, options=Options(**settings))
    return calibrate(folder, floor_z=FLOOR_Z)


def truth(options: dict) -> dict[str, float]:
    level = options.get("level_error", (0.0,) * 6)
    return {
        "tilt_offset": options.get("tilt_offset", 0.0),
        "tilt_scale": options.get("tilt_scale", 1.0),
        "roll": options.get("laser_roll", 0.0),
        "height": options.get("laser_height", 0.0),
        "joint_time_offset": options.get("joint_time_offset", 0.0),
        "level_x": level[0],
        "level_y": level[1],
        "level_yaw": level[5],
    }


#: Max error at 6 mm range noise: rad, 1, rad, m, s.
MAX_ERRORS = {
    "tilt_offset": np.deg2rad(0.05), "tilt_scale": 0.002, "roll": np.deg2rad(0.1),
    "height": 0.002, "joint_time_offset": 0.001,
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_known_errors_of_the_rig_are_recovered(name: str, tmp_path: Path):
    options = CASES[name]
    found = run(tmp_path / "bag", **options)
    expected = truth(options)
    assert {quantity.name for quantity in found.observability.quantities} == set(expected)
    for quantity in found.observability.quantities:
        error = abs(quantity.value - expected[quantity.name])
        assert quantity.sigma is not None, quantity
        assert error < 3.0 * quantity.sigma, (quantity, error)
        assert error < MAX_ERRORS.get(quantity.name, np.inf), (quantity, error)


def test_the_person_in_the_simulated_room_changes_ranges_at_each_stop():
    """Otherwise the case with people would test nothing."""

    def ranges(people: bool) -> np.ndarray:
        options = Options(tilt_beams=61, cycle_period=2.0, faults=False, people=people)
        messages = [m for m in run_room("room", options=options) if m.topic == "/tilt_scan"]
        return np.array([record.ranges for m in messages for record in m.records])

    changed = np.abs(ranges(True) - ranges(False)) > 0.1
    assert changed.mean() > 0.01
    assert all(third.any() for third in np.array_split(changed, 3)), "one for each stop"


def test_the_foot_of_a_cabinet_is_not_floor():
    """Hits on a vertical face begin at the floor's height, but are not floor."""
    rows, columns = 40, 30
    heights = np.zeros((rows, columns))
    heights[20:, :15] = 0.01 * np.arange(20)[:, None]  # a face, from the floor up
    ranges = np.ones((rows, columns), np.float32)
    ranges[5, 25] = np.nan
    cycle = CycleScans(
        None, 0, None, ranges, np.zeros((1, columns, 3)), np.zeros((rows, 4, 4)), (0, 1)
    )
    seen = np.isfinite(ranges)
    floor = np.zeros((rows, columns), bool)
    floor[seen] = select([cycle], heights[seen], 0.0, None).floor
    low_face = floor[20:, :15]
    assert not low_face[3:].any(), "only hits whose neighbours are all within 5 cm"
    assert not floor[3:8, 23:28].any(), "nor beside a lost hit"
    assert floor[:3].all()
    assert floor[8:21].all()
    assert floor[20:, 17:].all()
    assert not select([cycle], heights[seen], None, 0.5).floor.any()


def test_hits_near_two_planes_belong_to_neither():
    """Compare with a loop over hits and planes; planes of another place do not count."""
    random = np.random.default_rng(3)
    points, places = random.uniform(-1.0, 1.0, (300, 3)), random.integers(0, 2, 300)
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    planes = normals, np.array([-0.5, 0.2, np.inf]), np.array([0, 2, 3]), np.array([-1, 0, 1])
    plane = random.choice([0, 2, 3], 300)
    found = near_another(points, places, plane, planes)
    for i, point in enumerate(points):
        near = [
            number
            for normal, offset, number, place in zip(*planes)
            if abs(normal @ point - offset) < CORNER and place in (-1, places[i])
        ]
        assert found[i] == any(number != plane[i] for number in near)
    assert 0 < found.sum() < 300


def test_laser_height_is_not_estimated_without_floor_height(tmp_path: Path):
    simulate("room", tmp_path / "bag", options=Options(tilt_beams=121, cycle_period=2.0))
    found = calibrate(tmp_path / "bag")
    height = next(q for q in found.observability.quantities if q.name == "height")
    assert not height.is_determined
    assert "--floor-z" in height.reason
    assert found.rig.mount_correction[2] == pytest.approx(0.0, abs=1e-6)


def test_the_written_file_is_a_configuration_that_corrects_the_rig(tmp_path: Path):
    found = run(tmp_path / "bag", tilt_offset=0.05)
    (tmp_path / "rig.yaml").write_text(found.yaml())
    config = read_config(tmp_path / "rig.yaml")
    assert config.rig.tilt_offset == found.rig.tilt_offset
    again = calibrate(tmp_path / "bag", config, floor_z=FLOOR_Z)
    assert again.rig.tilt_offset == pytest.approx(found.rig.tilt_offset, abs=2e-4)
    assert again.rooms[0].floor[0].tilt < np.deg2rad(0.1)


def test_rooms_of_one_real_robot_agree_within_their_covariances():
    names = ("tilt_offset", "tilt_scale", "roll", "height")
    values, sigmas = [], []
    for bag in ("dlut_A617", "dlut_query_07", "dlut_query_08"):
        found = calibrate(shared(f"bags/{bag}"), floor_z=-0.3)
        by_name = {q.name: q for q in found.observability.quantities}
        values.append([by_name[n].value for n in names])
        sigmas.append([by_name[n].sigma for n in names])
        assert not by_name["joint_time_offset"].is_determined
        before, after = found.rooms[0].floor
        assert after.tilt < np.deg2rad(0.2)
        assert before.tilt > np.deg2rad(10.0)
        assert after.rms < 0.005
    spread = np.abs(np.array(values)[:, None] - np.array(values)[None])
    allowed = 3.0 * np.hypot(np.array(sigmas)[:, None], np.array(sigmas)[None])
    assert (spread <= allowed).all()
