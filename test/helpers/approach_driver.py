"""approach_node over DDS, with the simulated base that it drives, and a client."""

import numpy as np
from live_robot import Listener, overrides
from rclpy.action import ActionClient

from tccm_ros.approach.speeds import STOP

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


class Driver:
    """approach_node, the base that it drives, and a client."""

    def __init__(self, ros, flat, *, is_on_tf=False, **values):
        from approach_robot import ApproachRobot
        from tccm_interfaces.action import ApproachSurface, Retreat

        from tccm_ros.nodes.approach_node import ApproachNode

        self.ros, self.robot = ros, ApproachRobot(ros, flat, is_on_tf=is_on_tf)
        named = {"use_sim_time": True, "qos.reliability": "reliable"}
        named |= {
            "approach.footprint": [0.25, 0.22, -0.25, 0.22, -0.25, -0.22, 0.25, -0.22],
            "approach.reach": 0.9,
        }
        named |= {k.replace("__", "."): v for k, v in values.items()}
        self.node = ros.add(
            ApproachNode(context=ros.another_context(), parameter_overrides=overrides(named))
        )
        viewer = Listener(ros, "client").node
        self.kinds = ApproachSurface, Retreat
        self.clients = [
            ActionClient(viewer, kind, name)
            for kind, name in zip(self.kinds, ("approach/approach_surface", "approach/retreat"))
        ]
        self.phases: list[int] = []
        self.is_closed = False
        self.robot.driver = self.node
        inputs = "/tf" if is_on_tf else "/odom", "/scan", "/tccm/surfaces", "/tccm/obstacles"
        ros.connect(self.robot.node, self.node, *inputs)
        ros.connect(self.node, self.robot.node, "/cmd_vel")
        ros.connect(self.robot.map_node, self.node, "/map", "/surface_slam/localisation")
        ros.spin_until(lambda: all(c.server_is_ready() for c in self.clients), what="the actions")
        ros.spin_until(lambda: self.node._client.surfaces and self.node._grid, what="the map")
        ros.spin_until(
            lambda: self.node._client._clients[next(iter(self.node._client._clients))]
            .service_is_ready(), what="find_surfaces",
        )  # fmt: skip
        for _ in range(12):
            self.robot.step()

    def send(self, which=0, ids=(1,), **fields):
        goal = self.kinds[which].Goal(**fields)
        if which == 0:
            goal.filter.ids = list(ids)
        sent = self.clients[which].send_goal_async(
            goal, lambda m: self.phases.append(getattr(m.feedback, "phase", -1))
        )
        self.robot.drive_until(sent.done)
        return sent.result()

    def result(self, handle, seconds=200.0):
        done = handle.get_result_async()
        self.robot.drive_until(done.done, seconds)
        return done.result().status, done.result().result

    def ask(self, *args, **fields):
        return self.result(self.send(*args, **fields))

    def stands(self) -> bool:
        """Return whether the base comes to rest and stays there, with nothing sent to it.

        Zero commands may come while it comes to rest: DDS orders them and the result at will.
        """
        before = len(self.robot.commands)
        for _ in range(15):
            self.robot.step()
        if any(speeds != STOP for speeds in self.robot.commands[before:]):
            return False
        count = len(self.robot.commands)
        place = self.robot.base.truth.copy()
        for _ in range(5):
            self.robot.step()
        is_quiet = len(self.robot.commands) == count
        return is_quiet and bool(np.allclose(self.robot.base.truth, place, atol=1e-4))

    def close(self):
        for client in self.clients:
            client.destroy()
        if not self.is_closed:
            self.node.close()
