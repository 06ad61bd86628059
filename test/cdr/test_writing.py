"""The writer of CDR against rosbags' own, byte for byte, for every type that there is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.cdr.writing import CdrWriter, numpy_name
from tccm_ros.errors import MessageError

STORE = get_typestore(Stores.ROS2_JAZZY)
WRITER = CdrWriter(STORE.fielddefs)
TYPES = TypestoreMessages()
POINT, COLOR = "geometry_msgs/msg/Point", "std_msgs/msg/ColorRGBA"
MARKER, MARKERS = "visualization_msgs/msg/Marker", "visualization_msgs/msg/MarkerArray"


def filled(msgtype, rng):
    """Return a message of a type with other values in every field, and lists of 0 to 2."""
    fields = STORE.fielddefs[msgtype][1]
    return STORE.types[msgtype](**{name: value(kind, rng) for name, kind in fields})


def value(description, rng):
    kind, detail = description
    if kind == Nodetype.NAME:
        return filled(detail, rng)
    if kind == Nodetype.BASE:
        return number(detail[0], rng)
    (inner_kind, inner), length = detail
    size = length if kind == Nodetype.ARRAY else int(rng.integers(0, 3))
    if inner_kind == Nodetype.BASE and inner[0] != "string":
        return np.array([number(inner[0], rng) for _ in range(size)], numpy_name(inner[0]))
    return [value((inner_kind, inner), rng) for _ in range(size)]


def number(base, rng):
    if base == "string":
        return "aé1_x"[: int(rng.integers(0, 6))]
    if base == "bool":
        return bool(rng.integers(0, 2))
    if base.startswith("float"):
        return float(np.float32(rng.normal()))
    if base == "byte":  # the store reads it signed where it stands alone, unsigned in arrays
        return int(rng.integers(0, 128))
    info = np.iinfo(numpy_name(base))
    return int(rng.integers(info.min, info.max, dtype=info.dtype))


@pytest.mark.parametrize("msgtype", sorted(STORE.fielddefs))
def test_every_type_is_written_as_rosbags_writes_it(msgtype):
    for seed in range(8):
        message = filled(msgtype, np.random.default_rng(seed))
        assert bytes(WRITER.write(msgtype, message)) == bytes(
            STORE.serialize_cdr(message, msgtype, little_endian=True)
        )


@settings(max_examples=100, deadline=None)
@given(
    counts=st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), max_size=4),
    ns=st.text(max_size=9).filter(lambda text: "\0" not in text),
)
def test_a_table_is_written_as_the_list_of_its_rows(counts, ns):
    arrays = []
    for as_table in (True, False):
        rng = np.random.default_rng(1)
        markers = []
        for points, colors in counts:
            xyz, rgba = rng.normal(size=(points, 3)), np.float32(rng.random((colors, 4)))
            lists = {
                "points": [TYPES.make(POINT, x=x, y=y, z=z) for x, y, z in xyz.tolist()],
                "colors": [TYPES.make(COLOR, r=r, g=g, b=b, a=a) for r, g, b, a in rgba.tolist()],
            }
            tables = {"points": TYPES.rows(POINT, xyz), "colors": TYPES.rows(COLOR, rgba)}
            markers.append(TYPES.make(MARKER, ns=ns, **(tables if as_table else lists)))
        arrays.append(bytes(TYPES.serialize(MARKERS, TYPES.make(MARKERS, markers=markers))))
    assert arrays[0] == arrays[1]
    expected = STORE.serialize_cdr(TYPES.make(MARKERS, markers=markers), MARKERS)
    assert arrays[0] == bytes(expected)


def test_rows_can_be_chosen_again_and_again():
    colors = TYPES.rows(COLOR, [[0, 0, 0, 1], [1, 0, 0, 1]], [1, 1, 0])
    back = TYPES.serialize(MARKER, TYPES.make(MARKER, colors=colors))
    assert [c.r for c in TYPES.deserialize(MARKER, back).colors] == [1.0, 1.0, 0.0]


def test_only_messages_of_one_kind_of_number_are_rows_of_a_table():
    with pytest.raises(TypeError, match="has other fields than numbers of one kind"):
        TYPES.rows("std_msgs/msg/Header", np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("field", "wrong"), [("points", np.zeros((2, 2))), ("id", 2**31), ("id", 0.5)]
)
def test_value_that_does_not_fit_its_field_is_an_error(field, wrong):
    with pytest.raises(MessageError, match="Marker message cannot be written"):
        TYPES.serialize(MARKER, TYPES.make(MARKER, **{field: wrong}))


def test_an_array_of_another_length_is_an_error():
    pose = TYPES.make("geometry_msgs/msg/PoseWithCovariance", covariance=np.zeros(35))
    with pytest.raises(MessageError, match="35 values, expected 36"):
        TYPES.serialize("geometry_msgs/msg/PoseWithCovariance", pose)
