"""Several recordings of one rig are calibrated together; recordings of two rigs are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_data import shared

from tccm_ros.calibrate.agreement import Agreement, ComparedQuantity
from tccm_ros.calibrate.calibration import Calibration, calibrate
from tccm_ros.calibrate.combine_recordings import combine_recordings
from tccm_ros.calibrate.reading import read_recording
from tccm_ros.config import Config
from tccm_ros.errors import BagError, FrameError
from tccm_ros.geometry import transform2

ERRORS = {"tilt_offset": 0.05, "tilt_scale": 0.98, "laser_roll": 0.01, "joint_time_offset": 0.008}


@pytest.fixture
def bag(session_files, tmp_path):
    """Make a recording of a simulated rig with some errors, of the given name."""

    def make(name: str, world: str = "room", **errors) -> Path:
        settings = {
            "tilt_beams": 121, "sigma": 0.006, "cycle_period": 2.0, "base_tilt": 0.0,
            "people": False,
        } | errors  # fmt: skip
        (tmp_path / name).symlink_to(session_files.simulated(world, **settings))
        return tmp_path / name

    return make


def sigmas(found: Calibration) -> dict[str, float]:
    return {q.name: q.sigma for q in found.observability.quantities if q.sigma is not None}


def test_two_recordings_of_a_rig_give_smaller_sigmas_than_one(bag):
    bags = [bag(world, world, **ERRORS) for world in ("room", "moved")]
    both = calibrate(bags, floor_z=0.0)
    alone = [calibrate(one, floor_z=0.0) for one in bags]
    assert both.bags == ("room", "moved")
    assert [room.places for room in both.rooms] == [3, 3]
    assert both.agreement is not None
    assert both.agreement.differing == ()
    for name in ("tilt_offset", "tilt_scale", "roll", "height", "joint_time_offset"):
        assert sigmas(both)[name] < min(sigmas(one)[name] for one in alone), name
    truth = (0.05, 0.98, 0.01, 0.0, 0.008)
    for quantity, expected in zip(both.observability.quantities, truth):
        assert quantity.value == pytest.approx(expected, abs=3.0 * quantity.sigma)
    content = both.to_json()
    assert content["bags"] == ["room", "moved"]
    assert {one["name"] for one in content["agreement"]} >= {"tilt_offset", "roll", "height"}
    assert both.yaml().startswith("# Made by `tccm calibrate room moved`.")


def test_recordings_with_different_tilt_zeros_are_refused(bag):
    one = bag("before", **ERRORS)
    other = bag("after", **ERRORS | {"tilt_offset": 0.07})
    with pytest.raises(BagError, match=r"not of one rig: tilt_offset is .* in before and .* after"):
        calibrate([one, other], floor_z=0.0)


def test_real_recordings_with_different_mounts_of_the_laser_are_refused():
    bags = [shared(f"bags/dlut_{name}") for name in ("A605", "A617")]
    with pytest.raises(BagError, match=r"tilt_offset is .* in dlut_A617 and .* in dlut_A605"):
        calibrate(bags, floor_z=-0.3)


def test_the_same_bag_twice_is_refused(tmp_path: Path):
    (tmp_path / "one").mkdir()
    with pytest.raises(BagError, match="twice"):
        calibrate([tmp_path / "one", tmp_path / "two" / ".." / "one"])


def test_the_error_names_a_laser_that_is_mounted_elsewhere(bag):
    recording = read_recording(bag("one"), Config())
    cycle = recording.cycles[0]
    chain = replace(cycle.chain, fixed=cycle.chain.fixed.copy())
    chain.fixed[-1, 2, 3] += 0.01
    moved = replace(recording, cycles=[replace(cycle, chain=chain), *recording.cycles[1:]])
    with pytest.raises(FrameError, match="the transform before the laser is another one"):
        combine_recordings([recording, moved])
    other = replace(recording, bags=("two",), base="torso")
    with pytest.raises(FrameError, match="two is not of the rig of one: its base is 'torso'"):
        combine_recordings([recording, other])
    assert combine_recordings([recording, recording]).bags == ("one (1)", "one (2)")


def test_joined_recordings_number_their_places_consecutively(bag):
    recording = read_recording(bag("one"), Config())
    both = combine_recordings([recording, recording])
    n = len(recording.bag)
    assert both.bag.tolist() == [0] * n + [1] * n
    assert both.places.tolist() == [*recording.places, *(recording.places + n)]
    assert sorted(both.level) == [*recording.level, *(n + place for place in recording.level)]
    assert both.cycles_of(1) == (len(recording.cycles), 2 * len(recording.cycles))
    # Poses are in the frame of the first place; in odom they are the poses of the tilt cycles.
    firsts = np.unique(recording.places, return_index=True)[1]
    made = np.array([recording.cycles[i].place for i in firsts])
    assert transform2(made[0], recording.poses[:, :2]) == pytest.approx(made[:, :2], abs=1e-4)


def test_disagreement_is_measured_in_standard_deviations():
    same = ComparedQuantity("roll", ("a", "b", "c"), (0.01, 0.011, 0.009), (0.001, 0.001, 0.001))
    assert same.chi_square == pytest.approx(2.0)
    off = ComparedQuantity("tilt_scale", ("a", "b"), (1.0, 1.05), (0.003, 0.004))
    assert off.chi_square == pytest.approx((0.05 / 0.005) ** 2)
    agreement = Agreement((same, off))
    assert agreement.differing == (off,)
    with pytest.raises(BagError, match=r"tilt_scale is 1 \+- 0.003 in a and 1.05 \+- 0.004 in b"):
        agreement.check()
