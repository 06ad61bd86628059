"""Which texts are the number of a room, and which plates are a door sign."""

import re
import unicodedata
from collections.abc import Sequence

NUMBER = re.compile(r"[A-Z]{0,2}[-.]?\d{1,5}([.-]\d{1,3})?[-.]?[A-Z]{0,3}")
"""A room's number: digits, with letters before or after them, or a second group of digits."""

LOOKALIKES = str.maketrans("OIL|", "0111")
"""Letters that are read for digits within a number."""


def normalised(text: str) -> str:
    """Return a text in one form: compatible characters, single spaces, no marks at its ends."""
    plain = " ".join(unicodedata.normalize("NFKC", text).split())
    return plain.strip(" .,:;-_'\"`|")


def room_number(text: str) -> str | None:
    """Return the number of a room that a line of text is or ends or begins with, None for none.

    A range of numbers, a time, a date or a price is none, and a single digit is one only where it
    stands alone: lists say "Meeting Room 3".

    Parameters
    ----------
    text
        A line, normalised.
    """
    words = text.upper().split()
    if not words:
        return None
    for word in dict.fromkeys((words[0], words[-1])):
        number = _as_number(word)
        if number is not None and (len(words) == 1 or sum(c.isdigit() for c in number) > 1):
            return number
    return None


def _as_number(word: str) -> str | None:
    """Return a word as a number of a room, None where it is none."""
    digits = sum(c.isdigit() for c in word)
    if digits > 1 and not NUMBER.fullmatch(word):
        word = word.translate(LOOKALIKES)
    if not NUMBER.fullmatch(word) or _is_range(word):
        return None
    return word


def _is_range(word: str) -> bool:
    """Return whether a word is two numbers, the second larger: "216-220"."""
    low, dash, high = word.partition("-")
    return bool(dash) and low.isdigit() and high.isdigit() and int(high) > int(low)


def is_list(heights: Sequence[float], own: int) -> bool:
    """Return whether lines are those of a list or notice, of which the number is only one.

    The number of a door sign is written larger than what else is on the plate.

    Parameters
    ----------
    heights
        Height of each line near the number, pixels.
    own
        Index of the number's line.
    """
    alike = [h for k, h in enumerate(heights) if k != own and h > 0.75 * heights[own]]
    return len(alike) >= 3
