"""Labels of surfaces that a person would name, and "other" where a person would ask."""

import numpy as np
import pytest
import shapely
from furniture import noisy_surface
from shapely import Point, affinity, box

from tccm_ros.config import Config
from tccm_ros.config.surfaces import LabelsConfig
from tccm_ros.surfaces.labels.label_features import outline_width
from tccm_ros.surfaces.labels.labels import SurfaceLabel, label_surfaces
from tccm_ros.surfaces.polygons import box_sides

L_COUNTER = shapely.union_all([box(0, 0, 2.4, 0.6), box(1.8, -2.1, 2.4, 0.6)])


WALL = np.array([[[-3.0, -0.01], [6.0, -0.01]]])


def names(*parts, walls=None, config=None, angle_deg=0.0):
    """Return the labels of outlines at heights, as a map has them; each keeps its confidence."""
    rng = np.random.default_rng(1)
    surfaces = [
        noisy_surface(affinity.rotate(p, angle_deg, origin=(0, 0)), z, rng) for p, z in parts
    ]
    return [
        (x.name, x.confidence) for x in label_surfaces(surfaces, 0.0, walls, config or Config())
    ]


def only(parts, **more):
    return [name for name, _ in names(*parts, **more)]


SHELF = [(box(0, 0, 0.8, 0.3), z) for z in (0.35, 0.7, 1.05, 1.4)]
STAIRS = [(box(0.27 * k, 0, 0.27 * k + 0.26, 0.9), 0.17 * (k + 1)) for k in range(2, 8)]
DESK, WORKTOP = (box(0, 0, 1.4, 0.6), 0.74), (box(0, 0, 2.4, 0.6), 0.91)


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0])
def test_a_bent_counter_is_as_wide_as_its_arms(angle):
    polygon = affinity.rotate(L_COUNTER, angle)
    assert outline_width(polygon) == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(("width", "length"), [(0.8, 1.2), (0.2, 2.0), (0.5, 0.5)])
def test_a_rectangle_is_as_wide_as_its_shorter_side(width, length):
    polygon = affinity.rotate(box(0, 0, length, width), 31.0)
    assert outline_width(polygon) == pytest.approx(width, abs=1e-9)


def test_rules_of_labels_are_ranges_of_the_configuration():
    rules = Config().labels
    assert rules.counter[0] < 0.9 < rules.counter[1]
    assert rules.seat[1] < rules.table[1]


def test_the_width_of_a_narrow_band_with_wavy_edges_is_its_mean_width():
    x = np.linspace(0.0, 2.0, 41)
    wave = 0.04 * np.sin(2.0 * np.pi * x / 0.5)
    ring = [*zip(x, wave, strict=True), *zip(x[::-1], 0.24 + wave[::-1], strict=True)]
    band = shapely.Polygon(ring)
    assert box_sides(band)[0] == pytest.approx(0.32, abs=0.01)
    assert outline_width(band) == pytest.approx(0.24, abs=0.025)


CASES = [
    ([(box(0, 0, 3, 3), 0.01)], ["floor"]),
    ([(Point(0, 0).buffer(0.5), 0.74)], ["table"]),
    ([(box(0, 0, 1.1, 0.6), 0.42)], ["table"]),
    ([(L_COUNTER, 0.91)], ["counter"]),
    ([(Point(0, 0).buffer(0.4), 1.08)], ["counter"]),
    (SHELF, ["shelf"] * 4),
    ([(box(0, 0, 0.45, 0.42), 0.45)], ["seat"]),
    ([(box(0, 0, 2.0, 1.4), 0.5), (box(-0.1, 0, -0.01, 1.4), 1.0)], ["bed", "ledge"]),
    ([(box(0, 0, 1.2, 0.2), 0.9)], ["ledge"]),
    ([WORKTOP, (box(0.8, 0.05, 1.4, 0.55), 0.96)], ["counter", "step"]),
    (STAIRS, ["step"] * 6),
    ([(box(0, 0, 0.4, 0.4), 0.55)], ["other"]),
]
"""Surfaces, and what a person would call them."""


@pytest.mark.parametrize("angle_deg", [0.0, 33.0, 118.0])
@pytest.mark.parametrize(("parts", "expected"), CASES)
def test_surfaces_have_the_labels_that_a_person_would_give(parts, expected, angle_deg):
    assert only(parts, angle_deg=angle_deg) == expected


def test_there_is_a_case_for_each_label():
    assert {name for _, expected in CASES for name in expected} == set(SurfaceLabel)


@pytest.mark.parametrize(("lower", "name"), [(DESK, "table"), (WORKTOP, "counter")])
@pytest.mark.parametrize("depth", [0.25, 0.4])
def test_a_desk_or_worktop_below_a_board_is_no_shelf(lower, name, depth):
    length = lower[0].bounds[2]
    for boards in ([1.2], [1.2, 1.55]):
        above = [(box(0, 0, length, depth), z) for z in boards]
        found = only([lower, *above], walls=WALL)
        assert found[0] == name
        assert set(found[1:]) <= {"shelf", "ledge"}


def test_two_treads_or_boards_over_each_other_are_no_stairs():
    assert "step" not in only(STAIRS[:2])
    assert "step" not in only([(box(0, 0, 0.9, 0.26), z) for z in (0.5, 0.67, 0.84, 1.01)])
    # Boxes of different heights in a row, too deep for treads.
    deep = [(box(0.7 * k, 0, 0.7 * k + 0.69, 0.9), 0.4 + 0.17 * k) for k in range(3)]
    assert "step" not in only(deep)


