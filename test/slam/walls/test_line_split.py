"""Split and merge, held against a recursion over NumPy arrays."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tccm_ros.slam.walls.line_split import split_segments

MERGE_TOLERANCE = 1.5  # times the distance of a point from the chord
MIN_MERGE_COSINE = 0.996  # of 5 deg between merged pieces

DISTANCE, MAX_GAP, MIN_POINTS = 0.05, 0.4, 5


def off_chord(points, a, b):
    """Distances of the points between a and b from their chord; from a where it has no length."""
    chord = points[b] - points[a]
    offset = points[a + 1 : b] - points[a]
    length = np.hypot(*chord)
    if length <= 1e-6:
        return np.hypot(*offset.T)
    return np.abs(offset @ [-chord[1], chord[0]]) / length


def pieces_of(points, a, b):
    """Straight pieces (first, last) from a to b."""
    off = off_chord(points, a, b)
    if b - a < 2 or off.max() <= DISTANCE:
        return [(a, b)]
    middle = a + 1 + int(np.argmax(off))
    return pieces_of(points, a, middle) + pieces_of(points, middle, b)


def merged(points, pieces):
    kept = pieces[:1]
    for a, b in pieces[1:]:
        start = kept[-1][0]
        u, v = points[a] - points[start], points[b] - points[a]
        is_straight = u @ v >= MIN_MERGE_COSINE * np.hypot(*u) * np.hypot(*v)
        if (
            is_straight
            and off_chord(points, start, b).max(initial=0.0) <= MERGE_TOLERANCE * DISTANCE
        ):
            kept[-1] = (start, b)
        else:
            kept.append((a, b))
    return kept


def labels_by_hand(beams):
    n = len(beams)
    gaps = np.hypot(*(beams - np.roll(beams, 1, axis=0)).T) > MAX_GAP  # before each point
    if gaps[0]:
        first = 0
    elif gaps.any():
        first = int(np.flatnonzero(gaps)[0])
    else:
        first = int(np.argmax(np.hypot(*beams.T)))
    points = np.roll(beams, -first, axis=0)
    starts = np.flatnonzero(np.r_[True, np.roll(gaps, -first)[1:]])
    labels, label = np.full(n, -1), 0
    for start, end in zip(starts, np.r_[starts[1:], n] - 1):
        for a, b in merged(points, pieces_of(points, start, end)):
            if b - a + 1 >= MIN_POINTS:
                labels[a : b + 1] = label
                label += 1
    return np.roll(labels, first)


@pytest.mark.parametrize("is_closed", [False, True])
@given(st.integers(0, 2**32 - 1))
@example(1)
def test_labels_are_those_of_a_recursion(is_closed, seed):
    """Polygons around the laser, with noise; open ones have gaps."""
    rng = np.random.default_rng(seed)
    corners = np.sort(rng.uniform(-np.pi, np.pi, 7))
    ring = rng.uniform(1.0, 2.5, 7)[:, None] * np.column_stack([np.cos(corners), np.sin(corners)])
    sides = list(zip(ring, np.roll(ring, -1, axis=0)))
    beams = np.concatenate([a + np.arange(0.0, 1.0, 0.05 / np.hypot(*(b - a)))[:, None] * (b - a)
                            for a, b in sides])  # fmt: skip
    beams += rng.normal(0.0, 0.012, beams.shape)
    if not is_closed:
        keep = np.ones(len(beams), bool)
        for at in rng.integers(0, len(beams), 3):
            keep[at : at + rng.integers(5, 25)] = False
        beams = beams[keep]
    found = split_segments(beams, DISTANCE, MAX_GAP, MIN_POINTS)
    assert found.tolist() == labels_by_hand(beams).tolist()
    assert found.max() >= 2
