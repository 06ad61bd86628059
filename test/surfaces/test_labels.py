"""Labels of outlines that a person would name, and "other" where a person would ask."""

import numpy as np
import pytest
import shapely
from shapely import affinity, box

from tccm_ros.config import Config
from tccm_ros.surfaces.labels import _width

L_COUNTER = shapely.union_all([box(0, 0, 2.4, 0.6), box(1.8, -2.1, 2.4, 0.6)])


def edges(polygon):
    ring = np.asarray(shapely.oriented_envelope(polygon).exterior.coords)
    return np.sort(np.hypot(*np.diff(ring[:3], axis=0).T))


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0])
def test_a_bent_counter_is_as_wide_as_its_arms(angle):
    polygon = affinity.rotate(L_COUNTER, angle)
    assert _width(polygon, edges(polygon)) == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize(("width", "length"), [(0.8, 1.2), (0.2, 2.0), (0.5, 0.5)])
def test_a_rectangle_is_as_wide_as_its_shorter_side(width, length):
    polygon = affinity.rotate(box(0, 0, length, width), 31.0)
    assert _width(polygon, edges(polygon)) == pytest.approx(width, abs=1e-9)


def test_the_rules_know_the_ranges_of_the_configuration():
    rules = Config().labels
    assert rules.counter[0] < 0.9 < rules.counter[1]
    assert rules.seat[1] < rules.table[1]


def test_a_narrow_band_with_wavy_edges_is_as_wide_as_on_the_mean():
    x = np.linspace(0.0, 2.0, 41)
    wave = 0.04 * np.sin(2.0 * np.pi * x / 0.5)
    ring = [*zip(x, wave, strict=True), *zip(x[::-1], 0.24 + wave[::-1], strict=True)]
    band = shapely.Polygon(ring)
    assert edges(band)[0] == pytest.approx(0.32, abs=0.01)
    assert _width(band, edges(band)) == pytest.approx(0.24, abs=0.025)
