"""Model of a colour camera: rendering of a world, motion blur, exposure and noise.

Rays at the middle of the exposure determine the face seen by each pixel. At several times of the
exposure the pixel's ray, shifted within the pixel, is intersected with that face again, and the
colours there are averaged, which gives motion blur and anti-aliasing of pictures on walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO

import numpy as np
from numpy.random import Generator
from PIL import Image

from tccm_ros.arrays import Bool, Float32, Float64, Int64, UInt8
from tccm_ros.kernels import kernel
from tccm_sim.cameras import Pinhole
from tccm_sim.panels import PanelArrays
from tccm_sim.scene import FrozenScene

FAR = 60.0  # m, the longest ray
SKY = (196.0, 208.0, 218.0)
"""Colour without a hit."""

COLORS = {
    "floor": (112.0, 116.0, 122.0), "ceiling": (214.0, 214.0, 208.0), "wall": (190.0, 184.0, 168.0),
    "furniture": (142.0, 112.0, 82.0), "object": (92.0, 124.0, 140.0),
    "person": (70.0, 76.0, 110.0),
}  # fmt: skip
"""Mean colour of solids by role. Chosen."""

GRAIN = {"floor": 0.08, "wall": 0.03, "furniture": 0.10}
"""Amplitude of the texture of solids by role. Chosen."""

GRAIN_PIXELS, GRAIN_METRES = 512, 1.6
"""Size of the periodic texture."""

JITTER = ((-0.3, -0.1), (0.1, 0.3), (-0.1, -0.3), (0.3, 0.1))
"""Shifts of an exposure's rays within a pixel."""

ON_PANEL = 0.02  # m, maximum distance of a panel from its face


@dataclass(frozen=True)
class ColourCamera(Pinhole):
    """A colour camera.

    Attributes
    ----------
    exposure
        Duration of the exposure, s; the stamp is its middle.
    sigma
        Standard deviation of the noise, for values from 0 to 255.
    gain
        Relative variation of the exposure between pictures.
    quality
        Quality of the JPEG files, 1 to 95.
    """

    exposure: float = 0.008
    sigma: float = 2.0
    gain: float = 0.08
    quality: int = 80

    def exposure_times(self, time: float) -> Float64:
        """Return the sampling times of a picture at a time, s; float64 (S,)."""
        n = len(JITTER)
        return time + self.exposure * ((np.arange(n) + 0.5) / n - 0.5)


def grain_texture() -> Float32:
    """Return a seamless texture of mean 0 and standard deviation 1.

    float32 (`GRAIN_PIXELS`, `GRAIN_PIXELS`).
    """
    random = np.random.default_rng(20)
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(GRAIN_PIXELS),) * 2))
    noise = np.fft.fft2(random.standard_normal((GRAIN_PIXELS, GRAIN_PIXELS)))
    texture = np.real(np.fft.ifft2(noise / np.maximum(frequency, 1.0 / GRAIN_PIXELS) ** 0.8))
    return ((texture - texture.mean()) / texture.std()).astype(np.float32)


