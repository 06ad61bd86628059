"""A node that calls the services of both nodes."""

from geometry_msgs.msg import Point, Pose, PoseStamped, Vector3
from live_robot import Listener
from std_msgs.msg import Header

from tccm_ros.nodes.interfaces import service_class
from tccm_ros.nodes.ros_types import message_class


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

    def find_placements(self, **fields):
        size = {"size_x": 0.1, "size_y": 0.1, "height": 0.12}
        return self.ask("FindPlacements", "/surface_slam/find_placements", **(size | fields))

    def find_objects(self, **fields):
        return self.ask("FindObjects", "/surface_slam/find_objects", **fields)

    def box(self, xyz, size, frame="odom"):
        x, y, z = map(float, xyz)
        pose = PoseStamped(header=Header(frame_id=frame), pose=Pose(position=Point(x=x, y=y, z=z)))
        a, b, c = map(float, size)
        return self.ask("CheckBox", "/tccm/check_box", pose=pose, size=Vector3(x=a, y=b, z=c))
