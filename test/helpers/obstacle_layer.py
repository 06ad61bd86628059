"""A model of nav2_costmap_2d::ObstacleLayer in numpy, after its documentation and source.

Points of a source are used between two heights. Points of a clearing source free the cells on the
ray from the sensor, up to `raytrace_max_range`. Afterwards points of a marking source within
`obstacle_max_range` of the sensor mark their cells.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

DEFAULTS = {
    "marking": True, "clearing": False, "min_obstacle_height": 0.0, "max_obstacle_height": 0.0,
    "obstacle_min_range": 0.0, "obstacle_max_range": 2.5, "raytrace_max_range": 3.0,
}  # fmt: skip
"""Default parameters of a source (docs.nav2.org, Obstacle Layer)."""

CELL_M, HALF_M = 0.05, 4.0
UNKNOWN, FREE, LETHAL = -1, 0, 1


class Source(NamedTuple):
    """An entry of `observation_sources`."""

    marking: bool
    clearing: bool
    min_obstacle_height: float
    max_obstacle_height: float
    obstacle_min_range: float
    obstacle_max_range: float
    raytrace_max_range: float

    @classmethod
    def of(cls, written: dict) -> "Source":
        """Return the source of an entry in a parameter file."""
        return cls(**{key: written.get(key, default) for key, default in DEFAULTS.items()})

    def taken(self, points: np.ndarray) -> np.ndarray:
        """Return the points (N, 3) between the two heights."""
        z = points[:, 2]
        return points[(z >= self.min_obstacle_height) & (z <= self.max_obstacle_height)]


@dataclass
class ObstacleLayer:
    """Cells of `CELL_M` around the origin, by x and y."""

    sources: list[Source]

    def __post_init__(self):
        count = round(2 * HALF_M / CELL_M)
        self.cells = np.full((count, count), UNKNOWN)

    def update(self, origin: np.ndarray, points: np.ndarray) -> None:
        """Update the cells by a cloud (N, 3) of all sources, measured from an origin (3,)."""
        for source in self.sources:
            if source.clearing:
                for point in source.taken(points):
                    self._clear(origin, point, source.raytrace_max_range)
        for source in self.sources:
            if source.marking:
                taken = source.taken(points)
                distances = np.linalg.norm(taken - origin, axis=1)
                is_near = distances < source.obstacle_max_range
                is_near &= distances >= source.obstacle_min_range
                self._set(taken[is_near, :2], LETHAL)

    def _clear(self, origin: np.ndarray, point: np.ndarray, max_range: float) -> None:
        ray = point[:2] - origin[:2]
        length = min(np.linalg.norm(ray), max_range)
        steps = np.arange(0.0, length, 0.5 * CELL_M)
        self._set(origin[:2] + np.outer(steps, ray / max(np.linalg.norm(ray), 1e-9)), FREE)

    def _set(self, xy: np.ndarray, value: int) -> None:
        i, j = self._indices(xy)
        is_inside = (i >= 0) & (i < len(self.cells)) & (j >= 0) & (j < len(self.cells))
        self.cells[i[is_inside], j[is_inside]] = value

    def _indices(self, xy: np.ndarray) -> np.ndarray:
        return np.floor((xy + HALF_M) / CELL_M).astype(int).T

    def within(self, x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
        """Return the cells with their middles in a rectangle."""
        middles = (np.arange(len(self.cells)) + 0.5) * CELL_M - HALF_M
        in_x, in_y = ((middles > low) & (middles < high) for low, high in (x, y))
        return self.cells[np.ix_(in_x, in_y)]
