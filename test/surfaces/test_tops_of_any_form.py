"""Tops like an L, a U or a ring keep their form, however sensors sample them."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity
from surface_maps import above_floor, poses_at

from tccm_ros.config import Config
from tccm_ros.geometry import spatial, transform
from tccm_ros.mapping.surface_slam import SurfaceSlam
from tccm_ros.records import SurfaceCloud, ViewIntervals

MIN_OVERLAP = {"laser": 0.9, "camera": 0.9, "lidar": 0.87}
"""The distance of a lidar's rings is up to 10 cm here: one view leaves an edge open by as much."""

HEIGHT, MAX_RANGE, COLUMN, NOISE = 0.9, 4.0, 0.1, 0.003


def top_of(form, length, width, arm):
    """Return a top whose arms have a width, its middle at the origin."""
    outer = shapely.box(0, 0, length, width)
    inner = {
        "L": shapely.box(arm, arm, length, width),
        "U": shapely.box(arm, arm, length - arm, width),
        "ring": shapely.box(arm, arm, length - arm, width - arm),
    }[form]
    return affinity.translate(outer.difference(inner), -0.5 * length, -0.5 * width)


def beams(sensor, rng):
    """Return where the beams of a sensor meet the height of a top, float64 (N, 2), from its place.

    A laser has dense points on lines at a distance, a lidar of 128 rings over 45 deg on rings whose
    distance grows with range (4 to 10 cm here), and a camera a grid of pixels.
    """
    if sensor == "camera":
        x, tangent = np.meshgrid(0.5 / np.linspace(0.13, 0.9, 160), np.linspace(-0.7, 0.7, 240))
        return np.column_stack([x.ravel(), (x * tangent).ravel()])
    radii = np.arange(0.4, MAX_RANGE, rng.uniform(0.02, 0.06))
    if sensor == "lidar":
        radii = 0.5 / np.tan(np.arange(0.13, 0.9, np.radians(45.0 / 128)))
    r, angle = np.meshgrid(radii, np.arange(-np.pi, np.pi, np.radians(0.5)))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


def look(top, sensor, pose, stamp_ns, rng):
    """Return cloud and free intervals of a view of a top from a pose (x, y, yaw)."""
    at = beams(sensor, rng)
    local = np.column_stack([at, np.full(len(at), HEIGHT)])
    x, y, _ = transform(spatial(np.array(pose)), local).T
    hits = shapely.contains_xy(top, x, y)
    points = local[hits] + rng.normal(0.0, NOISE, (hits.sum(), 3))
    cells = np.unique(np.floor(at[~hits] / COLUMN), axis=0)
    middle = COLUMN * (cells + 0.5)
    through = np.column_stack([middle, np.full((len(middle), 2), (0.3, 1.3))])
    index = np.zeros(len(points), np.uint32)
    return (
        SurfaceCloud(stamp_ns, "base", points.astype(np.float32), index),
        ViewIntervals(stamp_ns, "base", through.astype(np.float32)),
    )


def mapped(top, sensor, poses, rng):
    """Return the polygons of the surfaces that views from poses give."""
    surface_map = SurfaceSlam(Config()).map
    for k, pose in enumerate(poses):
        for record in look(top, sensor, pose, k + 1, rng):
            surface_map.add(record)
    found = surface_map.build(poses_at(spatial(np.array(poses))))
    return [
        Polygon(surface.boundary[:, :2], [hole[:, :2] for hole in surface.holes])
        for surface in above_floor(found)
    ]


@pytest.mark.parametrize("sensor", ["laser", "camera", "lidar"])
@given(
    st.sampled_from(["L", "U", "ring"]),
    st.floats(1.3, 2.4),
    st.floats(1.2, 1.8),
    st.floats(0.28, 0.45),
    st.floats(-np.pi, np.pi),
    st.integers(1, 4),
    st.integers(0, 99),
)
@settings(max_examples=8, deadline=None, derandomize=True)
def test_a_top_of_two_to_four_arms_keeps_its_form(
    sensor, form, length, width, arm, angle, views, seed
):
    rng = np.random.default_rng(seed)
    top = affinity.rotate(top_of(form, length, width, arm), angle, (0, 0), use_radians=True)
    bearings = rng.uniform(-np.pi, np.pi) + 2.0 * np.pi / views * np.arange(views)
    poses = [(2.2 * np.cos(a), 2.2 * np.sin(a), a + np.pi) for a in bearings.tolist()]
    found = mapped(top, sensor, poses, rng)
    assert len(found) == 1
    assert found[0].intersection(top).area / found[0].union(top).area >= MIN_OVERLAP[sensor]
