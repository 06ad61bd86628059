"""Plain records of messages of either message classes."""

import re
from pathlib import Path

import numpy as np
import pytest
from outlined_surfaces import RECTANGLE_WITH_HOLE, surface

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.ros.map_records import (
    ACCESS_STATES,
    BOX_STATES,
    EVENT_KINDS,
    FACE_STATES,
    LOCALISATION_STATES,
    MapSurface,
)
from tccm_ros.ros.surface_messages import SURFACE, surface_message
from tccm_ros.scene.scene import surface_pose

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"


@pytest.mark.parametrize(
    ("interface", "prefix", "names"),
    [
        ("msg/SurfaceEvent.msg", "", EVENT_KINDS),
        ("msg/Localisation.msg", "", LOCALISATION_STATES),
        ("msg/Compartment.msg", "FACE_", FACE_STATES),
        ("msg/FoundObject.msg", "ACCESS_", ACCESS_STATES),
        ("srv/CheckBox.srv", "", BOX_STATES),
    ],
)
def test_names_of_states_are_those_of_the_constants(interface, prefix, names):
    text = (INTERFACES / interface).read_text()
    constants = re.findall(rf"^uint8 {prefix}([A-Z_]+) = (\d+)", text, re.M)
    known = {int(value): name.lower() for name, value in constants if "PLACED" not in name}
    assert known == dict(enumerate(names))


def test_a_surface_from_a_bag_is_read_as_from_a_node():
    types, table = TypestoreMessages(), surface(RECTANGLE_WITH_HOLE)
    sent = types.serialize(SURFACE, surface_message(types, 3, "map", table, 0.1))
    read = MapSurface.of(types.deserialize(SURFACE, sent))
    T, size = surface_pose(table)
    np.testing.assert_allclose(read.T_map_surface, T, atol=1e-12)
    np.testing.assert_array_equal(read.size, size)
    np.testing.assert_array_equal(read.boundary, table.boundary)
    assert (read.id, read.label, read.near_signs) == (table.id, table.label, table.near)
    assert read.height == pytest.approx(T[2, 3] - 0.1)
    assert (read.first_seen_ns, read.last_seen_ns) == (table.first_seen_ns, table.last_seen_ns)
