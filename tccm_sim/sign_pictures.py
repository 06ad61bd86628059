"""Posters, directories and papers of the office, drawn with the fonts included in matplotlib.

The same seed gives the same picture on any machine.
"""

from __future__ import annotations

from pathlib import Path
from string import ascii_letters

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

Color = tuple[int, int, int]

Box = tuple[float, float, float, float]

FONTS = (
    "DejaVuSans",
    "DejaVuSans",
    "DejaVuSans-Bold",
    "DejaVuSansMono",
    "DejaVuSerif",
    "DejaVuSerif-Bold",
    "STIXGeneral",
    "STIXGeneralBol",
    "cmss10",
    "cmss10",
)
"""Fonts of texts; one listed twice is used twice as often."""


def font(name: str, size: float) -> ImageFont.FreeTypeFont:
    """Return a matplotlib font with a size in pixels."""
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{name}.ttf"
    return ImageFont.truetype(str(path), max(int(size), 4))


def random_words(rng: np.random.Generator, max_words: int) -> str:
    """Return one to `max_words` words of random letters with natural lengths."""
    words = []
    for _ in range(rng.integers(1, max_words + 1)):
        word = "".join(rng.choice(list(ascii_letters), rng.integers(2, 10))).lower()
        words.append(word.capitalize() if rng.random() < 0.6 else word)
    return " ".join(words)


def draw_lines(
    rng: np.random.Generator, draw: ImageDraw.ImageDraw, box: Box, ink: Color, max_lines: int
) -> None:
    """Write some lines of words into a box, from its top."""
    left, top, right, bottom = box
    size = rng.uniform(0.05, 0.12) * (right - left) + 6
    letters = font(str(rng.choice(FONTS)), size)
    y = top + rng.uniform(0.3, 1.2) * size
    for _ in range(rng.integers(0, max_lines + 1)):
        if y + 1.4 * size > bottom:
            return
        text = random_words(rng, 3)
        while len(text) > 3 and draw.textlength(text, font=letters) > right - left:
            text = text[:-1]
        draw.text((left, y), text, fill=ink, font=letters)
        y += rng.uniform(1.2, 1.8) * size


def random_color(rng: np.random.Generator) -> Color:
    """Return a random colour."""
    red, green, blue = rng.integers(0, 256, 3)
    return int(red), int(green), int(blue)


def contrasting_colors(rng: np.random.Generator) -> tuple[Color, Color]:
    """Return colours of a face and its text with the contrast of a plate."""
    weight = np.array([0.3, 0.59, 0.11])
    while True:
        base = rng.integers(0, 256, 2)
        spread = 70 if rng.random() < 0.4 else 12
        pair = np.clip(base[:, None] + rng.normal(0.0, spread, (2, 3)), 0, 255).astype(int)
        if abs(float((pair[0] - pair[1]) @ weight)) > 75.0:
            return tuple(map(int, pair[0])), tuple(map(int, pair[1]))  # type: ignore[return-value]


def poster(rng: np.random.Generator) -> Image.Image:
    """Return a poster with shapes and words."""
    width, height = 400, int(rng.uniform(400, 640))
    board = Image.new("RGB", (width, height), random_color(rng))
    draw = ImageDraw.Draw(board)
    for _ in range(rng.integers(2, 12)):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        a, b = rng.uniform(10, 160, 2)
        shape = draw.ellipse if rng.random() < 0.5 else draw.rectangle
        shape((x, y, x + a, y + b), fill=random_color(rng))
    for _ in range(rng.integers(1, 5)):
        y = rng.uniform(0, 0.8 * height)
        draw_lines(rng, draw, (20, y, width - 20, y + 200), random_color(rng), 4)
    letters = font(str(rng.choice(FONTS)), rng.uniform(30, 90))
    draw.text(
        (15, rng.uniform(0, 0.7 * height)), random_words(rng, 2), random_color(rng), font=letters
    )
    return board


def directory(rng: np.random.Generator) -> Image.Image:
    """Return a directory of the rooms of a floor."""
    width, height = 400, int(rng.uniform(400, 640))
    face, ink = contrasting_colors(rng)
    board = Image.new("RGB", (width, height), face)
    draw = ImageDraw.Draw(board)
    letters = font(str(rng.choice(FONTS)), rng.uniform(24, 44))
    for y in np.arange(30, height - 60, letters.size * rng.uniform(1.3, 2.0)):
        low = int(rng.integers(1, 400))
        text = f"{random_words(rng, 2)} {low}-{low + int(rng.integers(2, 30))}"
        draw.text((25, y), text, fill=ink, font=letters)
    return board


def paper(rng: np.random.Generator) -> Image.Image:
    """Return a sheet of paper with lines of words."""
    gray = int(rng.integers(190, 256))
    board = Image.new("RGB", (300, 400), (gray, gray, gray))
    for y in (20, 120, 220, 320):
        draw_lines(rng, ImageDraw.Draw(board), (20, y, 280, y + 120), (40, 40, 40), 6)
    return board
