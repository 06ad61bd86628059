"""Scenes, baselines and measures that the plane benchmarks share."""

from __future__ import annotations

import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from situation_cycle import SUBJECT, Cycle

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.cuboids.part_map import PartMapBuilder
from tccm_ros.geometry import pose_from_rpy
from tccm_ros.planes import PlaneFit, PlaneFits
from tccm_ros.records import PosedScan, Scan

Array = NDArray[np.float64]

REGION = (0.2, 1.5, -0.9, 0.9, 0.1, 1.45)
"""What the arms reach: x, y and z limits, m."""

MISS_MM, MISS_DEG = 20.0, 2.0
"""A plane that is further off is a miss."""

PEERS = Path(__file__).resolve().parent / "peers"


def eye(cycle: Cycle) -> Array:
    """Return where the laser is, m."""
    return np.array([0.0, 0.0, cycle.laser_height])


def in_region(points: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 3) are in the region of interest."""
    low, high = np.array(REGION).reshape(3, 2).T
    return np.all((points > low) & (points < high), axis=1)


def part_map_of(cycle: Cycle, config: Config, region: tuple[float, ...] | None = None) -> Cuboids:
    """Return the part map of a simulated tilt cycle."""
    builder = PartMapBuilder(config)
    if region is not None:
        builder.set_region(region)
    still = np.stack([np.eye(4)] * 2)
    step = float(cycle.bearings[1] - cycle.bearings[0])
    beams = len(cycle.bearings)
    for ranges, tilts, times in zip(cycle.ranges, cycle.tilts, cycle.times, strict=True):
        stamps_ns = np.rint(times[[0, -1]] * 1e9).astype(np.int64)
        T = np.stack([pose_from_rpy((0, 0, cycle.laser_height, 0, t, 0)) for t in tilts[[0, -1]]])
        scan = Scan(
            int(stamps_ns[0]), "laser", float(cycle.bearings[0]), step,
            float(times[-1] - times[0]) / (beams - 1), 0.05, 30.0, ranges.astype(np.float32),
        )  # fmt: skip
        builder.add(PosedScan(scan, stamps_ns, still, T), np.isfinite(ranges))
    return builder.close(0, 0, 1).cuboids()


def subject_points(cycle: Cycle) -> Array:
    """Return the points of the subject in the region of interest."""
    return cycle.points[(cycle.labels == SUBJECT) & in_region(cycle.points)]


def fitted_plane(points: Array) -> tuple[Array, float]:
    """Return the least-squares plane of points."""
    mean = points.mean(axis=0)
    normal = np.linalg.svd(points - mean, full_matrices=False)[2][2]
    return normal, float(normal @ mean)


def error(normal: Array, offset: float, cycle: Cycle, at: Array) -> tuple[float, float]:
    """Return the error of a plane: mm along the true normal at a point, and degrees."""
    cosine = float(normal @ cycle.normal)
    sign = 1.0 if cosine >= 0.0 else -1.0
    off = sign * (offset - normal @ at) - (cycle.offset - cycle.normal @ at)
    return 1e3 * float(off), float(np.degrees(np.arccos(min(1.0, abs(cosine)))))


def subject_fit(fits: PlaneFits, cycle: Cycle, at: Array) -> PlaneFit | None:
    """Return the best supported plane that is no miss."""
    for fit in sorted(fits, key=lambda f: -f.support):
        mm, deg = error(fit.normal, fit.offset, cycle, at)
        if abs(mm) < MISS_MM and deg < MISS_DEG:
            return fit
    return None


def median_ms(call: Callable[[], object], repeats: int = 50) -> float:
    """Return the median time of a call, ms of this thread's processor time."""
    call()
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return 1e3 * statistics.median(times)


def pcl_planes(
    clouds: Sequence[Array], trials: int, threshold: float = 0.01, repeats: int = 1
) -> list[Array] | None:
    """Run PCL's RANSAC (C++) on clouds; return None without PCL.

    Parameters
    ----------
    clouds
        float64 (M, 3) each, m.
    trials
        RANSAC's most trials; it ends before when it is 99 % sure.
    threshold
        m.
    repeats
        Runs on each cloud, all with other draws.

    Returns
    -------
    list of float64 (repeats, 6)
        ms, inliers, normal and offset, for each cloud.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = pcl_program("pcl_planes", Path(folder), ("segmentation", "sample_consensus"))
        if program is None:
            return None
        rows = run_on(program, (threshold, trials, repeats), clouds)
    # Seconds, inliers, a, b, c, d with a x + b y + c z + d = 0.
    rows *= (1e3, 1.0, 1.0, 1.0, 1.0, -1.0)
    return list(rows.reshape(len(clouds), repeats, 6))


def pcl_voxels(
    clouds: Sequence[Array], leaf: float, trials: int, threshold: float = 0.01, repeats: int = 3
) -> list[Array] | None:
    """Run PCL's VoxelGrid (C++) on clouds, and its RANSAC on what is left; None without PCL.

    Parameters
    ----------
    clouds
        float64 (M, 3) each, m.
    leaf
        Edge of a voxel, m.
    trials, threshold, repeats
        As for `pcl_planes`.

    Returns
    -------
    list of float64 (repeats, 4)
        ms of VoxelGrid and of RANSAC, points that are left, inliers, for each cloud.
    """
    with tempfile.TemporaryDirectory() as folder:
        libraries = "segmentation", "sample_consensus", "filters"
        program = pcl_program("pcl_voxels", Path(folder), libraries)
        if program is None:
            return None
        rows = run_on(program, (leaf, threshold, trials, repeats), clouds)
    rows *= (1e3, 1e3, 1.0, 1.0)
    return list(rows.reshape(len(clouds), repeats, 4))


def pcl_program(name: str, folder: Path, libraries: Sequence[str]) -> Path | None:
    """Compile a program of `peers` against PCL into a folder; None without compiler or PCL."""
    compiler, config = shutil.which("g++"), shutil.which("pkg-config")
    names = sorted(Path("/usr/include").glob("pcl-*"))
    if compiler is None or not names:
        return None
    eigen = "-I/usr/include/eigen3"
    if config is not None:
        found = subprocess.run([config, "--cflags", "eigen3"], capture_output=True, text=True)
        eigen = found.stdout.strip() or eigen
    program = folder / name
    subprocess.run(
        [compiler, "-O3", "-DNDEBUG", "-std=c++17", f"-I{names[-1]}", *eigen.split(),
         str(PEERS / f"{name}.cpp"), "-o", str(program),
         *(f"-lpcl_{library}" for library in (*libraries, "search", "common"))],
        check=True,
    )  # fmt: skip
    return program


def run_on(program: Path, arguments: Sequence[float], clouds: Sequence[Array]) -> Array:
    """Return the numbers that a program prints for some clouds, line by line."""
    files = []
    for i, cloud in enumerate(clouds):
        files.append(program.parent / f"{i}.bin")
        files[-1].write_bytes(cloud.astype("<f4").tobytes())
    command = [str(program), *map(str, arguments), *map(str, files)]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return np.array([line.split() for line in out.splitlines()], float)
