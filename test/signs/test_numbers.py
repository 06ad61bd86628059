"""Which texts are the number of a room."""

import pytest

from tccm_ros.signs.numbers import is_list, normalised, person_name, room_number


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("205", "205"),
        ("271B", "271B"),
        ("272b", "272B"),
        ("3103B", "3103B"),
        ("102CCB", "102CCB"),
        ("B12", "B12"),
        ("A-117", "A-117"),
        ("2.13", "2.13"),
        ("5", "5"),
        ("Room 205", "205"),
        ("205 Electrical Room", "205"),
        ("2O5", "205"),
        ("1I4", "114"),
        ("1-204", "1-204"),
        ("12-034B", "12-034B"),
        ("12\u2013034b", "12-034B"),
        ("C7-118", "C7-118"),
        ("00.12.019", "00.12.019"),
        ("MC-B1-294", "MC-B1-294"),
        ("3/118", "3/118"),
        ("BC 410", "BC 410"),
        ("C7 118 Store", "C7 118"),
        ("Nr. 12", "12"),
        ("House 3", "HOUSE 3"),
        ("Room5", "ROOM 5"),
        ("\u2192 118", "118"),
        ("\u4e2a118", "118"),
    ],
)
def test_numbers_of_rooms(text, number):
    assert room_number(normalised(text)) == number


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Offices 216-220",
        "Meeting Room 3",
        "10:30",
        "404.385.4452",
        "EXIT",
        "Robotics@GT",
        "12/05/2010",
        "123456789",
        "Meeting Rooms 1 & 2",
        "$250",
        "385-6452",
        "24/7",
        "CO2",
        "12/05",
    ],
)
def test_other_texts(text):
    assert room_number(normalised(text)) is None


def test_texts_have_one_form():
    assert normalised("  ２０５ \n Lab. ") == "205 Lab"
    assert normalised("'271B|") == "271B"


def test_a_list_is_no_plate():
    assert is_list([20, 21, 19, 20], 1)
    assert not is_list([40, 20, 19, 20, 22], 0)
    assert not is_list([20, 20, 20], 0)


@pytest.mark.parametrize("text", ["Dr. Ann Miller", "Prof. Dr. M\u00fcller", "Ms Lee", "Dr.Smith"])
def test_names_with_titles(text):
    assert person_name(normalised(text)) == text.upper()


@pytest.mark.parametrize("text", ["Drawing Room", "Electrical Room", "MS OFFICE", "Dr", "EXIT"])
def test_other_words_are_no_names(text):
    assert person_name(normalised(text)) is None