def test_platforms_that_get_much_shorter_are_no_stairs():
    """Each meets the next one, which is at its middle, along less than half of its own length."""
    halves = (1.8, 0.7, 0.1)
    parts = [(box(0.27 * k, -y, 0.27 * k + 0.26, y), 0.4 + 0.17 * k) for k, y in enumerate(halves)]
    same = [(box(0.27 * k, 0, 0.27 * k + 0.26, 0.7), 0.4 + 0.17 * k) for k in range(3)]
    assert only(same) == ["step"] * 3
    assert "step" not in only(parts)


@pytest.mark.parametrize("parts", [case[0] for case in CASES[1:]])
def test_without_a_floor_heights_count_from_the_map_s_origin(parts):
    rng = np.random.default_rng(1)
    surfaces = [noisy_surface(polygon, z, rng) for polygon, z in parts]
    unknown, known = (label_surfaces(surfaces, z, None, Config()) for z in (None, 0.0))
    assert unknown == known


def test_a_surface_in_the_shape_of_an_l_is_no_bed():
    sofa = shapely.union_all([box(0, 0, 2.4, 0.9), box(1.6, -1.0, 2.4, 0.9)])
    assert only([(sofa, 0.44)]) == ["other"]
    assert only([(box(0, 0, 2.4, 1.9), 0.44)]) == ["bed"]


def furniture(seed):
    """Outlines of any size at any height, alone in a room."""
    rng = np.random.default_rng(seed)
    return [(box(0, 0, *rng.uniform(0.1, 2.2, 2)), rng.uniform(0.3, 1.5)) for _ in range(300)]


def test_no_label_is_given_below_the_min_confidence():
    for min_confidence in (0.3, 0.5, 0.8):
        rules = Config.model_validate({"labels": {"min_confidence": min_confidence}})
        found = [names(one, config=rules)[0] for one in furniture(0)]
        named = [confidence for name, confidence in found if name != "other"]
        assert named
        assert min(named) >= min_confidence
        assert all(0.0 <= confidence <= 1.0 for _, confidence in found)


def test_a_higher_min_confidence_only_replaces_labels_by_other():
    strict = Config.model_validate({"labels": {"min_confidence": 0.8}})
    changed = 0
    for one in furniture(1):
        (before, _), (after, _) = names(one)[0], names(one, config=strict)[0]
        assert after in (before, "other")
        changed += after != before
    assert changed


# [rules]
CALLED = {
    "low_table": "table",
    "sofa": "seat",
    "bench": "seat",
    "sideboard": "other",
    "side_table": "other",
}
RULES = ("table", "counter", "seat", "bed", "shelf", "ledge", "step", *CALLED)
AT_WALL = {"bench", "sideboard"}
NOWHERE = (9.0, 9.1, 0.1, 0.2, 0.1, 0.2)
EXAMPLES = {
    "table": [(box(0, 0, 1.4, 0.8), 0.74)],
    "counter": [WORKTOP],
    "low_table": [(box(0, 0, 1.1, 0.6), 0.42)],
    "seat": [(box(0, 0, 0.45, 0.42), 0.45)],
    "sofa": [(box(0, 0, 1.9, 0.6), 0.44), (box(-0.1, 0.61, 2.0, 0.8), 0.8)],
    "bench": [(box(0, 0, 1.2, 0.42), 0.45)],
    "sideboard": [(box(0, 0, 1.3, 0.44), 0.76)],
    "side_table": [(box(0, 0, 0.42, 0.42), 0.485)],
    "bed": [(box(0, 0, 2.0, 0.9), 0.5)],
    "shelf": SHELF[1:],
    "ledge": [(box(0, 0, 1.2, 0.2), 0.9)],
    "step": [(box(0.8, 0.05, 1.4, 0.55), 0.96), WORKTOP],
}


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_that_is_changed_takes_effect(rule):
    walls = WALL if rule in AT_WALL else None
    called = CALLED.get(rule, rule)
    assert only(EXAMPLES[rule], walls=walls)[0] == called
    without = Config.model_validate({"labels": {rule: NOWHERE}})
    assert only(EXAMPLES[rule], walls=walls, config=without)[0] != called


def test_there_is_an_example_for_each_rule():
    rules = LabelsConfig().model_dump()
    group = {name for name, value in rules.items() if isinstance(value, tuple) and len(value) == 6}
    assert group == set(RULES) == set(EXAMPLES)


# [/rules]


@pytest.mark.parametrize("height", [0.68, 0.76, 0.84])
def test_sideboard_is_no_table_or_counter_but_desk_and_worktop_are(height):
    """At a wall the depth tells: sideboards are 0.3 to 0.5 m deep."""
    assert only([(box(0, 0, 1.4, 0.43), height)], walls=WALL) == ["other"]
    assert only([DESK], walls=WALL) == ["table"]
    assert only([WORKTOP], walls=WALL) == ["counter"]


def test_a_bench_at_a_wall_is_a_seat_and_a_coffee_table_stays_a_table():
    assert only([(box(0, 0, 1.2, 0.40), 0.45)], walls=WALL) == ["seat"]
    assert only([(box(0, 1.0, 1.1, 1.6), 0.42)], walls=WALL) == ["table"]


def test_the_rise_of_stairs_is_a_parameter():
    flat = Config.model_validate({"labels": {"stair_rise": (0.3, 0.4)}})
    assert "step" not in only(STAIRS, config=flat)


def test_the_label_is_other_where_two_labels_fit():
    """A bed of 0.9 m with a rim along its side is a sofa as well."""
    bed, rim = box(0, 0, 2.0, 0.9), box(0, 0.91, 2.0, 1.05)
    assert only([(bed, 0.45)]) == ["bed"]
    (name, confidence), _ = names((bed, 0.45), (rim, 0.85))
    assert (name, confidence) == ("other", 0.0)
