"""Pictures of lists of rooms."""

import numpy as np
from PIL import Image, ImageDraw

from tccm_sim.sign_pictures import font


def directory(seed, size):
    """Return a picture of a list of rooms: names, and a column of numbers of `size` pixels."""
    rng = np.random.default_rng(seed)
    picture = Image.new("RGB", (640, 480), (150, 145, 135))
    draw, letters = ImageDraw.Draw(picture), font("DejaVuSerif", size)
    step = 1.7 * size
    draw.rectangle((60, 30, 330, 50 + int(8 * step)), fill=(215, 215, 210))
    for y in 40 + step * np.arange(8):
        name = "".join(rng.choice(list("abcdefghiknorstu"), rng.integers(3, 11))).capitalize()
        draw.text((75, y), name, fill=(60, 90, 60), font=letters)
        draw.text((260, y), str(rng.integers(100, 400)), fill=(60, 90, 60), font=letters)
    return np.asarray(picture)
