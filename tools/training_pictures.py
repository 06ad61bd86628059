"""Rendered pictures of door signs, and of other objects: the classifier of signs learns from them.

A picture is a wall (paint, wood, brick, glass) with objects on it, seen under perspective, with
uneven light, blur, noise and JPEG compression. Plates vary in size, colours, fonts and layout;
beside them hang posters, papers, directories, switches, extinguishers and other objects.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from string import ascii_uppercase, digits

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from tccm_ros.arrays import Float64, UInt8
from tccm_sim.sign_pictures import (
    FONTS,
    Box,
    Color,
    contrasting_colors,
    directory,
    draw_lines,
    font,
    paper,
    poster,
    random_color,
)

PICTURE_SIZE = (960, 720)  # pixels

PLATE_WIDTH = 400  # pixels, at which a plate is drawn before it is seen

PLATE_WIDTHS = (45.0, 300.0)
"""Width of a plate in a picture, pixels: as many are half as wide as another as are twice as wide.
Digits of the smallest are some ten pixels high."""

JPEG_QUALITY = (50, 96)
"""Quality of the compression that a camera applies."""


@dataclass(frozen=True)
class Plate:
    """A drawn door sign.

    Attributes
    ----------
    pixels
        The plate, seen from the front.
    number
        Its number.
    box
        Left, top, right and bottom of the number, pixels of the plate.
    """

    pixels: Image.Image
    number: str
    box: Box


@dataclass(frozen=True)
class SignPicture:
    """A rendered picture and the numbers in it.

    Attributes
    ----------
    pixels
        uint8 (H, W, 3), red, green, blue.
    numbers
        Number of each door sign.
    corners
        float64 (N, 4, 2), corners of each number: top left, top right, bottom right, bottom left.
    """

    pixels: UInt8
    numbers: tuple[str, ...]
    corners: Float64


def random_number(rng: np.random.Generator) -> str:
    """Return the number of a room: one to four digits, sometimes with letters or a point."""
    n = int(rng.choice([1, 2, 3, 4], p=[0.05, 0.15, 0.5, 0.3]))
    text = str(rng.integers(1, 10)) + "".join(rng.choice(list(digits), n - 1))
    style = rng.random()
    if style < 0.2:
        text += "".join(rng.choice(list(ascii_uppercase), rng.choice([1, 1, 1, 3])))
    elif style < 0.3:
        text = str(rng.choice(list(ascii_uppercase))) + text
    elif style < 0.35 and n > 2:
        text = f"{text[0]}.{text[1:]}"
    return text


def random_plate(rng: np.random.Generator, number: str) -> Plate:
    """Return a door sign of a random style with a number.

    Parameters
    ----------
    rng
        Where the style comes from.
    number
        Its number.
    """
    width = PLATE_WIDTH
    height = int(width * rng.uniform(0.35, 1.5))
    face, ink = contrasting_colors(rng)
    pixels = Image.new("RGB", (width, height), face)
    draw = ImageDraw.Draw(pixels)
    band = rng.uniform(0.35, 0.65) * height if height > 0.6 * width else float(height)
    lower_ink = ink
    if band < height and rng.random() < 0.6:
        lower, lower_ink = contrasting_colors(rng)
        draw.rectangle((0, band, width, height), fill=lower)
    if band < height and rng.random() < 0.4:
        draw.rectangle((0, band - 4, width, band + 8), fill=random_color(rng))
    box = _draw_number(rng, draw, number, (width, band), ink)
    if band < height:
        draw_lines(rng, draw, (0.06 * width, band, 0.94 * width, height), lower_ink, 3)
    if rng.random() < 0.25:  # a logo beside the number
        x = width - rng.uniform(0.1, 0.16) * width
        if box[2] < x - 0.05 * width:
            draw.ellipse((x, 0.3 * band, x + 30, 0.8 * band), fill=random_color(rng))
    if rng.random() < 0.4:
        draw.rectangle(
            (0, 0, width - 1, height - 1),
            outline=random_color(rng),
            width=int(rng.integers(3, 16)),
        )
    return Plate(pixels, number, box)


def _draw_number(
    rng: np.random.Generator,
    draw: ImageDraw.ImageDraw,
    number: str,
    area: tuple[float, float],
    ink: Color,
) -> Box:
    width, height = area
    letters = font(str(rng.choice(FONTS)), rng.uniform(0.35, 0.75) * min(height, 0.55 * width))
    left, top, right, bottom = draw.textbbox((0, 0), number, font=letters)
    scale = min(1.0, 0.86 * width / (right - left))
    if scale < 1.0:
        letters = letters.font_variant(size=int(letters.size * scale))
        left, top, right, bottom = draw.textbbox((0, 0), number, font=letters)
    align = rng.choice([0.06, 0.5, 0.94], p=[0.4, 0.5, 0.1])
    x = align * (width - (right - left)) - left
    y = rng.uniform(0.3, 0.7) * (height - (bottom - top)) - top
    draw.text((x, y), number, fill=ink, font=letters)
    return (x + left, y + top, x + right, y + bottom)


def _random_object(rng: np.random.Generator) -> Image.Image:
    """Return an object that hangs on a wall and is no door sign."""
    kinds = (poster, directory, _switch, _extinguisher, paper, _shelf, _name_plate, _clutter)
    return kinds[int(rng.integers(len(kinds)))](rng)


def _switch(rng: np.random.Generator) -> Image.Image:
    gray = int(rng.integers(60, 250))
    board = Image.new("RGB", (200, int(rng.uniform(120, 320))), (gray, gray, gray - 5))
    draw = ImageDraw.Draw(board)
    for k in range(rng.integers(1, 4)):
        x = 20 + 60 * k
        shade = int(gray * rng.uniform(0.5, 1.0))
        draw.rectangle(
            (x, 30, x + 45, board.height - 30), fill=(shade,) * 3, outline=(gray // 3,) * 3, width=3
        )
    return board


def _extinguisher(rng: np.random.Generator) -> Image.Image:
    board = Image.new("RGB", (160, 420), (200, 200, 195))
    draw = ImageDraw.Draw(board)
    draw.rounded_rectangle((30, 90, 130, 410), 40, fill=(int(rng.integers(150, 220)), 20, 25))
    draw.rectangle((60, 40, 100, 95), fill=(30, 30, 30))
    draw.rectangle((40, 180, 120, 280), fill=(230, 230, 220))
    draw_lines(rng, draw, (45, 180, 118, 280), (30, 30, 30), 4)
    return board


def _shelf(rng: np.random.Generator) -> Image.Image:
    board = Image.new("RGB", (500, 360), random_color(rng))
    draw = ImageDraw.Draw(board)
    for row in range(3):
        x = 10.0
        while x < 470:
            w = rng.uniform(8, 30)
            top = 120 * row + rng.uniform(5, 40)
            draw.rectangle((x, top, x + w, 120 * row + 115), fill=random_color(rng))
            x += w + rng.uniform(0, 8)
    return board


def _name_plate(rng: np.random.Generator) -> Image.Image:
    """Return a plate with words and no number."""
    face, ink = contrasting_colors(rng)
    board = Image.new("RGB", (400, int(rng.uniform(90, 260))), face)
    draw_lines(rng, ImageDraw.Draw(board), (20, 0, 380, board.height), ink, 4)
    return board


def _clutter(rng: np.random.Generator) -> Image.Image:
    """Return handles, lamps, cables and squares as of a marker: shapes without letters."""
    board = Image.new("RGB", (300, 300), random_color(rng))
    draw = ImageDraw.Draw(board)
    if rng.random() < 0.3:
        cells = rng.integers(0, 2, (6, 6)) * 255
        marker = Image.fromarray(cells.astype(np.uint8)).resize(
            (260, 260), Image.Resampling.NEAREST
        )
        board.paste(marker.convert("RGB"), (20, 20))
        return board
    for _ in range(rng.integers(3, 15)):
        x, y, a, b = rng.uniform(0, 260, 4)
        color, kind = random_color(rng), rng.random()
        if kind < 0.4:
            draw.line((x, y, a, b), fill=color, width=int(rng.integers(2, 20)))
        elif kind < 0.7:
            draw.ellipse((x, y, x + 0.4 * a, y + 0.4 * b), fill=color)
        else:
            draw.arc((x, y, x + a, y + b), 0, 300, fill=color, width=int(rng.integers(2, 14)))
    return board


def _wall(rng: np.random.Generator) -> Image.Image:
    """Return a wall without anything on it: paint, wood, brick or glass."""
    width, height = PICTURE_SIZE
    base = np.array(random_color(rng), float) * 0.5 + rng.uniform(20, 130)
    kind = rng.random()
    if kind < 0.5:  # paint, plaster, fabric
        grain = rng.normal(0.0, rng.uniform(0.0, 9.0), (height, width, 1))
        wall = base + grain
    elif kind < 0.65:  # wood
        rows = rng.normal(0.0, 1.0, (1, width, 1)).cumsum(axis=1)
        wall = base + rng.uniform(1.0, 5.0) * np.sin(rows) * 3 + np.zeros((height, width, 3))
    elif kind < 0.75:  # brick
        y, x = np.mgrid[0:height, 0:width]
        row = y // 40
        joint = (y % 40 < 4) | ((x + 50 * (row % 2)) % 100 < 4)
        wall = base - 50.0 * joint[:, :, None]
    else:  # glass, with what is behind it out of focus
        coarse = rng.uniform(0, 255, (int(rng.integers(4, 12)), int(rng.integers(4, 16)), 3))
        blurred = Image.fromarray(coarse.astype(np.uint8)).resize(
            PICTURE_SIZE, Image.Resampling.BICUBIC
        )
        wall = np.asarray(blurred, float)
    picture = Image.fromarray(
        np.clip(np.broadcast_to(wall, (height, width, 3)), 0, 255).astype(np.uint8)
    )
    if rng.random() < 0.7:  # a door and its frame
        x = rng.uniform(0, width)
        draw = ImageDraw.Draw(picture)
        draw.rectangle((x, 0, x + rng.uniform(150, 500), height), fill=random_color(rng))
        draw.rectangle((x, 0, x + rng.uniform(10, 50), height), fill=random_color(rng))
    return picture


def _paste_seen(
    rng: np.random.Generator,
    picture: Image.Image,
    board: Image.Image,
    width: float,
    center: tuple[float, float],
) -> Float64:
    """Draw an object into a picture in perspective; return the homography object -> picture."""
    w, h = board.size
    height = width * h / w
    squeeze = np.cos(np.radians(rng.uniform(0.0, 60.0))) if rng.random() < 0.5 else 1.0
    taper = rng.uniform(-0.15, 0.15) * (1.0 if squeeze == 1.0 else 2.0)
    slope = rng.uniform(-0.12, 0.12)
    x, y = 0.5 * width * squeeze, 0.5 * height
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    corners[[0, 3], 1] *= 1.0 + taper
    corners[[1, 2], 1] *= 1.0 - taper
    corners[:, 1] += slope * corners[:, 0]
    corners += center
    own = np.array([[0, 0], [w, 0], [w, h], [0, h]], float)
    to_picture, to_object = homography(own, corners), homography(corners, own)
    coefficients = (to_object / to_object[2, 2]).ravel()[:8]
    seen = board.transform(
        picture.size, Image.Transform.PERSPECTIVE, tuple(coefficients), Image.Resampling.BICUBIC
    )
    mask = Image.new("L", picture.size, 0)
    ImageDraw.Draw(mask).polygon([tuple(c) for c in corners], fill=255)
    if rng.random() < 0.5:  # the shadow below its edges
        shadow = mask.filter(ImageFilter.BoxBlur(4)).point(lambda v: int(0.4 * v))
        picture.paste((0, 0, 0), (2, 4), shadow)
    picture.paste(seen, (0, 0), mask)
    return to_picture


def homography(source: Float64, target: Float64) -> Float64:
    """Return the homography (3, 3) that maps four points onto four others.

    Parameters
    ----------
    source, target
        float64 (4, 2).
    """
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y])
    return np.append(np.linalg.solve(np.array(rows), target.ravel()), 1.0).reshape(3, 3)


def map_points(h: Float64, points: Float64) -> Float64:
    """Return points (N, 2) mapped by a homography (3, 3)."""
    mapped = points @ h[:, :2].T + h[:, 2]
    out: Float64 = mapped[:, :2] / mapped[:, 2:]
    return out


def random_picture(rng: np.random.Generator, signs: int) -> SignPicture:
    """Return a rendered picture with door signs and other objects.

    Parameters
    ----------
    rng
        Where all of it comes from.
    signs
        Number of door signs.
    """
    picture = _wall(rng)
    width, height = PICTURE_SIZE
    for _ in range(rng.integers(0, 6)):
        center = (rng.uniform(0, width), rng.uniform(0, height))
        _paste_seen(rng, picture, _random_object(rng), rng.uniform(50, 400), center)
    numbers, corners = [], []
    for k in range(signs):
        plate = random_plate(rng, random_number(rng))
        column = (k + rng.uniform(0.2, 0.8)) * width / signs
        center = (column, rng.uniform(0.2, 0.8) * height)
        h = _paste_seen(rng, picture, plate.pixels, _log_uniform(rng, *PLATE_WIDTHS), center)
        left, top, right, bottom = plate.box
        own = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        numbers.append(plate.number)
        corners.append(map_points(h, own))
    return SignPicture(
        _photographed(rng, picture), tuple(numbers), np.array(corners).reshape(-1, 4, 2)
    )


def _photographed(rng: np.random.Generator, picture: Image.Image) -> UInt8:
    """Return a picture with uneven light, blur of focus and motion, and noise."""
    if rng.random() < 0.6:
        picture = picture.filter(ImageFilter.GaussianBlur(float(rng.uniform(0.3, 1.6))))
    pixels = np.asarray(picture, np.float32)
    if rng.random() < 0.25:  # motion along a row
        length = int(rng.integers(2, 6))
        pixels = np.mean([np.roll(pixels, k, axis=1) for k in range(length)], axis=0)
    x = np.linspace(-1.0, 1.0, pixels.shape[1], dtype=np.float32)[None, :, None]
    y = np.linspace(-1.0, 1.0, pixels.shape[0], dtype=np.float32)[:, None, None]
    light = rng.uniform(0.45, 1.15) * (
        1.0 + rng.uniform(-0.3, 0.3) * x + rng.uniform(-0.3, 0.3) * y
    )
    noise = rng.normal(0.0, rng.uniform(0.5, 6.0), pixels.shape).astype(np.float32)
    seen: UInt8 = np.clip(pixels * light + noise, 0, 255).astype(np.uint8)
    return _compressed(seen, int(rng.integers(*JPEG_QUALITY)))


def _compressed(pixels: UInt8, quality: int) -> UInt8:
    """Return a picture after JPEG compression."""
    file = BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniformly distributed."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
