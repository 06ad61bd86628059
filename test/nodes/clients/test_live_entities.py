"""Messages of the map as entities of the live page."""

import numpy as np
import pytest

from tccm_ros.nodes.interfaces import has_interfaces

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


def test_a_compartment_has_its_box_and_an_arrow_through_its_front():
    from tccm_interfaces.msg import Compartment, SurfaceMap

    from tccm_ros.nodes.clients.live_entities import entities_of

    space = Compartment(board_id=7, width=0.8, depth=0.3, height=0.35, back=1, left=2)
    space.front.position.x, space.front.position.y, space.front.position.z = 1.0, 2.0, 0.5
    space.front.orientation.w = 1.0  # insertion along x
    found = entities_of(SurfaceMap(compartments=[space]))["compartment/0"]
    assert (found["board"], found["back"], found["sides"][0]) == (7, "measured", "open")
    edges = np.array(found["edges"])
    box = edges[:12].reshape(-1, 3)
    np.testing.assert_allclose(box.min(axis=0), [1.0, 1.6, 0.5], atol=1e-3)
    np.testing.assert_allclose(box.max(axis=0), [1.3, 2.4, 0.85], atol=1e-3)
    # The arrow comes from outside and ends in the middle of the front edge.
    np.testing.assert_allclose(edges[12:, 1], [[1.0, 2.0, 0.5]] * 3, atol=1e-3)
    assert (edges[12:, 0, 0] < 1.0).all()


def test_an_object_stands_at_its_place_turned_as_it_is():
    from tccm_interfaces.msg import SurfaceMap, SurfaceObject

    from tccm_ros.nodes.clients.live_entities import entities_of

    item = SurfaceObject(id=3, surface_id=1)
    item.pose.position.x, item.pose.position.y, item.pose.position.z = 2.0, -1.0, 0.8
    item.pose.orientation.z = item.pose.orientation.w = np.sqrt(0.5)  # a quarter turn
    item.size.x, item.size.y, item.size.z = 0.4, 0.1, 0.2
    found = entities_of(SurfaceMap(objects=[item]))["object/3"]
    assert (found["low"], found["high"]) == (0.7, 0.9)
    assert sorted(found["corners"]) == [[1.95, -1.2], [1.95, -0.8], [2.05, -1.2], [2.05, -0.8]]


def test_a_door_sign_has_its_place_on_the_wall_and_its_text():
    from tccm_interfaces.msg import Sign, SurfaceMap

    from tccm_ros.nodes.clients.live_entities import entities_of

    sign = Sign(id=4, text="Room 12", wall_id=1)
    sign.position.x, sign.position.z, sign.normal.y = 1.5, 1.4, -1.0
    assert entities_of(SurfaceMap(signs=[sign]))["sign/4"] == {
        "id": 4, "text": "Room 12", "at": [1.5, 0.0, 1.4], "normal": [0.0, -1.0, 0.0]
    }  # fmt: skip
