"""The robot's own shapes, on random trees of joints, against pinocchio."""

import numpy as np
from hypothesis import given, settings
from random_robots import pinocchio_poses, trees
from robots import joint, joints_at, robot

from tccm_ros.robot.chain import JointReading
from tccm_ros.robot.frames import FrameTree
from tccm_ros.robot.joint_tracks import JointTracks
from tccm_ros.robot.self_shapes import ShapeModel
from tccm_ros.robot.urdf import read_urdf

BALL = (
    '<collision><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>'
    '<geometry><sphere radius="1"/></geometry></collision>'
)


@given(trees())
@settings(max_examples=40, deadline=None)
def test_shapes_agree_with_pinocchio(tree):
    text, positions = tree
    with_balls = text.replace("></link>", f">{BALL}</link>")
    joints = JointTracks(0)
    joints.add(joints_at(5, **positions))
    frames = FrameTree()
    frames.describe(with_balls)
    model = frames.model

    def reading(joint):
        return JointReading(joint.name, joints.of(joint.name), joint.axis, joint.motion == "turn")

    base = model.links[len(model.links) // 2]
    edges = frames.view()
    shapes = ShapeModel(model, base, edges, reading).at(5)
    T_root_link = pinocchio_poses(text, positions)
    T_base_root = np.linalg.inv(T_root_link(base))
    expected = [T_base_root @ T_root_link(s.link) @ s.T_link_shape for s in model.shapes]
    assert len(expected) == len(model.links)
    # chains of up to eight joints of some metres, in double precision
    np.testing.assert_allclose(shapes.T_base_shape, expected, atol=1e-9)


def test_shapes_below_a_silent_joint_are_left_out():
    joints = JointTracks(0)

    def reading(joint):
        return JointReading(joint.name, joints.of(joint.name), joint.axis, joint.motion == "turn")

    text = robot([joint("a", "revolute", "base", "b"), joint("c", "fixed", "b", "d")])
    model = read_urdf(text.replace("></link>", f">{BALL}</link>"))
    shapes = ShapeModel(model, "base", dict(model.joints), reading).at(0)
    assert shapes.kinds.tolist() == [1]
