"""A scene that went through the pipe between two processes in pieces is the one that was sent."""

import numpy as np
import pytest
from surface_maps import TABLE, poses_at

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.mapping.surface_slam import SurfaceSolution
from tccm_ros.nodes.solver.scene_channel import pack_scene, unpack_scene
from tccm_ros.records import Surface, SurfaceSighting
from tccm_ros.ros.surface_messages import SURFACE
from tccm_ros.slam.solution import Solution
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.surfaces.surface_map import MappedSurfaces

STAMPS = np.array([10, 20, 30], np.int64)
CUP = SceneObject(5, 1, np.array([1.2, 0.2, 0.75]), np.array([0.08, 0.08, 0.1]), 0.0)


def surface(index: int) -> Surface:
    ring = np.column_stack([np.array(TABLE.polygon.exterior.coords)[:4], np.full(4, 0.74)])
    return Surface(
        index, "table", 0.9, 0.74, np.array([0.0, 0.0, 1.0]), 0.74, 1.12, ring.mean(axis=0), ring,
        (), 400, 0.002, 10, 20, (SurfaceSighting(10, 0, 200), SurfaceSighting(20, 1, 200)),
    )  # fmt: skip


def solution(count: int) -> SurfaceSolution:
    slam = Solution(
        [], [], [], np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4, 4)),
        np.zeros((0, 6, 6)), np.zeros(0, int), np.zeros((0, 3, 3)),
    )  # fmt: skip
    surfaces = tuple(map(surface, range(count)))
    T_views = np.tile(np.eye(4), (len(STAMPS), 1, 1))
    nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.uint32)
    return SurfaceSolution(
        graph=slam, view_stamps_ns=STAMPS, T_map_views=T_views, view_poses=poses_at(T_views),
        mapped=MappedSurfaces(surfaces, 0.01, *nothing, ((),) * count), objects=(CUP,),
        trajectory_ns=np.zeros(0, np.int64), trajectory=np.zeros((0, 3)), stamp_ns=35,
    )  # fmt: skip


@pytest.mark.parametrize("count", [0, 1, 50, 51])
def test_the_pieces_make_the_scene_of_the_solution(count):
    types, sent = TypestoreMessages(), solution(count)
    pieces = pack_scene(sent, "map", None, types)
    assert len(pieces) == 1 + -(-count // 50)
    scene = unpack_scene(pieces)
    assert (scene.stamp_ns, scene.frame_id, scene.floor_z) == (35, "map", 0.01)
    assert (scene.previous_view_ns, scene.newest_view_ns) == (20, 30)
    assert scene.free_floor is None
    assert [item.id for item in scene.objects] == [CUP.id]
    assert [known.surface.id for known in scene.surfaces] == list(range(count))
    for known in scene.surfaces:
        assert known.last_view_ns == 20
        assert not known.surface.views, "they are in the message alone"
        message = types.deserialize(SURFACE, known.message)
        assert message.id == known.surface.id
        assert message.view_stamps.tolist() == [10, 20]
