"""Questions over DDS while both nodes map: which surfaces, where there is room, and wrong ones."""

import pytest
from live_robot import Listener, recording, slam, tccm

from tccm_ros.nodes.interfaces import has_interfaces, service_class
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.surface_messages import SURFACE_EVENT, SURFACE_MAP, SURFACE_OBJECTS

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


class Asker:
    """Calls services, one client each."""

    def __init__(self, ros):
        self.ros = ros
        self.node = Listener(ros, "asker").node
        self._clients = {}

    def ask(self, kind: str, service: str, **fields):
        request = service_class(kind).Request(**fields)
        if service not in self._clients:
            self._clients[service] = self.node.create_client(service_class(kind), service)
        return self.ros.call(self._clients[service], request)

    def surfaces(self, **fields):
        wanted = message_class("tccm_interfaces/msg/SurfaceFilter")(**fields)
        return self.ask("FindSurfaces", "/surface_slam/find_surfaces", filter=wanted)

    def placements(self, **fields):
        size = {"size_x": 0.1, "size_y": 0.1, "height": 0.12}
        return self.ask("FindPlacements", "/surface_slam/find_placements", **(size | fields))


def test_both_nodes_answer(ros, tmp_path):
    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path / "maps"))
    robot, viewer, asker = ros.robot(), Listener(ros), Asker(ros)
    maps = viewer.listen(message_class(SURFACE_MAP), "/surface_slam/surface_map", latched=True)
    objects = viewer.listen(message_class(SURFACE_OBJECTS), "/surface_slam/objects", latched=True)
    events = viewer.listen(message_class(SURFACE_EVENT), "/surface_slam/events")
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, viewer.node, "/surface_slam/events")
    answer = asker.surfaces()
    assert not answer.success
    assert "no map yet" in answer.message
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: maps and maps[-1].surfaces and objects)
    ros.spin_until(lambda: asker.surfaces().surfaces.surfaces)
    answer = asker.surfaces()
    assert answer.success
    (table,) = answer.surfaces.surfaces
    print(table.label, table.pose, events, answer.message)
    found = asker.placements()
    assert found.success, found.message
    print(found.message, found.placements[0])
    found = asker.placements(base=2, reach=1.5, robot_radius=0.2)
    print(found.message, [p.base_poses for p in found.placements[:1]])
    found = asker.placements(base=1, reach=1.0)
    print(found.message)
    for name in ("../x", "", ".x", "a/b", "a" * 101, "x.previous"):
        assert not asker.ask("SaveMap", "/surface_slam/save_named_map", name=name).success
    saved = asker.ask("SaveMap", "/surface_slam/save_named_map", name="home")
    assert saved.success, saved.message
    print(saved)
    assert not asker.ask("SaveMap", "/surface_slam/save_named_map", name="home").success
    assert asker.ask("SaveMap", "/surface_slam/save_named_map", name="home", overwrite=True).success
    print(asker.ask("ListMaps", "/surface_slam/list_maps"))
    print(asker.ask("LoadMap", "/surface_slam/load_named_map", name="home"))
    assert not asker.ask("LoadMap", "/surface_slam/load_named_map", name="away").success
    print([(e.kind, e.label, list(e.surface_ids_after)) for e in events])
