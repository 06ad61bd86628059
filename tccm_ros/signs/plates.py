"""Group lines of text into plates, and decide which plates are door signs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.signs.measurement import DetectedSign
from tccm_ros.signs.numbers import has_digits, is_doubtful, joined_number
from tccm_ros.signs.reading import TextLine, bounding_corners

ALIKE = 0.75
"""Minimum height ratio of a line to another to count as equally high. Chosen: capital and small
letters of one type size differ by less."""

LIST_DISTANCE = (1.0, 6.0)
"""Maximum distance beside, and above or below a line of other rows of its list or notice, in line
heights. Chosen: three rows; no poster beside a plate."""

NUMBERS_DISTANCE = 6.0
"""Maximum distance between numbers of equal height in one list or dial, in line heights. Chosen:
the numbers of a clock are closer; those of two doors are not, at readable viewing angles."""

NOTICE_LINES = 5
"""Number of other lines within `LIST_DISTANCE`, as high or higher, that makes a notice. Chosen: a
number and four names of one size are a plate."""

LIST_NUMBERS = 2
"""Number of other lines with digits or names within `LIST_DISTANCE` that makes a list. Chosen: two
lines are a number."""

PLATE_DISTANCE = (1.5, 2.5)
"""Maximum distance beside, and above or below a number of other lines of its plate, in line
heights. Chosen: plates have margins, and gaps between their parts."""

PART_DISTANCE = (1.0, 1.2)
"""Maximum distance beside, and above or below each other of lines that form one number, in line
heights. Chosen: one and a half lines."""

MIN_CONFIDENCE = 0.8
"""Minimum mean probability of the characters of a number. Chosen."""

DIGIT_CONFIDENCE = 0.95
"""Minimum probability of a number of one digit: many dark spots look like one. Chosen."""

OTHER_CONFIDENCE = 0.6
"""Minimum mean probability of the characters of the other lines of a plate. Chosen."""


class ReadLine(NamedTuple):
    """A line of text that was read.

    Attributes
    ----------
    line
        Position in the picture.
    text
        Text in canonical form (`normalised`).
    confidence
        Mean probability of its characters, 0 to 1.
    number
        Room number in the text, or name of a person; None for none.
    """

    line: TextLine
    text: str
    confidence: float
    number: str | None


class Plate(NamedTuple):
    """The lines of text of one plate.

    Attributes
    ----------
    parts
        Lines that form the number, from top to bottom; the highest line is among them.
    others
        Other lines of the plate.
    """

    parts: tuple[ReadLine, ...]
    others: tuple[ReadLine, ...]

    @property
    def number(self) -> str:
        """The room number; a word that belongs to a single digit is part of it."""
        return joined_number([part.number or part.text.upper() for part in self.parts])

    def sign(self) -> DetectedSign:
        """Return the plate as a door sign."""
        lines = _in_order([*self.parts, *self.others])
        corners = bounding_corners([part.line for part in self.parts])
        low, high = corners.min(axis=0), corners.max(axis=0)
        return DetectedSign(
            " ".join(r.text for r in lines if r.confidence >= OTHER_CONFIDENCE),
            self.number,
            corners.mean(axis=0),
            np.append(low, high - low),
            float(np.mean([part.confidence for part in self.parts])),
            corners,
            bounding_corners([r.line for r in (*self.parts, *self.others)]),
        )


def plate_of(own: ReadLine, lines: Sequence[ReadLine]) -> Plate:
    """Return the plate around a line with a number.

    Parameters
    ----------
    own
        The highest line of the plate that has a number.
    lines
        All lines that were read.
    """
    parts = [own]
    for other in near(own, lines, PART_DISTANCE):
        is_word = is_doubtful(own.number or "") and other.text.isalpha()
        is_part = has_digits(other.number or "") and has_digits(own.number or "")
        if _is_as_high(other.line, own.line) and (is_part or is_word):
            parts.append(other)
    others = [r for r in near(own, lines, PLATE_DISTANCE) if r not in parts]
    return Plate(tuple(_in_order(parts)), tuple(others))


def refusal(plate: Plate, lines: Sequence[ReadLine], notices: Sequence[TextLine]) -> str:
    """Return the reason why a plate is no door sign; empty if it is one.

    Parameters
    ----------
    plate
        A plate with a number.
    lines
        All lines that were read.
    notices
        Lines of notices, from `lines_of_notices`.
    """
    own = max(plate.parts, key=lambda part: bool(part.number) * part.line.height)
    confidence = min(part.confidence for part in plate.parts)
    if is_doubtful(plate.number) and confidence < DIGIT_CONFIDENCE:
        return f"a single digit, read with {confidence:.2f}"
    entries = [r.line for r in lines if r is not own and (has_digits(r.text) or r.number)]
    entries += [line.lengthwise for line in notices]
    if sum(_is_row(own.line, entry) for entry in entries) >= LIST_NUMBERS:
        return "a row of a list"
    if len(_numbers_around(own, lines)) > LIST_NUMBERS:
        return "one of many numbers"
    return ""


def _numbers_around(own: ReadLine, lines: Sequence[ReadLine]) -> list[ReadLine]:
    """Return a number and the chain of single numbers of its height around it."""
    found = [own]
    for one in found:
        found += [
            other
            for other in lines
            if not any(other is r for r in found)
            and other.text.upper() == other.number
            and 0.5 < other.line.height / one.line.height < 2.0  # some lines of one digit are cut
            and max(_gap(one.line, other.line)) <= NUMBERS_DISTANCE * one.line.height
        ]
    return found


def lines_of_notices(lines: Sequence[TextLine]) -> list[TextLine]:
    """Return the lines of notices: lines with many equally high neighbours, and rows near them."""
    along = [line.lengthwise for line in lines]
    rows = [[o for o in along if o is not own and _is_row(own, o)] for own in along]
    found = [own for own, near in zip(along, rows) if len(near) >= NOTICE_LINES]
    return [
        line
        for line, own, near in zip(lines, along, rows)
        if own in found or sum(row in found and _is_row(row, own) for row in near) >= LIST_NUMBERS
    ]


def _is_row(own: TextLine, other: TextLine) -> bool:
    """Return whether another line may be a row of the same list: near, and as high."""
    return _is_as_high(other, own) and _is_near(own, other, LIST_DISTANCE)


def near(own: ReadLine, lines: Sequence[ReadLine], distance: tuple[float, float]) -> list[ReadLine]:
    """Return other lines within a distance beside, and above or below a line, in its heights."""
    return [r for r in lines if r is not own and _is_near(own.line, r.line, distance)]


def _is_as_high(line: TextLine, own: TextLine) -> bool:
    return line.height > ALIKE * own.height


def _is_near(own: TextLine, other: TextLine, distance: tuple[float, float]) -> bool:
    """Return whether a line is within a distance along and across another, in line heights."""
    gap = _gap(own, other)
    return bool((gap <= np.array(distance) * own.height).all()) and min(gap) <= 0.0


def _gap(own: TextLine, other: TextLine) -> Float64:
    """Return the gaps along and across a line to another, (2,) pixels; negative if they overlap."""
    inside, outside = own.corners @ own.axes.T, other.corners @ own.axes.T
    below = inside.min(axis=0) - outside.max(axis=0)
    return np.maximum(outside.min(axis=0) - inside.max(axis=0), below)


def _in_order(lines: Sequence[ReadLine]) -> list[ReadLine]:
    """Return lines in reading order: from top to bottom, and from left to right within a row."""
    along, down = lines[0].line.axes
    rest = sorted(lines, key=lambda r: float(r.line.center @ down))
    ordered: list[ReadLine] = []
    while rest:
        first = rest[0].line
        row = [r for r in rest if abs((r.line.center - first.center) @ down) < 0.5 * first.height]
        ordered += sorted(row, key=lambda r: float(r.line.center @ along))
        rest = [r for r in rest if not any(r is own for own in row)]
    return ordered
