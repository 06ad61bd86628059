"""Models of cameras: the pinhole; a depth camera with its noise, flying pixels, missing returns."""

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
        Between images, s.
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
        Noise and step of the disparity, px; a step of 0 keeps all digits.
    flying
        Fraction of the pixels at a depth edge that return a depth in between.
    grazing
        Min cosine of the angle of incidence that gives a return.
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
        """Return the standard deviation of depths, both in m: noise and step of the disparity."""
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
        float64 (height, width), depth along the optical axis, m; +inf where there is nothing.
    cosines
        float64 (height, width), cosine of the angle of incidence, 0 to 1.
    random
        Source of noise; the same number of draws is made whatever the depths are.

    Returns
    -------
    uint16 (height, width)
        16UC1: mm, 0 where there is no return.
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