class ColourRenderer:
    """Renders pictures of a scene with panels.

    Parameters
    ----------
    scene
        The solids.
    panels
        Pictures on them.
    """

    def __init__(self, scene: FrozenScene, panels: PanelArrays) -> None:
        self._scene = scene
        self._panels = panels
        self._grain = grain_texture()
        variety = np.random.default_rng(21).uniform(0.86, 1.1, (len(scene.solids), 3))
        plain = np.array([COLORS[solid.role] for solid in scene.solids])
        is_varied = np.array([solid.role in ("furniture", "object") for solid in scene.solids])
        self._colors = np.where(is_varied[:, None], plain * variety, plain)
        self._amplitudes = np.array([GRAIN.get(solid.role, 0.02) for solid in scene.solids])

    def render(self, camera: ColourCamera, T_world_camera: Float64, time: float) -> Float32:
        """Return a picture without noise, float32 (height, width, 3), 0 to 255.

        Parameters
        ----------
        camera
            The camera.
        T_world_camera
            float64 (S, 4, 4), poses of the optical frame at `ColourCamera.exposure_times`.
        time
            Time of the middle of the exposure, s, which determines the poses of moving solids.
        """
        middle = T_world_camera[len(T_world_camera) // 2]
        directions = camera.rays @ middle[:3, :3].T
        origins = np.broadcast_to(middle[:3, 3], directions.shape).copy()
        times = np.full(len(directions), time)
        ranges, codes = self._scene.cast(origins, directions, times, FAR)
        normals = self._scene.normals(origins, directions, ranges, codes)
        seen = codes >= 0
        solid = np.where(seen, codes // 6, 0)
        hits = origins + np.where(seen, ranges, FAR)[:, None] * directions
        colors = np.where(seen[:, None], self._colors[solid], SKY)
        cosines = np.abs(np.einsum("bi,bi->b", normals, directions))
        pixel_sizes = np.where(seen, ranges, FAR) / camera.focal / np.sqrt(np.maximum(cosines, 0.1))
        out = np.empty((len(codes), 3), np.float32)
        _shade(
            camera.rays, np.ascontiguousarray(T_world_camera), np.array(JITTER) / camera.focal,
            hits, normals, seen, pixel_sizes, colors * _light(hits, normals)[:, None],
            np.where(seen, self._amplitudes[solid], 0.0), self._grain, *self._panels, out,
        )  # fmt: skip
        return out.reshape(camera.height, camera.width, 3)


def exposed(camera: ColourCamera, picture: Float32, random: Generator) -> UInt8:
    """Return a picture with vignetting, exposure and noise, uint8.

    Parameters
    ----------
    camera
        The camera.
    picture
        float32 (height, width, 3), 0 to 255, without noise.
    random
        Random generator of noise.
    """
    gain = 1.0 + camera.gain * random.standard_normal()
    z = camera.rays[:, 2].reshape(camera.height, camera.width, 1)
    noise = camera.sigma * random.standard_normal(picture.shape, np.float32)
    values = gain * (0.55 + 0.45 * z**2) * picture + noise
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def jpeg(pixels: UInt8, quality: int) -> UInt8:
    """Return a picture as a JPEG file, uint8 (N,).

    Parameters
    ----------
    pixels
        uint8 (height, width, 3), red, green, blue.
    quality
        1 to 95.
    """
    file = BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality)
    return np.frombuffer(file.getvalue(), np.uint8)


def _light(points: Float64, normals: Float64) -> Float64:
    """Return the brightness of points: lamps every 2.4 m, walls of two directions, far rooms."""
    lamps = 0.10 * np.cos(2.0 * np.pi / 2.4 * points[:, 0]) * np.cos(0.9 * points[:, 1])
    facing = 0.08 * np.abs(normals[:, 0]) - 0.06 * np.abs(normals[:, 1])
    light: Float64 = 0.88 + lamps + facing + 0.05 * (points[:, 2] - 1.2)
    return light


@kernel
def _shade(
    rays: Float64, poses: Float64, jitter: Float64, hits: Float64, normals: Float64, seen: Bool,
    pixel_sizes: Float64, colors: Float64, amplitudes: Float64, grain: Float32,
    T_panel_world: Float64, half: Float64, levels: Int64, first: Int64, pixels: UInt8,
    out: Float32,
) -> None:  # fmt: skip
    """Average the colours of each pixel over the exposure (`ColourRenderer.render`)."""
    d, p, q = np.empty(3), np.empty(3), np.empty(3)
    for b in range(len(rays)):
        total = np.zeros(3)
        for s in range(len(poses)):
            T = poses[s]
            x = rays[b, 0] + jitter[s, 0] * rays[b, 2]
            y = rays[b, 1] + jitter[s, 1] * rays[b, 2]
            above, below = 0.0, 0.0
            for i in range(3):
                d[i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * rays[b, 2]
                above += (hits[b, i] - T[i, 3]) * normals[b, i]
                below += d[i] * normals[b, i]
            along = above / below if abs(below) > 1e-3 else 0.0
            for i in range(3):
                p[i] = T[i, 3] + along * d[i] if along > 0.0 else hits[b, i]
            n = normals[b]
            if abs(n[2]) > 0.7:
                u, v = p[0], p[1]
            else:
                u, v = p[1] * n[0] - p[0] * n[1], p[2]
            value = 1.0 + amplitudes[b] * _grain_at(grain, u, v)
            r, g, a = value * colors[b, 0], value * colors[b, 1], value * colors[b, 2]
            for k in range(len(half) if seen[b] else 0):
                M = T_panel_world[k]
                for i in range(3):
                    q[i] = M[i, 0] * p[0] + M[i, 1] * p[1] + M[i, 2] * p[2] + M[i, 3]
                if abs(q[2]) < ON_PANEL and abs(q[0]) < half[k, 0] and abs(q[1]) < half[k, 1]:
                    texels = levels[first[k], 2] * pixel_sizes[b] / (2.0 * half[k, 0])
                    level = first[k] + int(np.log2(max(texels, 1.0)) + 0.5)
                    level = min(level, first[k + 1] - 1)
                    start, rows, columns = levels[level]
                    across = (q[0] / half[k, 0] + 1.0) / 2.0 * columns - 0.5
                    down = (1.0 - q[1] / half[k, 1]) / 2.0 * rows - 0.5
                    shade = (colors[b, 0] + colors[b, 1] + colors[b, 2]) / 542.0
                    r = shade * _texel(pixels, start, rows, columns, across, down, 0)
                    g = shade * _texel(pixels, start, rows, columns, across, down, 1)
                    a = shade * _texel(pixels, start, rows, columns, across, down, 2)
            total[0] += r
            total[1] += g
            total[2] += a
        for i in range(3):
            out[b, i] = total[i] / len(poses)


@kernel
def _grain_at(grain: Float32, u: float, v: float) -> float:
    """Return the texture at a position on a face, m."""
    n = len(grain)
    i = int(np.floor(v / GRAIN_METRES * n)) % n
    j = int(np.floor(u / GRAIN_METRES * n)) % n
    return float(grain[i, j])


@kernel
def _texel(
    pixels: UInt8, start: int, rows: int, columns: int, across: float, down: float, i: int
) -> float:
    """Return a colour value of a picture, interpolated between four pixels."""
    across = min(max(across, 0.0), columns - 1.0)
    down = min(max(down, 0.0), rows - 1.0)
    x, y = int(across), int(down)
    right, lower = min(x + 1, columns - 1), min(y + 1, rows - 1)
    fx, fy = across - x, down - y
    upper_row, lower_row = start + y * columns, start + lower * columns
    high = (1.0 - fx) * pixels[upper_row + x, i] + fx * pixels[upper_row + right, i]
    low = (1.0 - fx) * pixels[lower_row + x, i] + fx * pixels[lower_row + right, i]
    return float((1.0 - fy) * high + fy * low)
