"""Words of a query, without the libraries of the other queries."""

from __future__ import annotations

import re


def word_parts(text: str) -> list[str]:
    """Return the alphanumeric parts of a text in lower case: C7-118 is found as C7 118."""
    return re.findall(r"[^\W_]+", text.casefold())
