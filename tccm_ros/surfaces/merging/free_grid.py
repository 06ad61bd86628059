"""The free columns of a view as a grid, to test points of other views against its free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64, Int64
from tccm_ros.cuboids.free_columns import KEY_STEP, FreeColumns, column_keys
from tccm_ros.kernels import kernel


@dataclass(frozen=True, slots=True, eq=False)
class FreeGrid:
    """Free intervals indexed by a dense grid of columns.

    Attributes
    ----------
    cell_size
        Edge of a column, m.
    corner
        int64 (2,), column of index (0, 0).
    first
        int64 (X, Y + 1): the intervals of column (x, y) are those from first[x, y] up to
        first[x, y + 1].
    low, high
        float64 (M,), m, the free intervals.
    """

    cell_size: float
    corner: Int64
    first: Int64
    low: Float64
    high: Float64

    @classmethod
    def of(cls, free: FreeColumns) -> FreeGrid:
        """Return the grid of free columns."""
        if not len(free.keys):
            none = np.zeros(2, np.int64), np.zeros((0, 1), np.int64)
            return cls(free.cell_size, *none, free.low, free.high)
        x = np.rint(free.keys / KEY_STEP).astype(np.int64)
        y = free.keys - x * KEY_STEP
        rows, columns = np.arange(x.min(), x.max() + 1), np.arange(y.min(), y.max() + 2)
        first = np.searchsorted(free.keys, rows[:, None] * KEY_STEP + columns)
        corner = np.array([rows[0], columns[0]])
        return cls(free.cell_size, corner, first, free.low, free.high)

    def may_touch(
        self, blocks: Float64, T: Float64, max_range: float, margins: tuple[float, float]
    ) -> bool:
        """Return whether any point of the blocks may be in a free interval; False is certain.

        Parameters
        ----------
        blocks
            float64 (B, 5), of `blocks_of`, in the other view.
        T, max_range, margins
            As in `look`.
        """
        grid = self.cell_size, self.corner, self.first, self.low, self.high
        return bool(_may_touch(blocks, T, max_range, margins, *grid))

    def look(
        self, points: Float32, T: Float64, max_range: float, margins: tuple[float, float]
    ) -> tuple[Float64, Bool, Float64]:
        """Test points of another view against the free space of this one.

        Parameters
        ----------
        points
            float32 (N, 3), in the other view, m.
        T
            float64 (4, 4), pose of the other view in this one.
        max_range
            Max horizontal range of this view, m.
        margins
            Min distance of a free point from the ends of its interval: a constant, m, and a part
            proportional to the horizontal distance of the point, m per m.

        Returns
        -------
        points : float64 (N, 3)
            The points in this view, m.
        is_through : bool (N,)
            Whether this view looked through each point.
        margin : float64 (N,)
            Margin of each point, m; -1 beyond `max_range`.
        """
        grid = self.cell_size, self.corner, self.first, self.low, self.high
        return _look(points, T, max_range, margins, *grid)


def blocks_of(points: Float32, size: float) -> Float64:
    """Return the bounds of points (N, 3) in columns of edge `size`, m, float64 (B, 5).

    A row is the centre x, y and z of a block, its horizontal radius, and half its height, m.
    """
    exact = points.astype(np.float64)
    keys = column_keys(exact, size)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(keys[order]) > 0])
    low = np.minimum.reduceat(exact[order], starts)
    high = np.maximum.reduceat(exact[order], starts)
    half = 0.5 * (high - low)
    return np.column_stack([0.5 * (low + high), np.hypot(half[:, 0], half[:, 1]), half[:, 2]])


@kernel(inline="always")
def _moved(points, k, T):  # type: ignore[no-untyped-def]
    """Return point k in another frame, as scalars: an array would cost reference counting."""
    x, y, z = np.float64(points[k, 0]), np.float64(points[k, 1]), np.float64(points[k, 2])
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


@kernel(inline="always")
def _is_free(x, y, z, margin, cell_size, corner, first, low, high):  # type: ignore[no-untyped-def]
    """Return whether a point is in a free interval, at least `margin` m from its ends."""
    i = np.int64(np.floor(x / cell_size)) - corner[0]
    j = np.int64(np.floor(y / cell_size)) - corner[1]
    if i < 0 or j < 0 or i >= first.shape[0] or j >= first.shape[1] - 1:
        return False
    for row in range(first[i, j], first[i, j + 1]):
        if low[row] + margin <= z <= high[row] - margin:
            return True
    return False


@kernel
def _may_touch(blocks, T, max_range, margins, cell_size, corner, first, low, high):  # type: ignore[no-untyped-def]
    for k in range(len(blocks)):
        x, y, z = _moved(blocks, k, T)
        radius, half = blocks[k, 3], blocks[k, 4]
        wide = np.sqrt(radius * radius + half * half)
        nearest = max(np.sqrt(x * x + y * y) - wide, 0.0)
        if nearest > max_range:
            continue
        margin = margins[0] + margins[1] * nearest
        tall = np.hypot(T[2, 0], T[2, 1]) * radius + abs(T[2, 2]) * half
        i_first = max(np.int64(np.floor((x - wide) / cell_size)) - corner[0], 0)
        j_first = max(np.int64(np.floor((y - wide) / cell_size)) - corner[1], 0)
        i_end = min(np.int64(np.floor((x + wide) / cell_size)) - corner[0] + 1, first.shape[0])
        j_end = min(np.int64(np.floor((y + wide) / cell_size)) - corner[1] + 1, first.shape[1] - 1)
        for i in range(i_first, i_end):
            for row in range(first[i, j_first], first[i, max(j_end, j_first)]):
                if low[row] + margin <= z + tall and z - tall <= high[row] - margin:
                    return True
    return False


@kernel
def _look(points, T, max_range, margins, cell_size, corner, first, low, high):  # type: ignore[no-untyped-def]
    moved = np.empty((len(points), 3))
    through = np.zeros(len(points), np.bool_)
    margin = np.full(len(points), -1.0)
    for k in range(len(points)):
        x, y, z = _moved(points, k, T)
        moved[k, 0], moved[k, 1], moved[k, 2] = x, y, z
        distance = np.sqrt(x * x + y * y)
        if distance <= max_range:
            margin[k] = margins[0] + margins[1] * distance
            through[k] = _is_free(x, y, z, margin[k], cell_size, corner, first, low, high)
    return moved, through, margin
