"""Surfaces in a planning scene: read back as MoveIt reads them, and compared with the surfaces."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
from outlined_surfaces import L_SHAPE, RECTANGLE_WITH_HOLE, surface
from scipy.spatial.transform import Rotation
from shapely import Point, Polygon, affinity, box

from tccm_ros.results.planning import scene_text
from tccm_ros.scene.planning_shapes import (
    Box,
    Mesh,
    scene_shapes,
    surface_box,
    surface_mesh,
    surface_shape,
)
from tccm_ros.surfaces.objects.scene_objects import SceneObject

SHAPES = {
    "table": box(0, 0, 1.4, 0.8),
    "round": Point(0, 0).buffer(0.5),
    "bent": L_SHAPE,
    "holed": RECTANGLE_WITH_HOLE,
    "sliver": box(0, 0, 1.2, 0.05),
}


@dataclass
class Read:
    name: str
    kind: str
    size: np.ndarray
    vertices: np.ndarray
    triangles: np.ndarray
    T: np.ndarray


SOLIDS = {"box": 3, "cylinder": 2}
"""Number of lengths of each solid."""


def take(words, count, kind=float):
    return np.array([kind(next(words)) for _ in range(count)])


def read_scene(text):
    """Read a scene as `PlanningScene::loadGeometryFromStream` does: words, but for two lines."""
    title, rest = text.split("\n", 1)
    second_line = rest.split("\n")[1].strip() if rest.startswith("*") else ""
    assert " " not in second_line, "spaces there mean the newer form, with a pose"
    found = []
    while not rest.startswith("."):
        head, rest = rest.split("\n", 1)
        assert head.startswith("* ")
        words = iter(rest.split())
        assert next(words) == "1"
        kind = next(words)
        size, vertices, triangles = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), int)
        if kind in SOLIDS:
            size = take(words, SOLIDS[kind])
        else:
            assert kind == "mesh"
            v, t = take(words, 2, int)
            vertices, triangles = (
                take(words, 3 * v).reshape(v, 3),
                take(words, 3 * t, int).reshape(t, 3),
            )
        T = np.eye(4)
        T[:3, 3], T[:3, :3] = take(words, 3), Rotation.from_quat(take(words, 4)).as_matrix()
        assert take(words, 4).tolist() == [0, 0, 0, 0]
        lines = 6 + (1 + v + t if kind == "mesh" else 1) - 1
        rest = rest.split("\n", lines)[lines]
        found.append(Read(head[2:].strip(), kind, size, vertices, triangles, T))
    assert rest == ".\n"
    return title, found


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, -0.02)])
@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 135.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_collision_object_contains_the_surface_and_nothing_above_it(shape, yaw_deg, slope):
    one = surface(affinity.rotate(SHAPES[shape], yaw_deg), slope)
    title, (read,) = read_scene(scene_text(scene_shapes([one], [])))
    assert (title, read.name) == ("tccm_ros", "tccm_surface_3")
    if read.kind == "box":
        corners = np.array(np.meshgrid(*([(-0.5, 0.5)] * 3))).reshape(3, -1).T * read.size
    else:
        corners = read.vertices
    corners = corners @ read.T[:3, :3].T + read.T[:3, 3]
    above = corners @ one.normal - one.offset
    assert above.max() == pytest.approx(0.0, abs=2e-6)
    assert above.min() == pytest.approx(-0.02, abs=2e-6)
    footprint = shapely.MultiPoint(corners[:, :2]).convex_hull
    assert footprint.buffer(2e-3).contains(Polygon(one.boundary[:, :2]))


@pytest.mark.parametrize("shape", ["bent", "holed"])
def test_a_mesh_leaves_the_space_free_that_a_box_would_block(shape):
    one = surface(SHAPES[shape])
    _, (read,) = read_scene(scene_text(scene_shapes([one], [])))
    assert read.kind == "mesh"
    a, b, c = (read.vertices[read.triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(0.02 * one.area, rel=1e-4)
    edges = read.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()
    assert sorted(edges) == sorted([b, a] for a, b in edges), "each edge twice, once each way"
    box_ = surface_box(one)
    assert box_.size[0] * box_.size[1] > 1.2 * one.area


def test_a_surface_that_fills_its_box_is_a_box():
    assert isinstance(surface_shape(surface(SHAPES["table"])), Box)
    assert isinstance(surface_shape(surface(SHAPES["round"])), Box)
    assert isinstance(surface_shape(surface(SHAPES["bent"])), Mesh)


def test_a_round_object_is_a_cylinder_of_its_radius_and_height():
    can = SceneObject(7, 3, np.array([0.5, 0.4, 0.8]), np.array([0.08, 0.08, 0.12]), 0.3)
    for is_round, solid in ((True, ("cylinder", [0.04, 0.12])), (False, ("box", [*can.size]))):
        _, (read,) = read_scene(scene_text(scene_shapes([], [replace(can, is_round=is_round)])))
        assert (read.kind, read.size.tolist()) == solid
        assert read.T[:3, 3] == pytest.approx(can.center)


def test_the_floor_is_left_out_and_an_empty_map_is_an_empty_scene():
    floor = surface(box(-3, -3, 3, 3), height=0.0, label="floor", number=0)
    assert scene_text(scene_shapes([floor], [])) == scene_text({}) == "tccm_ros\n.\n"
    _, found = read_scene(
        scene_text(scene_shapes([floor, surface(L_SHAPE), replace(surface(L_SHAPE), id=9)], []))
    )
    assert [read.name for read in found] == ["tccm_surface_3", "tccm_surface_9"]


@pytest.mark.parametrize("shape", SHAPES)
def test_triangles_of_the_top_have_upward_normals(shape):
    mesh = surface_mesh(surface(SHAPES[shape], (0.02, 0.01)))
    count = len(mesh.vertices) // 2
    top = mesh.triangles[(mesh.triangles < count).all(axis=1)]
    a, b, c = (mesh.vertices[top[:, k]] for k in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.0)
