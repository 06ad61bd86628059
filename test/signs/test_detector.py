"""Door signs by their text in rendered pictures, and in photographs where those are there."""

import json

import numpy as np
import pytest
from PIL import Image, ImageDraw
from shared_data import shared
from sign_lists import directory
from training_pictures import random_picture

from tccm_ros.config.signs import SignsConfig
from tccm_ros.errors import PictureError
from tccm_ros.replay.picture_files import read_picture, signs_of_pictures
from tccm_ros.signs.detector import SignDetector, sign_detector
from tccm_ros.signs.saliency_detector import SaliencyDetector
from tccm_sim.sign_pictures import font

SEED = 3_000_000
"""Seed of the first rendered picture."""


@pytest.fixture(scope="module")
def detector():
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    return SignDetector()


def wall(*writing, plate=(250, 180, 420, 300), turned=0.0):
    """Return a grey wall with a white plate, and texts on it: (text, (x, y), size)."""
    picture = Image.new("RGB", (640, 480), (150, 150, 145))
    draw = ImageDraw.Draw(picture)
    draw.rectangle(plate, fill=(235, 235, 230))
    for text, at, size in writing:
        draw.text(at, text, fill=(30, 30, 40), font=font("DejaVuSans", size))
    return np.asarray(picture.rotate(turned, Image.Resampling.BICUBIC, fillcolor=(150, 150, 145)))


def numbers(found):
    return [sign.number for sign in found]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("12-034B", "12-034B"),
        ("C7-118", "C7-118"),
        ("House 3", "HOUSE 3"),
        ("00.12.019", "00.12.019"),
        ("BC 410", "BC 410"),
    ],
)
def test_numbers_of_any_form_are_read(detector, text, number):
    assert numbers(detector.detect(wall((text, (262, 215), 28)))) == [number]


def test_a_number_in_two_lines_is_one_sign(detector):
    (sign,) = detector.detect(wall(("C7", (270, 190), 40), ("118", (270, 240), 40)))
    assert (sign.number, sign.text) == ("C7 118", "C7 118")
    assert sign.pixel == pytest.approx((308, 240), abs=8)


def test_a_name_with_a_title_is_a_sign_and_one_beside_a_number_is_its_text(detector):
    (sign,) = detector.detect(wall(("Dr. Ann Miller", (258, 215), 20)))
    assert sign.number == "DR. ANN MILLER"
    (sign,) = detector.detect(wall(("Dr. Miller", (262, 195), 26), ("205", (270, 250), 24)))
    assert (sign.number, sign.text) == ("205", "Dr. Miller 205")


def test_the_other_lines_of_a_plate_are_its_text(detector):
    (sign,) = detector.detect(wall(("205", (270, 190), 40), ("Archive", (270, 250), 22)))
    assert (sign.number, sign.text) == ("205", "205 Archive")
    low, high = sign.plate.min(axis=0), sign.plate.max(axis=0)
    assert (low < (275, 200)).all()
    assert (high > (345, 265)).all()


@pytest.mark.parametrize("turned", [-25, -8, 8, 25, 90, -90, 180])
def test_a_plate_that_is_turned_is_read(detector, turned):
    found = detector.detect(wall(("271B", (270, 210), 48), turned=turned))
    assert numbers(found) == ["271B"]


@pytest.mark.parametrize("scale", [0.2, 0.5, 0.9])
def test_a_number_is_read_at_any_size(detector, scale):
    """From a twentieth of the picture's height to one that fills its width."""
    whole = Image.fromarray(wall(("12-034B", (266, 212), 30)))
    width, height = 640 * scale / 2, 480 * scale / 2
    box = (330 - width, 232 - height, 330 + width, 232 + height)
    view = whole.resize((720, 540), Image.Resampling.BICUBIC, box=tuple(map(round, box)))
    assert numbers(detector.detect(np.asarray(view))) == ["12-034B"]


@pytest.mark.parametrize("turned", [90, 180])
def test_all_lines_of_a_turned_plate_are_read_in_order(detector, turned):
    pixels = wall(("205", (270, 190), 40), ("Archive", (270, 250), 22), turned=turned)
    (sign,) = detector.detect(pixels)
    assert (sign.number, sign.text) == ("205", "205 Archive")


