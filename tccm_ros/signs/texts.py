"""Readings of one plate: how far two of them are from each other, and what most of them say."""

from __future__ import annotations

from collections.abc import Sequence


def edit_distance(a: str, b: str) -> int:
    """Return how many characters must be changed, added or left out to make one text the other.

    V. Levenshtein, 1966, "Binary codes capable of correcting deletions, insertions, and reversals".
    """
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        before, row[0] = row[0], i
        for j, y in enumerate(b, 1):
            before, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, before + (x != y))
    return row[len(b)]


def vote(readings: Sequence[tuple[str, float]]) -> tuple[str, float]:
    """Return the text with the largest sum of confidences, and how sure it is, 0 to 1.

    Of texts with equal sums, the one that was read first. A reading that says another text counts
    as one without confidence.

    Parameters
    ----------
    readings
        Texts with their confidences, 0 to 1; at least one.
    """
    sums: dict[str, float] = {}
    for text, confidence in readings:
        sums[text] = sums.get(text, 0.0) + confidence
    best = max(sums, key=lambda text: sums[text])
    return best, sums[best] / len(readings)
