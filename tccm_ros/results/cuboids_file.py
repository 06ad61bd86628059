"""Write and read cuboids.npz: the final integration map, in the odometry frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, Cuboids
from tccm_ros.errors import MapError, one_line
from tccm_ros.planes.horizontal_clusters import label_horizontal
from tccm_ros.results.array_archive import array_archive, read_arrays


@dataclass(frozen=True, slots=True, eq=False)
class FinalCuboids:
    """The arrays of cuboids.npz that the report uses.

    Attributes
    ----------
    cell_size
        Edge length of a cell, m.
    ix, iy
        int64 (N,), cell indices; a cell may hold several cuboids.
    bottom, top
        float64 (N,), heights in the odometry frame, m.
    count
        float64 (N,), numbers of points.
    mean, cov
        float64 (N, 3) and (N, 6: xx xy xz yy yz zz) of the points, m and m2.
    newest
        int64 (N,), newest tilt cycle with points in each cuboid.
    """

    cell_size: float
    ix: Int64
    iy: Int64
    bottom: Float64
    top: Float64
    count: Float64
    mean: Float64
    cov: Float64
    newest: Int64

    def __len__(self) -> int:
        return len(self.ix)


def cuboids_archive(cuboids: Cuboids, config: Config, frame_id: str) -> bytes:
    """Return the content of cuboids.npz.

    Parameters
    ----------
    cuboids
        The integration map.
    config
        Group ``planes``.
    frame_id
        Frame of the integration map, the odometry frame.
    """
    return array_archive(
        {
            "ix": cuboids.ix,
            "iy": cuboids.iy,
            "top": cuboids.top * TICK,
            "bottom": cuboids.bottom * TICK,
            "count": cuboids.count,
            "cls": label_horizontal(cuboids, config.planes.height_threshold),
            "mean": cuboids.mean(),
            "cov": cuboids.cov(),
            "cycles": cuboids.cycles,
            "cycle_offsets": cuboids.cycle_offsets,
            "cell_size": np.array(cuboids.cell_size),
            "frame_id": np.array(frame_id),
        }
    )


def load_cuboids(path: Path | str) -> FinalCuboids:
    """Read cuboids.npz.

    Raises
    ------
    MapError
        If the file is missing or damaged.
    """
    try:
        return _final(read_arrays(Path(path)))
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise MapError(f"{path}: damaged: {one_line(error)}") from None


def _final(arrays: Mapping[str, Any]) -> FinalCuboids:
    ix = arrays["ix"].astype(np.int64)
    n = len(ix)
    offsets, cycles = arrays["cycle_offsets"].astype(np.int64), arrays["cycles"].astype(np.int64)
    if len(offsets) != n + 1:
        raise ValueError(f"{len(offsets)} cycle offsets for {n} cuboids, expected {n + 1}")
    return FinalCuboids(
        float(arrays["cell_size"]),
        ix,
        arrays["iy"].astype(np.int64).reshape(n),
        arrays["bottom"].astype(float).reshape(n),
        arrays["top"].astype(float).reshape(n),
        arrays["count"].astype(float).reshape(n),
        arrays["mean"].astype(float).reshape(n, 3),
        arrays["cov"].astype(float).reshape(n, 6),
        cycles[offsets[1:] - 1] if n else np.zeros(0, np.int64),
    )
