from types import SimpleNamespace

import pytest

from tccm_ros.results.surface_counts import SurfaceCounts, count_surfaces


def surface(label, area):
    return SimpleNamespace(label=label, area=area)


def test_counts_exclude_the_floor_and_separate_small_surfaces():
    areas = [("floor", 12.0), ("floor", 0.05), ("table", 0.1), ("other", 0.09), ("shelf", 0.4)]
    assert count_surfaces(surface(*row) for row in areas) == SurfaceCounts(counted=2, small=1)


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        (SurfaceCounts(0, 0), "0 surfaces"),
        (SurfaceCounts(1, 0), "1 surface"),
        (SurfaceCounts(20, 7), "20 surfaces (and 7 below 0.1 m²)"),
    ],
)
def test_the_text_has_both_numbers(counts, text):
    assert counts.text() == text
