"""Labels of furniture of the sizes that shops sell: the right one, or "other"."""

from collections import Counter

import numpy as np
import pytest
import shapely
from furniture import noisy_surface
from shapely import affinity, box

from tccm_ros.config import Config
from tccm_ros.surfaces.labels.labels import label_surfaces

SIZES = {
    # length, depth and height, m: catalogue ranges, not the rules'
    "dining table": ((1.1, 2.2), (0.75, 1.0), (0.72, 0.77), "table"),
    "desk": ((1.0, 1.8), (0.6, 0.8), (0.70, 0.76), "table"),
    "coffee table": ((0.8, 1.3), (0.5, 0.8), (0.35, 0.47), "table"),
    "worktop": ((1.2, 3.0), (0.58, 0.65), (0.88, 0.94), "counter"),
    "chair": ((0.40, 0.48), (0.38, 0.46), (0.43, 0.48), "seat"),
    "stool": ((0.32, 0.40), (0.32, 0.40), (0.42, 0.48), "seat"),
    "sofa": ((1.3, 2.2), (0.55, 0.75), (0.40, 0.47), "seat"),
    "bed": ((1.95, 2.1), (0.85, 1.8), (0.42, 0.62), "bed"),
}
FLATS = 120


def place(length, depth, rng, at):
    return affinity.translate(affinity.rotate(box(0, 0, length, depth), rng.uniform(0, 360)), *at)


def furnish(rng):
    """Return surfaces at distances of metres, with the labels that a person would give."""
    surfaces, names = [], []
    for k, (name, (lengths, depths, heights, label)) in enumerate(SIZES.items()):
        length, depth = rng.uniform(*lengths), rng.uniform(*depths)
        height, angle = rng.uniform(*heights), rng.uniform(0, 360)
        polygon = box(0, 0, length, depth)
        parts = [(polygon, height, label, name)]
        if name == "sofa":
            back = box(-0.1, depth + 0.01, length + 0.1, depth + rng.uniform(0.12, 0.25))
            parts.append((back, height + rng.uniform(0.30, 0.45), "", name))
        for part, z, wanted, what in parts:
            rotated = affinity.rotate(part, angle, origin=(0, 0))
            surfaces.append(noisy_surface(affinity.translate(rotated, 4.0 * k, 0.0), z, rng))
            names.append((what, wanted))
    return surfaces, names


@pytest.fixture(scope="module")
def label_counts():
    found = {name: Counter() for name in SIZES}
    for seed in range(FLATS):
        surfaces, names = furnish(np.random.default_rng(seed))
        labels = label_surfaces(surfaces, 0.0, None, Config())
        for label, (name, wanted) in zip(labels, names, strict=True):
            if wanted:
                right = "right" if label.name == wanted else label.name
                found[name][right] += 1
    return found


@pytest.mark.parametrize("name", SIZES)
def test_furniture_has_its_label_or_other(label_counts, name):
    counts = label_counts[name]
    wrong = FLATS - counts["right"] - counts["other"]
    assert wrong <= 0.02 * FLATS, counts
    assert counts["right"] >= 0.6 * FLATS, counts


def test_a_sofa_whose_back_was_not_seen_is_other():
    rng = np.random.default_rng(0)
    seat = noisy_surface(box(0, 0, 1.9, 0.7), 0.44, rng)
    assert label_surfaces([seat], 0.0, None, Config())[0].name == "other"


def test_a_bed_with_a_headboard_is_a_bed():
    rng = np.random.default_rng(0)
    bed = noisy_surface(box(0, 0, 2.0, 1.2), 0.5, rng)
    board = noisy_surface(box(2.02, -0.05, 2.12, 1.25), 0.95, rng)
    assert label_surfaces([bed, board], 0.0, None, Config())[0].name == "bed"


def test_a_crate_and_a_small_side_table_are_other():
    rng = np.random.default_rng(0)
    for side, height in ((0.38, 0.32), (0.45, 0.53)):
        label = label_surfaces(
            [noisy_surface(box(0, 0, side, side), height, rng)], 0.0, None, Config()
        )[0]
        assert label.name == "other"


def test_a_worktop_at_a_wall_is_a_counter_with_more_confidence():
    walls = shapely.get_coordinates(shapely.LineString([(-1, -0.02), (4, -0.02)])).reshape(1, 2, 2)
    rng = np.random.default_rng(0)
    worktop = noisy_surface(box(0, 0, 2.4, 0.6), 0.9, rng)
    free = label_surfaces([worktop], 0.0, None, Config())[0]
    at_wall = label_surfaces([worktop], 0.0, walls, Config())[0]
    assert free.name == at_wall.name == "counter"
    assert at_wall.confidence > free.confidence
