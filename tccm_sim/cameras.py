"""Models of cameras: a pinhole, and a depth camera with noise, flying pixels and lost returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tccm_ros.arrays import Float64
from tccm_sim.lasers import EDGE


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion.

    Attributes
    ----------
    width, height, focal
        Size of the image and focal length, px; the principal point is the middle of the image.
    period
        Time between images, s.
    """

    width: int
    height: int
    focal: float
    period: float

    @property
    def center(self) -> tuple[float, float]:
        """The principal point (cx, cy), px."""
        return (self.width - 1) / 2.0, (self.height - 1) / 2.0

    @cached_property
    def rays(self) -> Float64:
        """Unit vectors of the pixels, row by row, float64 (height * width, 3).

        They are in the optical frame of REP-103: z along the axis, x to the right, y down.
        """
        v, u = np.indices((self.height, self.width)).reshape(2, -1)
        cx, cy = self.center
        x, y = (u - cx) / self.focal, (v - cy) / self.focal
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        unit: Float64 = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit


@dataclass(frozen=True)
class DepthCamera(Pinhole):
    """A depth camera that triangulates (structured light or stereo).

    The disparity of a depth z is ``disparity_scale / z``. Its noise and its step give depths a
    standard deviation of about ``z^2 / disparity_scale * hypot(disparity_sigma, disparity_step /
    sqrt(12))`` (Khoshelham and Elberink, Sensors 2012, section 3).

    Attributes
    ----------
    range_min, range_max
        Limits of the depth, m.
    disparity_scale
        Focal length times baseline of the sensor itself, m px.
    disparity_sigma, disparity_step
        Noise and quantisation step of the disparity, px; a step of 0 means no rounding.
    flying
        Fraction of pixels at a depth edge that return a depth between its two sides.
    grazing
        Minimum cosine of the angle of incidence for a return.
    lost
        Fraction of the other pixels without a return.
    """

    range_min: float
    range_max: float
    disparity_scale: float
    disparity_sigma: float
    disparity_step: float = 0.125
    flying: float = 0.0
    grazing: float = 0.0
    lost: float = 0.0

    def sigma(self, depths: Float64) -> Float64:
        """Return the standard deviation of depths, m, from noise and step of the disparity."""
        error = np.hypot(self.disparity_sigma, self.disparity_step / np.sqrt(12.0))
        result: Float64 = depths**2 / self.disparity_scale * error
        return result


def measure_depths(
    camera: DepthCamera, exact: Float64, cosines: Float64, random: Generator
) -> NDArray[np.uint16]:
    """Return the depth image that a camera reports.

    Parameters
    ----------
    camera
        The camera.
    exact
        float64 (height, width), depth along the optical axis, m; +inf without a hit.
    cosines
        float64 (height, width), cosine of the angle of incidence, 0 to 1.
    random
        Random generator of noise; the number of draws does not depend on the depths.

    Returns
    -------
    uint16 (height, width)
        16UC1: mm, 0 without a return.
    """
    noise = random.standard_normal(exact.shape, np.float32)
    chance, blend, failure = random.random((3, *exact.shape), np.float32)
    depths = np.minimum(exact, 1e3)
    for axis in (0, 1):
        neighbours = np.roll(depths, -1, axis)
        on_edge = (np.abs(depths - neighbours) > EDGE) & (chance < camera.flying)
        np.copyto(depths, blend * depths + (1.0 - blend) * neighbours, where=on_edge)
    disparities = camera.disparity_scale / depths + camera.disparity_sigma * noise
    if camera.disparity_step > 0.0:
        disparities = np.round(disparities / camera.disparity_step) * camera.disparity_step
    depths = camera.disparity_scale / np.maximum(disparities, 1e-3)
    seen = (depths >= camera.range_min) & (depths <= camera.range_max)
    seen &= (cosines >= camera.grazing) & (failure >= camera.lost)
    return np.where(seen, np.round(1000.0 * depths), 0.0).astype(np.uint16)
