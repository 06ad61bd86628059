"""Tilt cycles: the joint's motion alone says where cycles begin and end."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tccm_rig import exactly

from tccm_ros.config import Config
from tccm_ros.cuboids.tilt_cycle import TiltCycles

RATE = 100
AMPLITUDE = np.deg2rad(30)
HALF = 1.575


def cut(times, angles, finish=True, **settings):
    """Return the spans, and check what holds always: no gaps, order, decisions kept."""
    cycles = TiltCycles(Config.model_validate({"cycle": settings}))
    for t, a in zip(times, angles, strict=True):
        decided, before = cycles.decided_ns, len(cycles.closed)
        cycles.add(round(t * 1e9), float(a))
        assert cycles.decided_ns >= decided
        # Whatever was decided stays in the span that it was said to be in.
        assert all(span.end_ns >= decided for span in list(cycles.closed)[before:])
    if finish:
        cycles.finish()
    spans = list(cycles.closed)
    for one, other in itertools.pairwise(spans):
        assert one.end_ns == other.start_ns
    numbers = [s.cycle for s in spans if s.cycle is not None]
    assert numbers == list(range(len(numbers)))
    return spans


def cycles(spans):
    return [(s.start_ns * 1e-9, s.end_ns * 1e-9) for s in spans if s.cycle is not None]


def triangle(t, half=HALF, amplitude=AMPLITUDE):
    phase = (np.asarray(t) / half) % 2.0
    return amplitude * np.where(phase < 1, 2 * phase - 1, 3 - 2 * phase)


def clock(seconds, rate=RATE):
    return np.arange(round(seconds * rate)) / rate


def test_cycles_of_a_triangle_wave_end_at_its_corners():
    t = clock(8 * HALF)
    found = cycles(cut(t, triangle(t)))
    assert len(found) == 8
    for k, (start, end) in enumerate(found):
        assert start == pytest.approx(k * HALF, abs=1.01 / RATE)
        assert end == pytest.approx((k + 1) * HALF, abs=1.01 / RATE)


@pytest.mark.parametrize("rate", [20, 50, 500])
def test_cycles_of_a_sine_wave_end_at_its_extremes(rate):
    t = clock(6 * HALF, rate)
    found = cycles(cut(t, -AMPLITUDE * np.cos(np.pi * t / HALF)))
    assert len(found) == 6
    for k, (start, _) in enumerate(found):
        assert start == pytest.approx(k * HALF, abs=1.5 / rate)


@pytest.mark.parametrize("seed", range(5))
def test_encoder_jitter_makes_no_cycles(seed):
    t = clock(6 * HALF)
    jitter = np.random.default_rng(seed).normal(0, 0.0015, len(t))
    found = cycles(cut(t, triangle(t) + jitter))
    assert len(found) == 6
    for k, (start, _) in enumerate(found):
        # 1.5 mrad of jitter at 0.66 rad/s, three sigma: within two samples.
        assert start == pytest.approx(k * HALF, abs=3.0 / RATE)


def test_one_way_motion_with_a_fast_return_makes_a_cycle_each_way():
    # 1.5 s down, 0.15 s back: the way back is a cycle of its own, of few scans.
    t = clock(4 * 1.65)
    phase = t % 1.65
    angle = np.where(phase < 1.5, -0.5 + phase / 1.5, 0.5 - (phase - 1.5) / 0.15)
    found = cycles(cut(t, angle))
    lengths = [end - start for start, end in found]
    assert lengths == pytest.approx([1.5, 0.15] * 4, abs=2.1 / RATE)


def test_a_single_motion_between_rests_is_one_cycle():
    t = clock(6.0)
    angle = np.clip((t - 2.0) / 1.5, 0.0, 1.0)
    spans = cut(t, angle)
    assert [s.reason for s in spans] == [
        "before joint samples", "joint rests", "rest", "joint rests",
    ]  # fmt: skip
    (start, end), = cycles(spans)  # fmt: skip
    # Within the dead band of 10 mrad: 15 ms at this speed.
    assert start == pytest.approx(2.0, abs=0.025)
    assert end == pytest.approx(3.5, abs=0.025)


def test_the_end_of_the_input_closes_the_open_cycle():
    t = clock(1.0)
    spans = cut(t, t)
    assert spans[-1].reason == "end"
    assert cycles(spans) == [(0.0, pytest.approx(0.99, abs=1e-6))]


def test_a_pause_of_minutes_belongs_to_no_cycle():
    up, rest = np.linspace(0, 1, 100), np.full(30_000, 1.0)
    rest = rest + np.random.default_rng(0).normal(0, 0.0005, len(rest))
    angle = np.concatenate([up, rest, np.linspace(1, 0, 100)])
    t = np.arange(len(angle)) / RATE
    spans = cut(t, angle)
    assert [s.reason for s in spans if s.cycle is not None] == ["rest", "end"]
    (_, end), (start, _) = cycles(spans)
    assert end == pytest.approx(0.99, abs=0.03)
    assert start == pytest.approx(300.99, abs=0.03)


def test_a_short_stop_does_not_end_a_cycle():
    angle = np.concatenate([np.linspace(0, 0.5, 60), np.full(30, 0.5), np.linspace(0.5, 1, 60)])
    assert len(cycles(cut(np.arange(len(angle)) / RATE, angle))) == 1


def test_a_rest_ends_a_cycle():
    angle = np.concatenate([np.linspace(0, 0.5, 60), np.full(90, 0.5), np.linspace(0.5, 1, 60)])
    spans = cut(np.arange(len(angle)) / RATE, angle)
    assert [s.reason for s in spans[1:]] == ["rest", "joint rests", "end"]


def test_lost_joint_samples_end_a_cycle():
    t = np.concatenate([clock(1.0), 3.0 + clock(1.0)])
    spans = cut(t, np.concatenate([clock(1.0), clock(1.0)]))
    assert [s.reason for s in spans[1:]] == ["gap", "no joint samples", "end"]
    assert spans[2].start_ns == 990_000_001
    assert spans[2].end_ns == 3_000_000_000


def test_advance_ends_a_cycle_whose_joint_samples_stopped():
    cycles = TiltCycles(Config())
    for t in clock(1.0):
        cycles.add(round(t * 1e9), float(t))
    cycles.advance(1_400_000_000)
    assert len(cycles.closed) == 1
    cycles.advance(1_600_000_000)
    assert cycles.closed[-1].reason == "gap"
    cycles.add(5_000_000_000, 0.0)
    assert cycles.closed[-1].reason == "no joint samples"


def test_a_cycle_ends_after_the_maximum_time():
    t = clock(10.0)
    found = cycles(cut(t, 0.2 * t, max_time=3.0))
    assert [round(end - start) for start, end in found] == [3, 3, 3, 1]


def test_short_motions_are_joined_to_the_next_cycle_or_reported():
    legs = [np.linspace(0, 0.05, 10), np.linspace(0.05, -1, 100), np.linspace(-1, 0, 100)]
    angle = np.concatenate(legs)
    found = cycles(cut(np.arange(len(angle)) / RATE, angle))
    assert [round(end, 2) for _, end in found] == [1.09, 2.09]
    # Alone between rests it is no cycle.
    angle = np.concatenate([np.zeros(80), np.linspace(0, 0.05, 10), np.full(80, 0.05)])
    spans = cut(np.arange(len(angle)) / RATE, angle)
    assert "short tilt cycle" in [s.reason for s in spans]
    assert cycles(spans) == []


def test_amplitude_and_speed_may_change_between_cycles():
    t = clock(4.0)
    angle = np.concatenate([triangle(t, 1.0), triangle(t, 0.5, 0.2), triangle(t, 2.0, 1.0)])
    assert len(cycles(cut(np.arange(len(angle)) / RATE, angle))) == pytest.approx(14, abs=1)


def test_a_joint_that_rests_makes_no_cycles():
    t = clock(100.0)
    jitter = np.random.default_rng(0).normal(0, 0.001, len(t))
    spans = cut(t, 0.3 + jitter)
    assert cycles(spans) == []


def test_repeated_stamps_are_ignored():
    t = np.repeat(clock(2 * HALF), 3)
    assert len(cycles(cut(t, triangle(t)))) == 2


def test_cycle_numbers_continue_after_a_clear():
    cycles = TiltCycles(Config())
    for t in clock(2.0):
        cycles.add(round(t * 1e9), float(triangle(t, 1.0)))
    cycles.clear()
    for t in clock(2.5):
        cycles.add(round(t * 1e9), float(triangle(t, 1.0)))
    assert [s.cycle for s in cycles.closed if s.cycle is not None] == [1, 2]


@exactly
@given(
    st.lists(
        st.tuples(st.floats(-1, 1), st.sampled_from([1, 5, 30, 80]), st.integers(0, 60)),
        min_size=1,
        max_size=12,
    )
)
def test_spans_of_any_motion_follow_each_other_without_gaps(legs):
    # Legs of (goal, samples to get there, samples of rest): `cut` checks what must always hold.
    angle = [0.0]
    for goal, ramp, rest in legs:
        angle += list(np.linspace(angle[-1], goal, ramp + 1)[1:]) + [goal] * rest
    spans = cut(np.arange(len(angle)) / RATE, angle)
    assert spans[-1].end_ns == round((len(angle) - 1) / RATE * 1e9) + 1


def certain_after(times, angles, **settings):
    """Return how long after each turn it was known, s."""
    cycles, late = TiltCycles(Config.model_validate({"cycle": settings})), []
    for t, a in zip(times, angles, strict=True):
        cycles.add(round(t * 1e9), float(a))
        while cycles.closed:
            span = cycles.closed.popleft()
            if span.reason == "turn":
                late.append(t - span.end_ns * 1e-9)
    return np.array(late)


def test_a_reversal_at_a_known_end_is_detected_earlier():
    t = clock(8 * HALF)
    late = certain_after(t, -AMPLITUDE * np.cos(np.pi * t / HALF))
    # Back by the dead band of 10 mrad, or by a quarter of it, at a curvature of 2.08 rad/s2.
    assert late[:2] == pytest.approx(np.sqrt(2 * 0.010 / 2.08), abs=1.5 / RATE)
    assert late[2:] == pytest.approx(np.sqrt(2 * 0.0025 / 2.08), abs=1.5 / RATE)


@pytest.mark.parametrize("seed", range(5))
def test_a_joint_that_jitters_needs_the_whole_dead_band(seed):
    t = clock(20 * HALF)
    jitter = np.random.default_rng(seed).normal(0, 0.0015, len(t))
    found = cycles(cut(t, jitter - AMPLITUDE * np.cos(np.pi * t / HALF)))
    assert len(found) == 20
    # Within three sigma of jitter of the end: 66 ms at that curvature.
    assert [end for _, end in found[:-1]] == pytest.approx(HALF * np.arange(1, 20), abs=0.08)


@pytest.mark.parametrize("back", [0.004, 0.008])
def test_a_joint_that_moves_past_its_known_end_makes_no_extra_cycle(back):
    # Two cycles to and fro between -0.5 and 0.5, then one that steps back at 0.5 and goes on to 1.
    corners = [-0.5, 0.5, -0.5, 0.5, -0.5, 0.5, 0.5 - back, 1.0, -0.5, 0.5]
    legs = [
        np.linspace(a, b, max(round(abs(b - a) * 150), 3))[1:]
        for a, b in itertools.pairwise(corners)
    ]
    angle = np.concatenate([[corners[0]], *legs])
    times = np.arange(len(angle)) / RATE
    found = cycles(cut(times, angle))
    assert len(found) == 8
    ends = [angle[np.searchsorted(times, end - 1e-9)] for _, end in found[:-1]]
    assert ends[:5] == pytest.approx([0.5, -0.5, 0.5, -0.5, 0.5], abs=0.01)
    assert ends[-1] == pytest.approx(-0.5, abs=0.01)