@pytest.mark.parametrize(("radius", "size"), [(80, 18), (200, 44), (230, 60)])
def test_the_numbers_of_a_clock_are_no_signs(detector, radius, size):
    picture = Image.new("RGB", (960, 720), (150, 150, 145))
    draw = ImageDraw.Draw(picture)
    draw.ellipse((480 - radius, 300 - radius, 480 + radius, 300 + radius), fill=(240, 240, 238))
    for hour in range(1, 13):
        x, y = np.sin(np.pi * hour / 6), -np.cos(np.pi * hour / 6)
        at = (480 + 0.8 * radius * x, 300 + 0.8 * radius * y)
        draw.text(at, str(hour), fill=(20, 20, 20), font=font("DejaVuSans", size), anchor="mm")
    assert numbers(detector.detect(np.asarray(picture))) == []
    draw.rectangle((20, 560, 180, 680), fill=(235, 235, 230))
    draw.text((40, 590), "205", fill=(30, 30, 40), font=font("DejaVuSans", 30))
    assert numbers(detector.detect(np.asarray(picture))) == ["205"]


def test_titles_on_the_backs_of_books_are_no_signs(detector):
    shelf = Image.new("RGB", (720, 960), (90, 70, 50))
    draw = ImageDraw.Draw(shelf)
    titles = ["Volume 12", "Physics II", "ROS 2 Guide", "Algorithms 101", "Catch 22", "1984"]
    for k, title in enumerate(titles):
        draw.rectangle((150, 200 + 64 * k, 570, 260 + 64 * k), fill=(235 - 30 * k, 230, 90))
        middle = (360, 230 + 64 * k)
        draw.text(middle, title, fill=(10, 10, 10), font=font("DejaVuSans-Bold", 40), anchor="mm")
    assert numbers(detector.detect(np.asarray(shelf.rotate(-90, expand=True)))) == []


def test_refused_regions_have_a_reason(detector):
    notice = [(f"No {k + 1}0 of these lines", (60, 40 + 26 * k), 16) for k in range(8)]
    found = detector.search(wall(*notice, plate=(40, 20, 300, 280)))
    assert found.signs == []
    assert "a line of a notice" in {text.reason for text in found.refused}
    found = detector.search(wall(("10:30", (262, 215), 34)))
    assert [(text.text, text.reason) for text in found.refused] == [
        ("10:30", "no number of a room, no name with a title")
    ]


def test_signs_of_rendered_pictures_are_read(detector):
    right = false = 0
    for k in range(12):
        picture = random_picture(np.random.default_rng(SEED + k), 1)
        for sign in detector.detect(picture.pixels):
            is_right = picture.numbers[0] == sign.number
            low, high = picture.corners[0].min(axis=0), picture.corners[0].max(axis=0)
            on_it = (sign.pixel > low - 5).all() and (sign.pixel < high + 5).all()
            right, false = right + (is_right and on_it), false + (not on_it)
    assert right >= 8
    assert false <= 1


def test_the_configuration_chooses_the_detector():
    assert type(sign_detector(SignsConfig())) is SignDetector
    assert type(sign_detector(SignsConfig(detector="published"))) is SaliencyDetector


def test_the_same_picture_gives_the_same_signs(detector):
    pixels = random_picture(np.random.default_rng(SEED), 2).pixels
    first, second = detector.detect(pixels), SignDetector().detect(pixels)
    assert [(s.text, s.confidence) for s in first] == [(s.text, s.confidence) for s in second]


def test_an_empty_wall_and_a_tiny_picture_have_no_sign(detector):
    assert detector.detect(np.full((720, 960, 3), 180, np.uint8)) == []
    assert detector.detect(np.zeros((4, 4), np.uint8)) == []


@pytest.mark.parametrize("size", [16, 20, 24, 28])
def test_rows_of_a_directory_are_no_door_signs(detector, size):
    found = detector.search(directory(size, size))
    assert found.signs == []
    assert {text.reason for text in found.refused} >= {"a line of a notice"}


@pytest.mark.parametrize(("prefix", "number"), [("a_", 18), ("b_", 16)])
def test_photographs_of_two_buildings_are_read(prefix, number):
    folder = shared("signs")
    right = false = 0
    for picture in json.loads((folder / "signs.json").read_text()):
        if not picture["file"].startswith(prefix):
            continue
        (line,) = signs_of_pictures([folder / picture["file"]])
        words = [word for sign in line["signs"] for word in sign["text"].upper().split()]
        hits = sum(sign["text"] in words for sign in picture["signs"])
        right += hits
        false += len(line["signs"]) - hits
    assert right == number
    assert false <= 1


def test_files_that_are_no_pictures_are_named(tmp_path):
    (tmp_path / "notes.jpg").write_text("no picture")
    with pytest.raises(PictureError, match=r"notes\.jpg: not a readable image"):
        read_picture(tmp_path / "notes.jpg")
    with pytest.raises(PictureError, match=r"none\.png: no such file"):
        read_picture(tmp_path / "none.png")
