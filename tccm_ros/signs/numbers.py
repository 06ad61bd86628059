"""Tell room numbers and rows of lists from other texts."""

import re
import unicodedata
from collections.abc import Sequence

GROUP = r"(?:[A-Z]{0,3}\d{1,5}[A-Z]{0,3}|[A-Z]{1,3})"
NUMBER = re.compile(rf"(?=.*\d){GROUP}(?:[-./]{GROUP}){{0,3}}")
"""A room number: up to four groups of digits with letters before or after them (12-034B, C7-118,
00.12.019), at least one of them with digits."""

CODE = re.compile(r"[A-Z]{1,3}|[A-Z]{0,3}\d{1,5}[A-Z]{0,3}")
"""A word that is part of an adjacent number: a wing, a floor, a building (BC 410, C7 118)."""

NAME = re.compile(r"(?:(?:Prof|Dr|Mr|Mrs|Ms)\.? ?){1,3}(?:[A-Z][\w'-]*\.? ?){1,4}")
"""A person's name with a title; names without a title look like any heading."""

SUBSTANCES = frozenset({"CO2", "H2O"})
"""Words on fire extinguishers and taps, which hang beside doors."""

GENERIC = frozenset({"NO", "NR", "RM"})
"""Short words beside a number that are the same on all doors."""

PHONE_OR_DATE = re.compile(r"(?:\d+[-./ ])?\d{3}[-./ ]\d{4}|\d+[-./]\d+[-./]\d{4,}")
FRACTION = re.compile(r"\d{1,2}/\d{1,2}")
"""A ratio or a day: 24/7, 1/2, 12/05."""

GLUED = re.compile(
    r"(?<=[A-Za-z]{4})(?=\d{1,2}$)|(?<=[A-Za-z][a-z]{2})(?=\d{1,2}$)|(?<=[^\W\da-zA-Z])(?=\d)"
)
"""Position between a word and its number where OCR has lost the space: Room3, and after non-Latin
letters, which OCR may have made of an arrow."""

LOOKALIKES = str.maketrans("OIL|", "0111")
"""Letters that OCR confuses with digits within a number."""

DASHES = str.maketrans(dict.fromkeys("\u2010\u2011\u2012\u2013\u2014\u2015\u2212", "-"))

ENDS = " .,:;-_'\"`|<>=~*\u2022\u00b7\u2190\u2191\u2192\u2193\u2196\u2197\u2198\u2199\u25b6\u25c0"
"""Characters to strip from the ends of a text: arrows and punctuation."""


def normalised(text: str) -> str:
    """Return a text in canonical form: NFKC, single spaces, no punctuation at the ends."""
    plain = unicodedata.normalize("NFKC", text).translate(DASHES).strip()
    return " ".join(GLUED.sub(" ", plain).split()).strip(ENDS)


def room_number(text: str) -> str | None:
    """Return the room number that is, begins or ends a line of text; None for none.

    Adjacent short codes belong to the number. Ranges of numbers, times, dates, prices and telephone
    numbers are no room numbers. A single digit is one where it stands alone; after a single word,
    the word belongs to it: lists say "Meeting Room 3".

    Parameters
    ----------
    text
        A line, normalised.
    """
    words = text.upper().split()
    if not words or PHONE_OR_DATE.fullmatch(" ".join(words)):
        return None
    for k in dict.fromkeys((0, len(words) - 1)):
        number = _as_number(words[k])
        if number is None:
            continue
        whole = _with_codes(words, k, number)
        if _digits(whole) > 1 or len(whole.split()) == len(words):
            return whole
        if k == 1 and words[0].isalpha():
            return f"{words[0]} {number}"
    return None


def person_name(text: str) -> str | None:
    """Return a line of text in capitals if it is a name with a title; None otherwise."""
    return text.upper() if NAME.fullmatch(text) else None


def has_digits(text: str) -> bool:
    """Return whether a text contains a digit."""
    return any(map(str.isdigit, text))


def is_doubtful(number: str) -> bool:
    """Return whether a number has one digit only, as many false readings have."""
    return _digits(number) == 1


def joined_number(parts: Sequence[str]) -> str:
    """Return the number that lines of a plate form together, from top to bottom."""
    return " ".join(dict.fromkeys(parts))


def _with_codes(words: Sequence[str], k: int, number: str) -> str:
    """Return word `k` of a line, a number, joined with the codes before and after it."""
    first = last = k
    while first > 0 and _is_code(words[first - 1]):
        first -= 1
    while last + 1 < len(words) and _is_code(words[last + 1]):
        last += 1
    return " ".join([*words[first:k], number, *words[k + 1 : last + 1]])


def _is_code(word: str) -> bool:
    return bool(CODE.fullmatch(word)) and word not in GENERIC


def _digits(text: str) -> int:
    return sum(c.isdigit() for c in text)


def _as_number(word: str) -> str | None:
    """Return a room number, or None if the word is not one."""
    if _digits(word) > 1 and not NUMBER.fullmatch(word):
        word = word.translate(LOOKALIKES)
    if not NUMBER.fullmatch(word) or PHONE_OR_DATE.fullmatch(word) or FRACTION.fullmatch(word):
        return None
    return None if _is_range(word) or word in SUBSTANCES else word


def _is_range(word: str) -> bool:
    """Return whether a word is a range of two numbers of equal length: "216-220"."""
    low, dash, high = word.partition("-")
    is_pair = bool(dash) and low.isdigit() and high.isdigit() and len(low) == len(high)
    return is_pair and int(high) > int(low)


def is_list(heights: Sequence[float], own: int) -> bool:
    """Return whether the number is one row of a list or notice.

    On a door sign, the number is larger than the other text of the plate.

    Parameters
    ----------
    heights
        Height of each line near the number, pixels.
    own
        Index of the number's line.
    """
    return sum(h > 0.75 * heights[own] for k, h in enumerate(heights) if k != own) >= 3
