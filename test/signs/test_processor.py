"""Which pictures are looked at, what is measured in them, and what happens without the extra."""

import io
import sys

import numpy as np
import pytest
from PIL import Image
from posed_pictures import START, needs_reader, posed, wall_with

from tccm_ros.config import Config
from tccm_ros.config.reader import read_config
from tccm_ros.errors import MissingExtraError
from tccm_ros.records import CameraImage, MapReset, Odometry
from tccm_ros.sensors.camera_image import PosedPicture
from tccm_ros.signs import processor
from tccm_ros.signs.hog import hog_features
from tccm_ros.signs.measurement import SearchedPicture, SearchedText, picture_key
from tccm_ros.signs.processor import (
    BEYOND_RATE,
    NO_EXTRA,
    UNCHANGED,
    PictureSelector,
    SignProcessor,
)
from tccm_sim.door_plates import STYLES, door_plate


def empty(stamp_ns=START, grey=120):
    return posed(np.full((120, 160, 3), grey, np.uint8), stamp_ns)


class Nothing:
    """A detector that finds nothing."""

    def search(self, pixels):
        return SearchedText([], [])


@pytest.fixture
def blind(monkeypatch):
    monkeypatch.setattr(processor, "sign_detector", lambda settings: Nothing())


@pytest.mark.parametrize(("rate", "fps"), [(2.0, 30.0), (2.0, 3.0), (5.0, 4.0), (1.0, 1.0)])
def test_the_first_picture_of_each_period_of_stamps_is_selected(rate, fps):
    selector = PictureSelector(rate)
    stamps = [START + 123_456_789 + round(k * 1e9 / fps) for k in range(round(10 * fps))]
    chosen = [stamp for stamp in stamps if selector.selects(stamp)]
    periods = [stamp // round(1e9 / rate) for stamp in stamps]
    assert chosen == [s for k, s in enumerate(stamps) if periods[k] not in periods[:k]]
    # Selecting once more from what was selected changes nothing.
    again = PictureSelector(rate)
    assert [stamp for stamp in chosen if again.selects(stamp)] == chosen


def test_selection_does_not_depend_on_when_the_run_began(blind):
    stamps = [START + k * 33_333_333 for k in range(90)]
    late = PictureSelector(2.0)
    early = PictureSelector(2.0)
    all_of_them = [stamp for stamp in stamps if early.selects(stamp)]
    of_the_rest = [stamp for stamp in stamps[20:] if late.selects(stamp)]
    assert set(all_of_them[3:]) <= set(of_the_rest)


def test_pictures_beyond_the_rate_are_counted(blind):
    signs = SignProcessor(read_config(None, ("signs.rate=2",)))
    for k in range(30):
        signs.add(empty(START + k * 100_000_000, 5 * k))
    assert signs.counts["pictures"] == 6
    assert signs.dropped == {BEYOND_RATE: 24}


def test_nothing_is_looked_for_while_the_view_is_unchanged(monkeypatch):
    searched = []

    class Counting(Nothing):
        def search(self, pixels):
            searched.append(pixels)
            return super().search(pixels)

    monkeypatch.setattr(processor, "sign_detector", lambda settings: Counting())
    signs, plain = SignProcessor(Config()), np.full((120, 160, 3), 120, np.uint8)
    noise = np.random.default_rng(1).integers(-3, 4, plain.shape)
    paper = plain.copy()
    paper[40:46, 50:53] = 0
    views = [plain, plain + noise, paper, paper + noise]
    for k, pixels in enumerate(views):
        signs.add(posed(np.clip(pixels, 0, 255).astype(np.uint8), START + k * 10**9))
    assert len(searched) == 2
    moved = posed(np.clip(views[3], 0, 255).astype(np.uint8), START + 4 * 10**9)
    moved.T_odom_base[0, 0, 3] = 0.05
    assert len(signs.add(moved)) == 1
    assert len(searched) == 3
    assert signs.dropped == {UNCHANGED: 2}


def test_after_a_jump_of_the_clock_pictures_are_looked_at_again(blind):
    signs = SignProcessor(Config())
    signs.add(empty())
    signs.add(MapReset("the clock went back"))
    signs.add(empty())
    assert signs.counts["pictures"] == 2


def test_other_events_are_left_alone():
    assert SignProcessor(Config()).add(Odometry(START, "odom", "base", np.eye(4))) == []


def test_without_the_extra_the_missing_library_is_named_and_counted(monkeypatch):
    def missing(*_):
        raise MissingExtraError("reading door signs needs rapidocr-onnxruntime")

    monkeypatch.setattr(processor, "sign_detector", missing)
    signs = SignProcessor(Config())
    assert signs.add(empty()) == []
    assert "rapidocr-onnxruntime" in signs.problem
    assert signs.dropped == {NO_EXTRA: 1}


def test_the_extra_is_not_imported_before_there_is_a_picture():
    before = {name for name in sys.modules if name.startswith("onnxruntime")}
    SignProcessor(Config())
    assert {name for name in sys.modules if name.startswith("onnxruntime")} == before


def test_a_damaged_file_is_counted(blind):
    picture = empty()
    file = io.BytesIO()
    Image.new("RGB", (160, 120)).save(file, "PNG")
    data = np.frombuffer(file.getvalue()[:60], np.uint8)
    record = picture.record
    damaged = CameraImage(START, "optical", "compressed", record.size, data, record.camera)
    signs = SignProcessor(Config())
    assert signs.add(PosedPicture(damaged, *(getattr(picture, n) for n in
                                             ("pose_stamps_ns", "T_odom_base", "T_base_sensor",
                                              "role")))) == []  # fmt: skip
    assert "damaged" in next(iter(signs.dropped))


@needs_reader
def test_a_measurement_points_at_the_number_and_has_pose_patch_and_text():
    signs = SignProcessor(Config())
    plate = door_plate("317", "Archive", STYLES[0])
    picture = posed(wall_with("317"))
    searched, sign = signs.add(picture)
    assert searched.key == picture_key(sign.stamp_ns, sign.T_base_camera)
    height = 120 * plate.pixels.shape[0] / plate.pixels.shape[1]
    middle = np.array([200 + 60 + 120 * plate.anchor[0], 150 + height / 2 - 120 * plate.anchor[1]])
    assert sign.pixel == pytest.approx(middle - 0.5, abs=2.0)
    expected = np.append((sign.pixel - [256.0, 192.0]) / 500.0, 1.0)
    assert sign.bearing == pytest.approx(expected / np.linalg.norm(expected))
    assert sign.number == "317"
    assert "317" in sign.text.split()
    assert "Archive" in sign.text
    assert sign.confidence > 0.8
    assert sign.T_base_camera[:3, 3].tolist() == [0.1, 0.2, 1.4]
    assert sign.focal_length == 500.0
    low, high = sign.corners.min(axis=0), sign.corners.max(axis=0)
    assert np.all(low < sign.pixel)
    assert np.all(sign.pixel < high)
    assert signs.counts["signs"] == 1


@needs_reader
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_camera_that_is_mounted_turned_measures_the_same(quarters):
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # R_base_camera

    def measured(k):
        unit = np.round(np.exp(0.5j * np.pi * k))
        picture = posed(np.ascontiguousarray(np.rot90(wall_with("317"), k)))
        roll = [[unit.real, -unit.imag, 0.0], [unit.imag, unit.real, 0.0], [0.0, 0.0, 1.0]]
        picture.T_base_sensor[0, :3, :3] = ahead @ roll
        picture.image.camera.K[:2, 2] -= 0.5  # the middle of the picture
        _, sign = SignProcessor(Config()).add(picture)
        R = picture.T_base_sensor[0, :3, :3]
        return sign, R @ sign.bearing, sign.plate @ R.T

    (level, bearing, plate), (turned, *rays) = measured(0), measured(quarters)
    assert (turned.text, turned.number) == (level.text, level.number) == ("317 Archive", "317")
    assert rays[0] == pytest.approx(bearing, abs=1e-9)
    assert rays[1] == pytest.approx(plate, abs=1e-9)
    assert np.array_equal(turned.patch, level.patch)


@needs_reader
def test_the_patch_of_a_plate_is_more_like_itself_than_like_another():
    signs = SignProcessor(Config())

    def patch(number, at, k):
        _, found = signs.add(posed(wall_with(number, at), START + k * 10**9))
        (features,) = hog_features(found.patch[None])
        return features / np.linalg.norm(features)

    first, moved, other = patch("317", (200, 150), 0), patch("317", (60, 90), 1), patch(
        "482", (200, 150), 2)  # fmt: skip
    assert first @ moved > first @ other + 0.05


def test_picture_without_a_sign_is_reported_as_searched(blind):
    picture = empty()
    (searched,) = SignProcessor(Config()).add(picture)
    assert type(searched) is SearchedPicture
    camera = picture.image.camera
    assert searched.size == picture.image.size
    assert searched.focal_lengths.tolist() == [camera.K[0, 0], camera.K[1, 1]]
    assert searched.center.tolist() == camera.K[:2, 2].tolist()


@needs_reader
@pytest.mark.parametrize("moved", [230, 240])
def test_a_number_that_the_border_cuts_off_is_not_measured(moved):
    signs, whole = SignProcessor(Config()), wall_with("317")
    assert len(signs.add(posed(whole))) == 2
    assert len(signs.add(posed(np.roll(whole, -moved, axis=1), START + 10**9))) == 1
