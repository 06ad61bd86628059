"""Plates on walls, and simulated camera measurements of them, with noise.

It has no code in common with the code under test: a plate is projected by its own formula, and
occluded where a ray of the plan ends before it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import plan
from numpy.typing import NDArray

from tccm_ros.signs.measurement import SearchedPicture, SignMeasurement

Float64 = NDArray[np.float64]

WIDTH, HEIGHT, FOCAL = 960, 720, 700.0
MAX_RANGE, MAX_INCIDENCE = 5.0, np.radians(65.0)
PIXEL_SIGMA = 2.0
PLATE_CORNERS = np.array([[-20.0, -10.0], [20.0, -10.0], [20.0, 10.0], [-20.0, 10.0]])


@dataclass(frozen=True)
class Plate:
    """A number on a wall: position (3,), m, direction, rad, and the text read in views."""

    number: str
    position: tuple[float, float, float]
    facing: float
    looks: str = ""


@dataclass(frozen=True)
class Cameras:
    """Cameras that look to the left and right of the direction of motion."""

    yaws: Sequence[float] = (0.6, -0.6)
    height: float = 1.1

    def T_base_camera(self, yaw: float) -> Float64:
        """Return the pose of an optical frame: x right, y down, z forward."""
        T = plan.matrix((0.2, 0.0, yaw))
        T[2, 3] = self.height
        optical = np.eye(4)
        optical[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        return T @ optical


def patch_of(text: str, random: np.random.Generator) -> NDArray[np.uint8]:
    """Return a patch (32, 64): blocks of grey by the text, a tenth of it noise."""
    own = np.random.default_rng([ord(c) for c in text]).normal(size=(8, 8))
    blocks = np.kron(own + 0.1 * random.normal(size=(8, 8)), np.ones((4, 8)))
    return np.clip(128 + 40 * blocks, 0, 255).astype(np.uint8)


def corner_rays(pixel: Float64) -> Float64:
    """Return the bearings (4, 3) of the corners of a plate, 40 x 20 pixels about a pixel."""
    corners = pixel + PLATE_CORNERS - [WIDTH / 2, HEIGHT / 2]
    rays = np.hstack([corners / FOCAL, np.ones((4, 1))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


@dataclass
class Pictures:
    """Takes pictures along a drive.

    Attributes
    ----------
    plates
        Plates in the frame of the plan.
    walls
        Walls of the plan; they occlude plates.
    misread
        Returns the text read from a plate's number.
    roll_pitch
        Standard deviation of the base's roll and pitch, rad.
    """

    plates: Sequence[Plate]
    walls: Float64
    cameras: Cameras = field(default_factory=Cameras)
    misread: Callable[[str, np.random.Generator], str] = lambda text, random: text
    roll_pitch: float = 0.004
    found: float = 0.9

    def along(
        self, poses: Float64, stamps_ns: NDArray[np.int64], seed: int = 0, period: float = 0.5
    ) -> list[SignMeasurement]:
        """Return the measurements along a drive; poses (N, 3) are in the frame of the plan."""
        random, measurements = np.random.default_rng(seed), []
        for pose, stamp in _taken(poses, stamps_ns, period):
            T_map_base = plan.matrix(pose)
            T_map_base[:3, :3] = T_map_base[:3, :3] @ _tilted(
                *random.normal(size=2) * self.roll_pitch
            )
            for yaw in self.cameras.yaws:
                measurements += self._picture(
                    T_map_base, self.cameras.T_base_camera(yaw), stamp, random
                )
        return measurements

    def searched(
        self, poses: Float64, stamps_ns: NDArray[np.int64], period: float = 0.5
    ) -> list[SearchedPicture]:
        """Return the pictures along a drive, with and without plates."""
        focal, center = np.full(2, FOCAL), np.array([WIDTH / 2, HEIGHT / 2])
        return [
            SearchedPicture(stamp, T, focal, center, (int(WIDTH), int(HEIGHT)))
            for _, stamp in _taken(poses, stamps_ns, period)
            for T in map(self.cameras.T_base_camera, self.cameras.yaws)
        ]

    def _picture(
        self, T_map_base: Float64, T_base_camera: Float64, stamp: int, random: np.random.Generator
    ) -> list[SignMeasurement]:
        T = T_map_base @ T_base_camera
        measurements = []
        for plate in self.plates:
            seen = self._pixel(plate, T)
            if seen is None or random.random() > self.found:
                continue
            pixel = seen + random.normal(size=2) * PIXEL_SIGMA
            ray = np.array([*(pixel - [WIDTH / 2, HEIGHT / 2]) / FOCAL, 1.0])
            number = self.misread(plate.number, random)
            measurements.append(
                SignMeasurement(
                    stamp,
                    pixel,
                    ray / np.linalg.norm(ray),
                    T_base_camera,
                    f"{number} Office",
                    number,
                    float(random.uniform(0.8, 1.0)),
                    patch_of(plate.looks or plate.number, random),
                    pixel + PLATE_CORNERS,
                    corner_rays(pixel),
                    FOCAL,
                )
            )
        return measurements

    def _pixel(self, plate: Plate, T_map_camera: Float64) -> Float64 | None:
        """Return the pixel of a plate in the picture; None if it is not readable."""
        point = np.array(plate.position)
        away = T_map_camera[:3, 3] - point
        normal = np.array([np.cos(plate.facing), np.sin(plate.facing), 0.0])
        distance = float(np.linalg.norm(away))
        if distance > MAX_RANGE or away @ normal < distance * np.cos(MAX_INCIDENCE):
            return None
        x, y, z = T_map_camera[:3, :3].T @ -away
        if z < 0.1:
            return None
        pixel = FOCAL * np.array([x, y]) / z + [WIDTH / 2, HEIGHT / 2]
        if not (30 < pixel[0] < WIDTH - 30 and 30 < pixel[1] < HEIGHT - 30):
            return None
        bearing = np.arctan2(*-away[1::-1])
        free = plan.cast(self.walls, np.array([*T_map_camera[:2, 3], 0.0]), np.array([bearing]))[0]
        return pixel if free > np.hypot(*away[:2]) - 0.05 else None


def _taken(
    poses: Float64, stamps_ns: NDArray[np.int64], period: float
) -> Iterator[tuple[Float64, int]]:
    """Yield the poses and stamps of pictures."""
    last = -np.inf
    for pose, stamp in zip(poses, stamps_ns.tolist()):
        if stamp * 1e-9 - last > period - 1e-6:
            last = stamp * 1e-9
            yield pose, stamp


def _tilted(roll: float, pitch: float) -> Float64:
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    across = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]]) @ across


LENGTH, WIDTH_OF_RING, HALF = 20.0, 9.0, 1.0


def office() -> tuple[Float64, list[Plate]]:
    """Return a ring of corridors and the plates of ten doors on its outer walls."""
    plates = []
    for k, x in enumerate((2.0, 5.2, 9.0, 12.5, 16.0)):
        plates.append(Plate(f"{201 + 2 * k}", (x, -HALF + 0.02, 1.5), np.pi / 2))
        far = WIDTH_OF_RING + HALF - 0.02
        plates.append(Plate(f"{202 + 2 * k}", (x + 1.0, far, 1.5), -np.pi / 2))
    return plan.ring(LENGTH, WIDTH_OF_RING), plates


def two_laps() -> Float64:
    """Return a drive of two laps in the office at 0.5 m/s, from (0, 0)."""
    lap = [(0, 0), (LENGTH, 0), (LENGTH, WIDTH_OF_RING), (0, WIDTH_OF_RING), (0, 0)]
    return plan.route([*lap, *lap[1:], (2, 0)], step=0.05)


def one_digit_in_ten(text: str, random: np.random.Generator) -> str:
    """Return a text; with probability 0.1 a random character is replaced by a random digit."""
    if random.random() > 0.1:
        return text
    i = int(random.integers(len(text)))
    return text[:i] + str(random.integers(10)) + text[i + 1 :]
