"""A snapshot brings back what it was made of: values, types, sharing, and nothing else."""

import json
from collections import Counter, deque

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tccm_ros.config import Config
from tccm_ros.cuboids.tilt_cycle import TiltCycles
from tccm_ros.errors import FrameError, MapError
from tccm_ros.records import Odometry
from tccm_ros.robot.tracks import ScalarTrack
from tccm_ros.slam.factors import Key
from tccm_ros.snapshot import TABLE, freeze, thaw

CONFIG = Config()

scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
values = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner)
        | st.lists(inner).map(tuple)
        | st.dictionaries(st.integers() | st.text(), inner)
    ),
    max_leaves=8,
)


def again(x):
    return thaw(freeze(x, CONFIG), CONFIG)


@settings(max_examples=200, deadline=None)
@given(values)
def test_plain_values_come_back(x):
    assert again(x) == x
    assert repr(again(x)) == repr(x)


@settings(max_examples=200, deadline=None)
@given(
    hnp.arrays(
        st.sampled_from([np.float64, np.float32, np.int64, np.int32, np.uint8, np.bool_]),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0),
    ),
    st.booleans(),
)
def test_arrays_come_back_bit_for_bit(x, by_columns):
    x = np.asfortranarray(x) if by_columns else x
    got = again(x)
    assert (got.dtype, got.shape) == (x.dtype, x.shape)
    assert got.tobytes() == x.tobytes()
    assert got.flags.c_contiguous == x.flags.c_contiguous


def test_numbers_of_numpy_keep_their_type():
    got = again([np.float32(0.1), np.int64(7), np.float64("nan"), float("inf")])
    assert [type(x) for x in got] == [np.float32, np.int64, np.float64, float]
    assert got[0] == np.float32(0.1)


def test_what_is_shared_stays_shared():
    shared, array = [1], np.zeros(3)
    a, b, (c, d) = again([shared, shared, (array, array)])
    assert a is b
    assert c is d
    c[0] = 1.0
    assert d[0] == 1.0


def test_a_ring_closes():
    ring: list = []
    ring.append({"ring": ring})
    got = again(ring)
    assert got[0]["ring"] is got


def test_containers_keep_their_kind():
    queue = deque([1, 2], maxlen=5)
    got, counter, some, fixed = again([queue, Counter(a=2), {3, -8}, frozenset("ab")])
    assert some == {-8, 3}
    assert (fixed, type(fixed)) == (frozenset("ab"), frozenset)
    assert got == queue
    assert got.maxlen == 5
    assert type(counter) is Counter
    assert counter["b"] == 0


def test_objects_of_the_package_come_back():
    track = ScalarTrack()
    for stamp in range(100):
        track.append(stamp, 0.1 * stamp)
    odom = Odometry(5, "odom", "base", np.eye(4))
    key, problem = Key("x", 3, 0.1), FrameError("no way")
    shape = shapely.Polygon([(0, 0), (1, 0), (0.3, 0.1 + 0.2)])
    track2, odom2, key2, problem2, shape2 = again([track, odom, key, problem, shape])
    assert np.array_equal(track2.stamps_ns, track.stamps_ns)
    assert track2.append(100, 1.0)
    assert (odom2.stamp_ns, odom2.frame_id) == (5, "odom")
    assert key2 == key
    assert type(key2) is Key
    assert str(problem2) == "no way"
    assert type(problem2) is FrameError
    assert shapely.to_wkb(shape2) == shapely.to_wkb(shape)


def test_the_configuration_is_that_of_who_thaws():
    cycles = TiltCycles(CONFIG)
    group, method = again([CONFIG.cycle, cycles.advance])
    assert group is CONFIG.cycle
    assert isinstance(method.__self__, TiltCycles)


def test_the_same_state_gives_the_same_bytes():
    x = {"b": [np.arange(3), {3, 1, 2}], "a": (1.5, None)}
    one, two = freeze(x, CONFIG), freeze(again(x), CONFIG)
    assert {k: v.tobytes() for k, v in one.items()} == {k: v.tobytes() for k, v in two.items()}


@pytest.mark.parametrize("x", [lambda: 0, object(), np.array([object()]), np.array(["a"]), open])
def test_what_has_no_form_is_refused(x):
    with pytest.raises(TypeError, match="no form"):
        freeze([x], CONFIG)


def forged(*entries):
    text = json.dumps({"root": [0], "table": entries})
    return {TABLE: np.frombuffer(text.encode(), np.uint8)}


@pytest.mark.parametrize(
    "entry",
    [
        ["object", "os", "system", []],
        ["object", "subprocess", "Popen", []],
        ["named", "builtins", "tuple", []],
        ["object", "tccm_ros.bags.reader", "BagReader", []],
        ["object", "tccm_ros.slam.graph", "gtsam", []],
        ["object", "tccm_ros.slam.graph", "solve_graph", []],
        ["object", "tccm_ros.slam.graph", "NDArray", []],
        ["array", "f8", 0, [3], False, True],
        ["list", [[1]]],
        ["nothing"],
        [],
    ],
)
def test_a_forged_snapshot_makes_nothing(entry):
    with pytest.raises(MapError, match="damaged"):
        thaw(forged(entry), CONFIG)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 255))
def test_a_damaged_table_is_an_error_or_harmless(where, byte):
    arrays = freeze([Odometry(5, "odom", "base", np.eye(4)), {"a": (1, 2.5)}], CONFIG)
    table = arrays[TABLE].copy()
    table[where % len(table)] = byte
    try:
        state = thaw({**arrays, TABLE: table}, CONFIG)
    except MapError:
        return
    assert freeze(state, CONFIG), "what was read is state, which can be written again"
