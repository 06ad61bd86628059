from hypothesis import given
from hypothesis import strategies as st

from tccm_ros.signs.texts import edit_distance, vote

TEXTS = st.text("0123A", max_size=6)


def by_recursion(a, b):
    if not a or not b:
        return len(a) + len(b)
    if a[0] == b[0]:
        return by_recursion(a[1:], b[1:])
    return 1 + min(by_recursion(a[1:], b), by_recursion(a, b[1:]), by_recursion(a[1:], b[1:]))


@given(TEXTS, TEXTS)
def test_the_distance_is_the_number_of_edits(a, b):
    assert edit_distance(a, b) == by_recursion(a, b)


def test_text_of_a_plate_is_the_one_with_the_largest_confidence():
    assert vote([("205", 0.9), ("206", 0.8), ("205", 0.7)]) == ("205", (0.9 + 0.7) / 3)
    assert vote([("206", 0.5), ("205", 0.5)])[0] == "206"
