"""Records that were overtaken: none is lost within the window, an orderly stream does not wait."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.robot.stamp_order import StampOrder

WINDOW_NS = 50_000_000
LATE, TWICE = "out of order", "duplicate stamp"


def stamps_of(seed: int, period_ns: int, jitter: float, lost: float) -> np.ndarray:
    """Return rising stamps with steps of a period, more or less, some of them lost."""
    rng = np.random.default_rng(seed)
    steps = period_ns * (1.0 + jitter * rng.uniform(-1.0, 1.0, 300))
    stamps = np.cumsum(steps).astype(np.int64)
    return stamps[rng.random(300) >= lost]


@given(
    st.integers(0, 10_000),
    st.integers(2_000_000, 90_000_000),
    st.floats(0.0, 0.12),
    st.floats(0.0, 0.3),
)
@settings(max_examples=60, deadline=None)
def test_none_is_lost_that_is_late_by_less_than_the_window(
    seed: int, period_ns: int, jitter: float, lost: float
) -> None:
    stamps = stamps_of(seed, period_ns, jitter, lost)
    delays = np.random.default_rng(seed + 1).uniform(0, WINDOW_NS - 1, len(stamps))
    order = StampOrder(WINDOW_NS)
    given_out: list[int] = []
    waiting: list[int] = []
    for stamp in stamps[np.argsort(stamps + delays)].tolist():
        assert order.add(stamp) is None
        waiting = sorted([*waiting, stamp])
        while waiting and order.is_final(waiting[0]):
            given_out.append(waiting.pop(0))
    assert [*given_out, *waiting] == stamps.tolist()
    assert waiting[-1:] == [] or waiting[-1] - waiting[0] < WINDOW_NS


def test_an_orderly_stream_does_not_wait_once_its_period_is_known() -> None:
    order = StampOrder(WINDOW_NS)
    stamps = stamps_of(1, 25_000_000, 0.12, 0.0).tolist()
    at_once = []
    for stamp in stamps:
        assert order.add(stamp) is None
        at_once.append(order.is_final(stamp))
    steps_of_window = 3
    assert not at_once[0]
    assert all(at_once[8 + steps_of_window :])


def test_after_a_gap_a_stream_waits_for_the_window_alone() -> None:
    order = StampOrder(WINDOW_NS)
    for stamp in range(0, 1_000_000_000, 25_000_000):
        order.add(stamp)
    after = 5_000_000_000
    order.add(after)
    assert not order.is_final(after)
    order.add(after + 25_000_000)
    assert not order.is_final(after)
    order.add(after + WINDOW_NS)
    assert order.is_final(after)
    assert order.is_final(after + WINDOW_NS)


def test_refused_records_are_named() -> None:
    order = StampOrder(WINDOW_NS)
    for stamp in range(0, 1_000_000_000, 25_000_000):
        order.add(stamp)
    assert order.newest_ns == 975_000_000
    assert order.add(975_000_000) == TWICE
    assert order.add(960_000_000) == LATE


def test_a_window_of_zero_takes_rising_stamps_alone() -> None:
    order = StampOrder(0)
    assert [order.add(s) for s in (1, 5, 3, 6)] == [None, None, LATE, None]


def test_records_before_an_external_final_stamp_are_late() -> None:
    order = StampOrder(WINDOW_NS)
    order.add(10)
    order.make_final(10)
    assert order.is_final(10)
    assert order.add(9) == LATE
    order.clear()
    assert order.newest_ns is None
    assert order.add(9) is None
