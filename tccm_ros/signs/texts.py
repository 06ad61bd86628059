"""Edit distance and majority vote of the readings of one plate."""

from __future__ import annotations

from collections.abc import Sequence


def edit_distance(a: str, b: str) -> int:
    """Return the Levenshtein distance: characters to change, insert or delete between two texts.

    V. Levenshtein, 1966, "Binary codes capable of correcting deletions, insertions, and reversals".
    """
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        before, row[0] = row[0], i
        for j, y in enumerate(b, 1):
            before, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, before + (x != y))
    return row[len(b)]


def vote(readings: Sequence[tuple[str, float]]) -> tuple[str, float]:
    """Return the text with the largest sum of confidences, and its mean confidence, 0 to 1.

    Of texts with equal sums, the first reading wins. A reading of another text counts as confidence
    0.

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
