"""What the TCCM is measured against: a C++ twin, OctoMap, and a numpy twin.

The C++ sources are compiled where g++ is there; a peer that is not there is None, and its row says
so.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent / "cpp"
_FOLDER = tempfile.TemporaryDirectory()


def compiled(name: str, *options: str) -> ctypes.CDLL | None:
    """Compile and load a C++ file of bench/cpp; None without a compiler or its libraries."""
    if shutil.which("g++") is None:
        return None
    library = Path(_FOLDER.name) / f"{name}.so"
    command = ["g++", "-O3", "-std=c++17", "-shared", "-fPIC", str(HERE / f"{name}.cpp")]
    command += ["-o", str(library), *options]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        return None
    return ctypes.CDLL(str(library))


def _pointer(array: NDArray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


class Twin:
    """The C++ twin of the same algorithm."""

    def __init__(self, library: ctypes.CDLL, config) -> None:
        m = config.map
        self._lib = library
        library.twin_new.restype = ctypes.c_void_p
        region = np.array(m.region or (), float)
        adaptive = m.gap == "adaptive"
        depth = float(round(m.cuboid_depth * 1e4))
        self._twin = ctypes.c_void_p(
            library.twin_new(
                ctypes.c_double(round(m.cell_size * 1e4)),
                ctypes.c_double(depth),
                ctypes.c_double(m.gap_factor if adaptive else 0.0),
                ctypes.c_double(max(depth, round(m.max_depth * 1e4)) if adaptive else depth),
                _pointer(region) if len(region) else None,
                ctypes.c_int(m.window_cycles),
            )
        )
        self._cycle = 0

    def scans(self, scene) -> None:
        """Project and bin all scans of a tilt cycle."""
        n_scans, beams = scene.ranges.shape
        self._lib.twin_scans(
            self._twin, *map(_pointer, scene.for_twin), ctypes.c_int(n_scans),
            ctypes.c_int(scene.pose_samples), ctypes.c_int(beams), ctypes.c_double(scene.step),
        )  # fmt: skip

    def points(self, xyz: NDArray[np.float64]) -> None:
        """Bin points (N, 3)."""
        self._lib.twin_points(self._twin, _pointer(xyz), ctypes.c_int(len(xyz)))

    def close(self) -> int:
        """Make the part map of what was binned."""
        self._cycle += 1
        return self._lib.twin_close(self._twin, ctypes.c_int(self._cycle - 1))

    def part_alone(self) -> int:
        """Make the part map, and forget those before."""
        return self._lib.twin_part_alone(self._twin)

    def merge(self) -> int:
        """Newest in, oldest out."""
        return self._lib.twin_merge(self._twin)

    def compose(self) -> int:
        """Read the composite cuboids with their moments."""
        return self._lib.twin_compose(self._twin)

    def read_part(self, n: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return keys, bounds and moments of the newest part map."""
        keys, bounds = np.empty(n, np.int64), np.empty((n, 2), np.int32)
        moments = np.empty((n, 10), np.int64)
        self._lib.twin_read_part(self._twin, *map(_pointer, (keys, bounds, moments)))
        return keys, bounds, moments

    def read_pieces(self, n: int) -> tuple[NDArray, NDArray]:
        """Return cells and pieces of the map."""
        keys, pieces = np.empty(n, np.int64), np.empty((n, 4), np.int32)
        self._lib.twin_read_pieces(self._twin, *map(_pointer, (keys, pieces)))
        return keys, pieces

    def read_composites(self, n: int) -> NDArray:
        """Return count and moments of the composite cuboids."""
        moments = np.empty((n, 10))
        self._lib.twin_read_composites(self._twin, _pointer(moments))
        return moments


def find_octomap(which: str | None) -> Callable[[float], OctoMap | PyOctoMap] | None:
    """Return what makes an OctoMap of a resolution, m; None if there is none.

    `which` is "c++", "python", or None for the first that is there.
    """
    if which != "python":
        library = compiled("octomap_peer", "-loctomap", "-loctomath")
        if library is not None:
            return functools.partial(OctoMap, library)
    if which != "c++" and importlib.util.find_spec("pyoctomap") is not None:
        return PyOctoMap
    return None


