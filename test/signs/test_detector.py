"""Door signs in rendered pictures, and in photographs where those are there."""

import json

import numpy as np
import pytest
from PIL import Image, ImageDraw
from shared_data import shared

from tccm_ros.errors import PictureError
from tccm_ros.replay.picture_files import read_picture, signs_of_pictures
from tccm_ros.signs.classifier import read_classifier
from tccm_ros.signs.detector import SignDetector
from tccm_ros.signs.saliency import salient_boxes
from tccm_sim.sign_pictures import font, random_picture

SEED = 3_000_000
"""Seed of the first picture; training uses others."""


@pytest.fixture(scope="module")
def detector():
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    return SignDetector()


def is_found(boxes, corners):
    """Return whether a box covers the middle of a number."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = 0.5 * (low + high)
    return bool(((boxes[:, :2] < middle) & (boxes[:, 2:] > middle)).all(axis=1).any())


def test_the_classifier_keeps_numbers_and_rejects_other_boxes():
    classifier, kept, salient, accepted, total = read_classifier(), 0, 0, 0, 0
    for k in range(12):
        picture = random_picture(np.random.default_rng(SEED + k), 1)
        gray = np.asarray(Image.fromarray(picture.pixels).convert("L"))
        boxes = salient_boxes(gray)
        good = classifier.scores(gray, boxes) >= classifier.threshold
        salient += is_found(boxes, picture.corners[0])
        kept += is_found(boxes[good], picture.corners[0])
        accepted, total = accepted + good.sum(), total + len(good)
    assert salient >= 9
    assert kept >= salient - 1
    assert accepted < 0.15 * total


def test_signs_of_rendered_pictures_are_read(detector):
    right = false = 0
    for k in range(12):
        picture = random_picture(np.random.default_rng(SEED + k), 1)
        for sign in detector.detect(picture.pixels):
            is_right = picture.numbers[0] == sign.number
            low, high = picture.corners[0].min(axis=0), picture.corners[0].max(axis=0)
            on_it = (sign.pixel > low - 5).all() and (sign.pixel < high + 5).all()
            right, false = right + (is_right and on_it), false + (not on_it)
    assert right >= 6
    assert false <= 1


def test_the_same_picture_gives_the_same_signs(detector):
    pixels = random_picture(np.random.default_rng(SEED), 2).pixels
    first, second = detector.detect(pixels), SignDetector().detect(pixels)
    assert [(s.text, s.confidence) for s in first] == [(s.text, s.confidence) for s in second]


def test_an_empty_wall_and_a_tiny_picture_have_no_sign(detector):
    assert detector.detect(np.full((720, 960, 3), 180, np.uint8)) == []
    assert detector.detect(np.zeros((4, 4), np.uint8)) == []


def directory(seed, size):
    """Return a picture of a list of rooms: names, and a column of numbers of `size` pixels."""
    rng = np.random.default_rng(seed)
    picture = Image.new("RGB", (640, 480), (150, 145, 135))
    draw, letters = ImageDraw.Draw(picture), font("DejaVuSerif", size)
    step = 1.7 * size
    draw.rectangle((60, 30, 330, 50 + int(8 * step)), fill=(215, 215, 210))
    for y in 40 + step * np.arange(8):
        name = "".join(rng.choice(list("abcdefghiknorstu"), rng.integers(3, 11))).capitalize()
        draw.text((75, y), name, fill=(60, 90, 60), font=letters)
        draw.text((260, y), str(rng.integers(100, 400)), fill=(60, 90, 60), font=letters)
    return np.asarray(picture)


@pytest.mark.parametrize("size", [16, 20, 24, 28])
def test_rows_of_a_directory_are_no_door_signs(detector, monkeypatch, size):
    picture = directory(size, size)
    assert detector.detect(picture) == []
    # What is beside its box alone does not tell a row: the rest of the list does.
    monkeypatch.setattr(SignDetector, "_is_row", lambda *_: False)
    assert len(detector.detect(picture)) > 1


def test_photographs_of_one_building_are_read(detector):
    folder = shared("signs")
    right = false = numbers = 0
    for picture in json.loads((folder / "signs.json").read_text()):
        if not picture["file"].startswith("a_"):
            continue
        (line,) = signs_of_pictures([folder / picture["file"]])
        words = [word for sign in line["signs"] for word in sign["text"].upper().split()]
        hits = sum(sign["text"] in words for sign in picture["signs"])
        right, numbers = right + hits, numbers + len(picture["signs"])
        false += len(line["signs"]) - hits
    assert numbers == 18
    assert right >= 17
    assert false <= 1


def test_files_that_are_no_pictures_are_named(tmp_path):
    (tmp_path / "notes.jpg").write_text("no picture")
    with pytest.raises(PictureError, match=r"notes\.jpg: no picture"):
        read_picture(tmp_path / "notes.jpg")
    with pytest.raises(PictureError, match=r"none\.png: no such file"):
        read_picture(tmp_path / "none.png")
