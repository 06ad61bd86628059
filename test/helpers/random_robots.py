"""Random robot descriptions, and their poses by pinocchio."""

import numpy as np
import pytest
from hypothesis import strategies as st
from robots import joint, robot

KINDS = ("fixed", "revolute", "continuous", "prismatic")


number = st.floats(-3.0, 3.0).map(lambda x: round(x, 4))


triple = st.tuples(number, number, number)


@st.composite
def trees(draw):
    """Random trees of up to 8 links, with a position for each joint."""
    joints, positions = [], {}
    for i in range(1, draw(st.integers(2, 8))):
        parent = draw(st.integers(0, i - 1))
        axis = draw(triple.filter(lambda a: sum(x * x for x in a) > 0.1))
        texts = [" ".join(map(str, values)) for values in (draw(triple), draw(triple), axis)]
        joints.append(joint(f"j{i}", draw(st.sampled_from(KINDS)), f"l{parent}", f"l{i}", *texts))
        positions[f"j{i}"] = draw(number)
    return robot(joints), positions


def pinocchio_poses(text, positions):
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(text)
    q = pin.neutral(model)
    for name, value in positions.items():
        if not model.existJointName(name):
            continue
        joint_model = model.joints[model.getJointId(name)]
        numbers = [np.cos(value), np.sin(value)] if joint_model.nq == 2 else [value]
        q[joint_model.idx_q : joint_model.idx_q + joint_model.nq] = numbers
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return lambda link: data.oMf[model.getFrameId(link, pin.FrameType.BODY)].homogeneous
