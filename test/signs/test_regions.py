"""In which parts of a picture text may be."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tccm_ros.signs.regions import text_regions
from tccm_sim.sign_pictures import font

BLOCK = 16  # pixels: two characters of the smallest readable text


def covers(regions, box):
    """Return whether a region holds a box: left, top, right, bottom."""
    low, high = np.array(box[:2]), np.array(box[2:])
    return any((r[:2] <= low).all() and (r[2:] >= high).all() for r in regions)


def wall(noise=0.0):
    """Return a wall with the straight edges of a door."""
    picture = Image.new("RGB", (960, 736), (150, 150, 145))
    ImageDraw.Draw(picture).rectangle((600, -5, 800, 760), fill=(90, 60, 40))
    rng = np.random.default_rng(1)
    pixels = np.asarray(picture.convert("L")) + rng.normal(0.0, noise, (736, 960))
    return Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))


@pytest.mark.parametrize("noise", [0.0, 3.0, 10.0])
def test_flat_walls_and_straight_edges_have_no_text(noise):
    regions = text_regions(np.asarray(wall(noise)))
    assert np.prod(regions[:, 2:] - regions[:, :2], axis=1).sum() < 0.05 * 960 * 736


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize(("size", "blur"), [(16, 0), (60, 0), (250, 8)])
def test_text_is_within_one_region_with_a_margin(size, blur, noise):
    picture = wall(noise)
    draw, at = ImageDraw.Draw(picture), (60, 200)
    draw.text(at, "205", fill=60, font=font("DejaVuSans", size))
    box = draw.textbbox(at, "205", font=font("DejaVuSans", size))
    if blur:
        picture = picture.reduce(blur).resize(picture.size, Image.Resampling.BICUBIC)
    regions = text_regions(np.asarray(picture))
    assert covers(regions, box)
    assert (regions % BLOCK == 0).all()


def test_regions_lie_beside_each_other():
    rng = np.random.default_rng(2)
    picture = wall()
    draw = ImageDraw.Draw(picture)
    for x, y in rng.integers(0, 650, (12, 2)).tolist():
        draw.text((x, y), "118", fill=30, font=font("DejaVuSans", 24))
    regions = text_regions(np.asarray(picture))
    assert len(regions) > 1
    for k, a in enumerate(regions):
        for b in regions[:k]:
            assert not ((a[:2] <= b[:2]).all() and (a[2:] >= b[2:]).all())
