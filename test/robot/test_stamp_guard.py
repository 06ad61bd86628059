"""Message time: outliers do not move it, jumps are told from reordering."""

from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.robot.stamp_guard import StampGuard

S = 1_000_000_000


def feed(guard, *events):
    """Feed (stream, seconds); return (admitted, refused, jumps) as seconds by stream."""
    admitted, refused, jumps = [], [], 0
    for key, seconds in events:
        result = guard.admit(key, round(seconds * S), (key, seconds))
        admitted += result.admitted
        refused += result.refused
        jumps += result.jumped_ns > 0
    return admitted, refused, jumps


def test_the_first_record_waits_for_the_second():
    guard = StampGuard(2 * S)
    assert feed(guard, ("a", 10)) == ([], [], 0)
    assert guard.now("a") is None
    assert feed(guard, ("a", 10.1)) == ([("a", 10), ("a", 10.1)], [], 0)
    assert guard.now("a") == 10.1 * S


def test_flush_returns_the_held_records():
    guard = StampGuard(2 * S)
    feed(guard, ("a", 10))
    assert guard.flush().admitted == [("a", 10)]


def test_small_steps_back_are_reordering():
    guard = StampGuard(2 * S)
    admitted, refused, jumps = feed(guard, ("a", 10), ("a", 11), ("a", 9.5), ("a", 12))
    assert [s for _, s in admitted] == [10, 11, 9.5, 12]
    assert not refused
    assert not jumps


def test_one_stamp_from_the_future_does_not_move_message_time():
    guard = StampGuard(2 * S)
    admitted, refused, jumps = feed(
        guard, ("a", 10), ("a", 10.1), ("a", 3610), ("a", 10.2), ("a", 10.3)
    )
    assert [s for _, s in admitted] == [10, 10.1, 10.2, 10.3]
    assert refused == [(("a", 3610), "future stamp")]
    assert not jumps
    assert guard.now("a") == 10.3 * S


def test_a_pause_loses_nothing():
    guard = StampGuard(2 * S)
    admitted, refused, _ = feed(guard, ("a", 10), ("a", 10.1), ("a", 70), ("a", 70.1))
    assert [s for _, s in admitted] == [10, 10.1, 70, 70.1]
    assert not refused


def test_a_slow_stream_loses_nothing():
    guard = StampGuard(2 * S)
    admitted, refused, _ = feed(guard, *[("a", 10.0 * k) for k in range(5)])
    assert len(admitted) == 4
    assert not refused


def test_one_stamp_from_the_past_is_out_of_order():
    guard = StampGuard(2 * S)
    admitted, refused, jumps = feed(
        guard, ("a", 10), ("b", 10), ("a", 10.1), ("b", 10.1), ("a", 0), ("b", 10.2), ("a", 10.2)
    )
    assert refused == [(("a", 0), "out of order")]
    assert len(admitted) == 6
    assert not jumps


def test_all_inputs_going_back_is_a_jump():
    guard = StampGuard(2 * S)
    before = [(key, 100 + 0.1 * k) for k in range(5) for key in "ab"]
    after = [(key, 5 + 0.1 * k) for k in range(5) for key in "ab"]
    feed(guard, *before)
    admitted, refused, jumps = feed(guard, *after)
    assert jumps == 1
    assert sorted(admitted) == sorted(after)
    assert not refused
    assert guard.now("a") == 5.4 * S


def test_a_single_input_going_back_is_a_jump_at_its_second_record():
    guard = StampGuard(2 * S)
    feed(guard, ("a", 100), ("a", 100.1))
    assert feed(guard, ("a", 5)) == ([], [], 0)
    assert feed(guard, ("a", 5.1)) == ([("a", 5), ("a", 5.1)], [], 1)


def test_one_of_two_inputs_going_back_is_no_jump():
    guard = StampGuard(2 * S)
    feed(guard, ("a", 100), ("b", 100), ("a", 100.1), ("b", 100.1))
    events = [e for k in range(40) for e in (("a", 50 + 0.1 * k), ("b", 100.2 + 0.1 * k))]
    admitted, refused, jumps = feed(guard, *events)
    assert jumps == 0
    assert sum(key == "b" for key, _ in admitted) == 40
    # a is taken for gone back by itself once it has gone on there for longer than a clock jump
    assert {reason for _, reason in refused} == {"another clock"}
    assert sum(key == "a" for key, _ in admitted) > 15


def test_later_jumps_back_do_not_refute_a_jump():
    """The end of one stream is still under way when the others have gone back; one has ended."""
    guard = StampGuard(2 * S)
    feed(guard, *[(key, 100 + 0.1 * k) for k in range(3) for key in "abc"])
    feed(guard, ("a", 5), ("b", 100.3), ("a", 5.1), ("b", 100.4))
    _, refused, jumps = feed(guard, *[(key, 5.2 + 0.1 * k) for k in range(30) for key in "ab"])
    assert jumps == 1
    assert not refused


