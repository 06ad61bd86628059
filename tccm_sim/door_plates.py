"""Drawings of door plates: number, words, colours, bolts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from tccm_ros.arrays import UInt8
from tccm_sim.sign_pictures import Color, font

PLATE_PIXELS = 480
"""Width of a drawn plate, pixels. Chosen: 2.4 per mm for a plate of 20 cm."""

NOTICE_SIZE = 400, 160
"""Width and height of a notice, pixels; chosen."""


class Style(NamedTuple):
    """Appearance of the plates of a building.

    Attributes
    ----------
    face, ink
        Colours of the plate and of its text.
    band
        Colour of the band with the words.
    typeface
        One of `sign_pictures.FONTS`.
    aspect
        Height of the plate relative to its width.
    digits
        Height of the number relative to the plate's width.
    bolts
        Whether there are screws at the corners.
    """

    face: Color
    ink: Color
    band: Color
    typeface: str
    aspect: float
    digits: float
    bolts: bool


STYLES = (
    Style((28, 52, 92), (240, 240, 236), (28, 52, 92), "DejaVuSans-Bold", 0.72, 0.25, True),
    Style((232, 230, 222), (34, 34, 38), (150, 60, 52), "DejaVuSans", 0.85, 0.24, False),
    Style((176, 178, 180), (30, 30, 30), (176, 178, 180), "DejaVuSans-Bold", 0.6, 0.26, True),
    Style((74, 52, 40), (236, 222, 186), (74, 52, 40), "DejaVuSerif-Bold", 0.7, 0.25, True),
)
"""Styles of plates. Chosen to differ in colours, fonts, layout and bolts."""


class DoorPlate(NamedTuple):
    """A drawn plate.

    Attributes
    ----------
    pixels
        uint8 (h, w, 3).
    anchor
        Offset of the number's centre from the plate's, right and up, in widths of the plate.
    """

    pixels: UInt8
    anchor: tuple[float, float]


def door_plate(number: str, words: str, style: Style) -> DoorPlate:
    """Return a plate with a number, words below it, and screws in its corners.

    Parameters
    ----------
    number, words
        Text of the plate; words may be empty.
    style
        Its style.
    """
    width, height = PLATE_PIXELS, round(PLATE_PIXELS * style.aspect)
    plate = Image.new("RGB", (width, height), style.face)
    draw = ImageDraw.Draw(plate)
    split = round(0.64 * height)
    draw.rectangle((0, split, width, height), fill=style.band)
    letters = font(style.typeface, _size_of_digits(style))
    left, top, right, bottom = draw.textbbox((0, 0), number, font=letters)
    x, y = 0.5 * (width - left - right), 0.5 * (split - top - bottom)
    draw.text((x, y), number, fill=style.ink, font=letters)
    small = font(style.typeface, 0.075 * width)
    band_ink = style.ink if style.band == style.face else (244, 242, 238)
    extent = draw.textlength(words, font=small)
    draw.text((0.5 * (width - extent), split + 0.04 * width), words, fill=band_ink, font=small)
    draw.rectangle((0, 0, width - 1, height - 1), outline=_darker(style.face), width=4)
    if style.bolts:
        for u in (0.06, 0.94):
            for v in (0.06 * width, height - 0.06 * width):
                _draw_bolt(draw, u * width, v, 0.02 * width)
    pixels = np.asarray(plate).copy()
    return DoorPlate(pixels, (0.0, (0.5 * height - 0.5 * split) / width))


def _size_of_digits(style: Style) -> float:
    """Return the font size that gives the style's height of digits, pixels."""
    trial = 200
    _, top, _, bottom = font(style.typeface, trial).getbbox("0")
    return trial * style.digits * PLATE_PIXELS / (bottom - top)


def _draw_bolt(draw: ImageDraw.ImageDraw, x: float, y: float, radius: float) -> None:
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=(110, 110, 112))
    light = 0.5 * radius
    draw.ellipse((x - light - 1, y - light - 1, x + light - 2, y + light - 2), fill=(190, 190, 192))
    draw.line((x - light, y + light, x + light, y - light), fill=(60, 60, 60), width=2)


def _darker(color: Color) -> Color:
    return color[0] * 2 // 3, color[1] * 2 // 3, color[2] * 2 // 3


def notice(text: str, face: Color, ink: Color) -> UInt8:
    """Return a board with one line of text, such as an exit sign, an arrow or a date.

    Parameters
    ----------
    text
        The line.
    face, ink
        Colours of the board and its text.
    """
    board = Image.new("RGB", NOTICE_SIZE, face)
    draw = ImageDraw.Draw(board)
    letters = font("DejaVuSans-Bold", 0.5 * NOTICE_SIZE[1])
    scale = min(1.0, 0.86 * NOTICE_SIZE[0] / draw.textlength(text, font=letters))
    letters = letters.font_variant(size=int(letters.size * scale))
    left, top, right, bottom = draw.textbbox((0, 0), text, font=letters)
    place = 0.5 * (NOTICE_SIZE[0] - left - right), 0.5 * (NOTICE_SIZE[1] - top - bottom)
    draw.text(place, text, fill=ink, font=letters)
    return np.asarray(board).copy()