class OctoMap:
    """OctoMap (C++)."""

    name = "OctoMap"

    def __init__(self, library: ctypes.CDLL, resolution: float) -> None:
        self._lib = library
        library.octo_new.restype = ctypes.c_void_p
        library.octo_memory.restype = library.octo_occupied.restype = ctypes.c_int64
        self._tree = ctypes.c_void_p(library.octo_new(ctypes.c_double(resolution)))

    def clear(self) -> None:
        """Forget everything."""
        self._lib.octo_clear(self._tree)

    def endpoints(self, xyz: NDArray[np.float32]) -> None:
        """Insert end points only."""
        self._lib.octo_endpoints(self._tree, _pointer(xyz), ctypes.c_int(len(xyz)))

    def rays(self, xyz: NDArray[np.float32], origin) -> None:
        """Insert with ray casting."""
        where = [ctypes.c_double(v) for v in origin]
        self._lib.octo_rays(self._tree, _pointer(xyz), ctypes.c_int(len(xyz)), *where)

    def memory(self) -> int:
        """Return its memory, bytes."""
        return self._lib.octo_memory(self._tree)

    def occupied(self, box) -> int:
        """Return its occupied voxels in a box."""
        return self._lib.octo_occupied(self._tree, _pointer(np.array(box, float)))


class PyOctoMap:
    """OctoMap by its Python wheel, pyoctomap: where liboctomap-dev is not installed."""

    name = "pyoctomap"

    def __init__(self, resolution: float) -> None:
        import pyoctomap

        self._tree = pyoctomap.OcTree(resolution)

    def clear(self) -> None:
        """Forget everything."""
        self._tree.clear()

    def endpoints(self, xyz: NDArray[np.float32]) -> None:
        """Insert end points only."""
        self._tree.updateNodes(xyz.astype(float), True, True)
        self._tree.updateInnerOccupancy()

    def rays(self, xyz: NDArray[np.float32], origin) -> None:
        """Insert with ray casting."""
        self._tree.insertPointCloud(xyz.astype(float), np.array(origin, float))

    def memory(self) -> int:
        """Return its memory, bytes."""
        return self._tree.memoryUsage()

    def occupied(self, box) -> int:
        """Return its occupied voxels in a box."""
        low, high = np.array(box[::2], float), np.array(box[1::2], float)
        count = 0
        for leaf in self._tree.begin_leafs_bbx(low, high):
            at = np.array(leaf.getCoordinate())
            count += bool(self._tree.isNodeOccupied(leaf)) and bool(
                ((low <= at) & (at <= high)).all()
            )
        return count


def numpy_part(xyz: NDArray[np.float64], cell: int, depth: int) -> tuple[NDArray, NDArray, NDArray]:
    """Return keys, bounds and moments of the part map of points: lexsort and reduceat."""
    ticks = np.floor(xyz * 1e4 + 0.5).astype(np.int64)
    cells = ticks[:, :2] // cell
    local = np.column_stack([ticks[:, :2] - cells * cell, ticks[:, 2]])
    keys = (cells[:, 0] << 32) + cells[:, 1]
    order = np.lexsort((local[:, 2], keys))
    keys, local = keys[order], local[order]
    z = local[:, 2]
    begins = np.concatenate([[True], (np.diff(keys) != 0) | (np.diff(z) > depth)])
    first = np.flatnonzero(begins)
    last = np.append(first[1:], len(z)) - 1
    products = [local[:, i] * local[:, j] for i in range(3) for j in range(i, 3)]
    columns = np.column_stack([np.ones(len(z), np.int64), local, *products])
    bounds = np.column_stack([z[first] - depth, z[last]]).astype(np.int32)
    return keys[first], bounds, np.add.reduceat(columns, first, axis=0)