def test_topic_without_clock_makes_no_jump_alone():
    """Our own map -> odom follows the scans into the past when no other input speaks any more."""
    guard = StampGuard(2 * S)
    feed(guard, ("a", 100), ("a", 100.1))
    results = [
        guard.admit("tf", round(seconds * S), seconds, keeps_time=False)
        for seconds in (160, 160.1, 100, 101, 102, 103, 104)
    ]
    assert not any(result.jumped_ns for result in results)


def test_jump_back_has_its_duration():
    guard = StampGuard(2 * S)
    feed(guard, ("a", 100), ("a", 100.5), ("a", 5))
    assert guard.admit("a", 6 * S, "x").jumped_ns == 94.5 * S


def test_a_jump_is_found_while_an_input_is_silent():
    guard = StampGuard(2 * S)
    feed(guard, *[(key, 100 + 0.1 * k) for k in range(3) for key in "abc"])
    _, _, jumps = feed(guard, *[("a", 5 + 0.1 * k) for k in range(30)])
    assert jumps == 1


def test_an_input_with_a_clock_of_its_own_does_not_keep_time():
    guard = StampGuard(2 * S)
    for k in range(5):
        feed(guard, ("scan", 100 + k), ("odom", 100 + k), ("joints", 100 + k), ("arm", 3700 + k))
    assert guard.now("scan") == 104 * S


def test_message_time_goes_on_without_scans():
    guard = StampGuard(2 * S)
    feed(guard, ("scan", 100), ("scan", 100.1))
    feed(guard, *[(key, 100 + k) for k in range(9) for key in ("odom", "joints")])
    assert guard.now("scan") == 108 * S


def test_streams_that_do_not_count_do_not_move_time():
    guard = StampGuard(2 * S)
    feed(guard, ("a", 1), ("a", 1.1))
    guard.admit("tf", 2 * S, "x", keeps_time=False)
    guard.admit("tf", 3 * S, "x", keeps_time=False)
    assert guard.now("a") == 1.1 * S


def test_topic_without_clock_does_not_hide_a_jump():
    """Our own map -> odom goes on with the old stamps until there is a scan again."""
    guard = StampGuard(2 * S)
    for seconds in (60, 60.1, 60.2):
        feed(guard, ("a", seconds), ("b", seconds))
        guard.admit("tf", round(seconds * S), ("tf", seconds), keeps_time=False)
    jumps = 0
    for seconds in (0, 0.1, 0.2):
        for key in "ab":
            jumps += feed(guard, (key, seconds))[2]
            guard.admit("tf", round(60.2 * S), ("tf", 60.2), keeps_time=False)
    assert jumps == 1
    assert guard.now("a") == 0.2 * S


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 100)), max_size=60))
def test_every_record_is_admitted_or_refused_once(events):
    guard = StampGuard(2 * S)
    seen = []
    for i, (key, seconds) in enumerate(events):
        result = guard.admit(key, seconds * S, i)
        seen += result.admitted + [record for record, _ in result.refused]
    rest = guard.flush()
    seen += rest.admitted + [record for record, _ in rest.refused]
    assert sorted(seen) == list(range(len(events)))


@given(
    st.lists(st.integers(0, 100), max_size=20),
    st.lists(st.integers(0, 100), max_size=20),
    st.randoms(use_true_random=False),
)
def test_growing_streams_are_admitted_whole_however_they_interleave(a, b, random):
    queues = {"a": sorted(a), "b": sorted(b)}
    guard, admitted = StampGuard(2 * S), {"a": [], "b": []}
    while any(queues.values()):
        key = random.choice([k for k, queue in queues.items() if queue])
        seconds = queues[key].pop(0)
        for got_key, got in guard.admit(key, seconds * S, (key, seconds)).admitted:
            admitted[got_key].append(got)
    for key, seconds in guard.flush().admitted:
        admitted[key].append(seconds)
    assert admitted == {"a": sorted(a), "b": sorted(b)}


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 30)), max_size=80))
def test_the_short_check_of_a_stamp_decides_as_the_full_one(events):
    checked, passed = StampGuard(2 * S), StampGuard(2 * S)
    for i, (key, seconds) in enumerate(events):
        result = checked.admit(key, seconds * S, i)
        if passed.passes(key, seconds * S):
            assert (result.admitted, result.refused, result.jumped_ns) == ([i], [], 0)
        else:
            assert passed.admit(key, seconds * S, i) == result
        assert all(passed.now(k) == checked.now(k) for k in "abcd")
    assert passed.flush() == checked.flush()


@given(st.dictionaries(st.sampled_from("abcde"), st.integers(0, 10), max_size=5))
def test_message_time_is_the_newest_but_for_a_single_one_far_ahead(newest):
    guard = StampGuard(2 * S)
    for key, seconds in newest.items():
        guard.admit(key, seconds * S, key, keeps_time=key != "e")
    guard.flush()
    others = sorted(s for key, s in newest.items() if key not in "ae")
    if len(others) > 1 and others[-1] > others[-2] + 2:
        others.pop()
    expected = max(others + [newest[key] for key in newest if key == "a"], default=None)
    assert guard.now("a") == (None if expected is None else expected * S)
