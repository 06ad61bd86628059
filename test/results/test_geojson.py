"""GeoJSON as RFC 7946 asks for it, but for coordinates that are metres of a map."""

import json

import numpy as np
import pytest
import shapely
from outlined_surfaces import L_SHAPE, RECTANGLE_WITH_HOLE, surface
from shapely import box

from tccm_ros.records import Wall
from tccm_ros.results.geojson import feature_collection
from tccm_ros.results.numbers import json_text

SURFACES = [surface(L_SHAPE, number=1), surface(RECTANGLE_WITH_HOLE, (0.01, 0.02), number=2)]
WALLS = [
    Wall(4, 0.0, 2.0, np.array([[2.0, -1.0], [2.0, 1.93]]), 9, np.eye(2), (5,)),
    Wall(5, np.pi / 2 + 1e-3, 2.1, np.array([[1.9, 2.1], [-1.0, 2.1]]), 9, np.eye(2), (4,)),
]


@pytest.fixture(scope="module")
def collection():
    return json.loads(json_text(feature_collection(SURFACES, WALLS, "map")))


def test_features_have_the_members_that_rfc_7946_requires(collection):
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection, "the format of 2016 has no such member"
    assert len(collection["features"]) == 4
    for feature in collection["features"]:
        assert feature["type"] == "Feature"
        assert {"geometry", "properties"} <= set(feature)
        assert not {"coordinates", "geometries", "features"} & set(feature)


def test_rings_are_closed_and_have_the_direction_of_rfc_7946(collection):
    for feature in collection["features"][:2]:
        assert feature["geometry"]["type"] == "Polygon"
        for k, ring in enumerate(feature["geometry"]["coordinates"]):
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            assert shapely.LinearRing([p[:2] for p in ring]).is_ccw == (k == 0)


def test_shapely_reads_the_surfaces(collection):
    for feature, one in zip(collection["features"], SURFACES, strict=False):
        polygon = shapely.from_geojson(json.dumps(feature["geometry"]))
        assert polygon.is_valid
        assert polygon.area == pytest.approx(one.area, abs=1e-4)
        assert len(polygon.interiors) == len(one.holes)
        heights = shapely.get_coordinates(polygon, include_z=True) @ one.normal - one.offset
        assert np.abs(heights).max() < 2e-6
        assert feature["properties"]["id"] == one.id
        assert feature["properties"]["label"] == one.label


def test_walls_of_a_corner_have_exactly_the_same_end(collection):
    first, second = (f["geometry"] for f in collection["features"][2:])
    assert first["type"] == second["type"] == "LineString"
    assert set(map(tuple, first["coordinates"])) & set(map(tuple, second["coordinates"]))


def test_an_empty_map_is_an_empty_collection():
    assert json.loads(json_text(feature_collection([], [], "map")))["features"] == []


def test_a_rectangular_surface_has_a_closed_ring_of_five_points():
    (feature,) = feature_collection([surface(box(0, 0, 1, 2))], [], "map")["features"]
    assert len(feature["geometry"]["coordinates"][0]) == 5
