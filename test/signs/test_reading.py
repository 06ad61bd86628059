"""Lines of text are found, rectified and read."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tccm_ros.errors import MissingExtraError
from tccm_ros.signs import reading
from tccm_ros.signs.reading import TextLine, TextReader, rectified, text_lines
from tccm_sim.sign_pictures import font


def written(text, slope=0.0):
    """Return a picture with a text in its middle, sheared by a slope."""
    picture = Image.new("RGB", (240, 120), (210, 205, 200))
    ImageDraw.Draw(picture).text((70, 40), text, fill=(20, 20, 30), font=font("DejaVuSans", 36))
    return picture.transform(
        picture.size, Image.Transform.AFFINE, (1, 0, 0, -slope, 1, slope * 120), fillcolor="gray"
    )


@pytest.mark.parametrize("slope", [0.0, 0.25, -0.25])
def test_a_number_is_found_and_read_also_at_an_angle(slope):
    pytest.importorskip("onnxruntime", reason="the extra 'signs' is not installed")
    reader, picture = TextReader(), written("271B", slope)
    lines = reader.find(picture, 1.0)
    assert len(lines) == 1
    assert np.allclose(lines[0].center, (116, 60), atol=8)
    assert reader.read(picture, lines[0])[0] == "271B"
    assert reader.read(picture, lines[0]) == TextReader().read(picture, lines[0])


def test_without_the_extra_an_error_names_it(monkeypatch):
    monkeypatch.setattr(reading, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="rapidocr-onnxruntime"):
        TextReader()


def test_a_line_has_straight_edges_that_follow_its_slope():
    probability = np.zeros((64, 128), np.float32)
    for x in range(20, 100):
        middle = round(20 + 0.2 * (x - 20))
        probability[middle - 5 : middle + 5, x] = 0.9
    (corners,) = text_lines(probability)
    slopes = (corners[[1, 2], 1] - corners[[0, 3], 1]) / (corners[[1, 2], 0] - corners[[0, 3], 0])
    assert np.allclose(slopes, 0.2, atol=0.02)
    assert (corners[[0, 3], 0] < 20).all()
    assert (corners[[1, 2], 0] > 100).all()
    assert not text_lines(np.full((32, 32), 0.2, np.float32))


def test_a_rectified_line_fills_its_picture():
    picture = Image.new("RGB", (100, 100), "black")
    ImageDraw.Draw(picture).polygon([(20, 20), (80, 35), (80, 65), (20, 50)], fill="white")
    line = TextLine(np.array([[20.0, 20], [80, 35], [80, 65], [20, 50]]))
    pixels = np.asarray(rectified(picture, line).convert("L"))
    assert pixels.shape[0] == 48
    assert (pixels > 128).mean() > 0.95
