"""Columns are the fields of the models; geometries are what the files say."""

import dataclasses
import json

import numpy as np
import pytest
import shapely

from tccm_ros.fleet.tables import TABLES, read_source
from tccm_ros.results.folder_reader import load_results


@pytest.fixture(scope="module")
def source(flat):
    return read_source("flat", flat)


def table(name):
    return next(t for t in TABLES if t.name == name)


def test_each_surface_is_a_row_with_its_values(source, flat):
    rows = table("surfaces").of(source).to_pylist()
    results = load_results(flat)
    assert [row["id"] for row in rows] == [s.id for s in results.surfaces]
    for row, surface in zip(rows, results.surfaces):
        assert row["centroid_y"] == surface.centroid[1]
        assert row["label"] == surface.label
        assert row["height_above_floor"] == pytest.approx(surface.height - results.ground)
        outline = shapely.from_wkb(row["geometry"])
        ring = shapely.get_coordinates(outline.exterior, include_z=True)[:-1]
        assert np.array_equal(ring, surface.boundary)


def test_free_area_is_that_of_the_polygons(source):
    rows = {row["id"]: row for row in table("surfaces").of(source).to_pylist()}
    assert source.objects.free
    for places in source.objects.free:
        area = sum(shapely.Polygon(np.array(ring)[:, :2]).area for ring in places.polygons)
        assert rows[places.surface]["free_area"] == pytest.approx(area)
    assert any(row["free_area"] is None for row in rows.values())


def test_the_base_of_a_box_has_its_size_and_place(source):
    for row, entry in zip(table("objects").of(source).to_pylist(), source.objects.objects):
        base = shapely.from_wkb(row["geometry"])
        assert base.area == pytest.approx(entry.size[0] * entry.size[1])
        assert np.allclose([base.centroid.x, base.centroid.y], entry.center[:2])


def test_a_wall_has_its_length(source):
    for row in table("walls").of(source).to_pylist():
        assert shapely.from_wkb(row["geometry"]).length == pytest.approx(row["length"])


def test_signs_come_from_their_file(flat_copy):
    sign = {
        "id": 4, "text": "EXIT", "number": "", "covariance": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "confidence": 0.9, "position": [1.0, 2.0, 1.5], "wall": None,
        "normal": [1, 0, 0], "views": [{"stamp": 5.0, "keyframe": 1, "pixel": [3, 4]}],
    }  # fmt: skip
    (flat_copy / "signs.json").write_text(json.dumps({"signs": [sign]}))
    (row,) = table("signs").of(read_source("flat", flat_copy)).to_pylist()
    assert (row["text"], row["position_z"], row["wall"]) == ("EXIT", 1.5, None)
    assert row["first_seen"] == row["last_seen"]
    assert row["last_seen"].second == 5


@pytest.mark.parametrize("name", [t.name for t in TABLES])
def test_a_table_without_rows_has_the_same_columns(name, source):
    empty = dataclasses.replace(
        source,
        surfaces=dataclasses.replace(source.surfaces, surfaces=()),
        objects=type(source.objects)(),
        walls=type(source.walls)(()),
        signs=(),
    )
    assert table(name).of(empty).schema == table(name).of(source).schema == table(name).schema


@pytest.mark.parametrize("name", [t.name for t in TABLES])
def test_the_metadata_of_geoparquet_has_no_crs(name):
    geo = json.loads(table(name).schema.metadata[b"geo"])
    column = geo["columns"][geo["primary_column"]]
    assert geo["primary_column"] in table(name).schema.names
    assert "crs" in column
    assert column["crs"] is None
