"""Real tables and what stands on them against labels, and objects against PCL's Euclidean clusters.

Usage: python bench/bench_objects.py [FOLDER]

FOLDER holds labelled scenes of a structured-light camera, one .npz each: points float32 (N, 3), m,
in any frame, and label uint8 (N,): 1 to 9 the top of the table, 20 to 29 the first object, 30 to 39
the second, and so on. Each scene is turned so that its top is level. PCL is told the true top and
gets the points above it; ours gets all points.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "test" / "helpers")]

from plane_scenes import pcl_program, run_on  # noqa: E402

from tccm_ros.config import Config  # noqa: E402
from tccm_ros.cuboids.part_map import PartMapBuilder  # noqa: E402
from tccm_ros.planes import find_planes  # noqa: E402
from tccm_ros.planes.tracking import PlaneTracker  # noqa: E402
from tccm_ros.records import PlaneKind, PlaneRecord, TabletopObject  # noqa: E402
from tccm_ros.tabletop.objects import find_objects  # noqa: E402

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

TOP, FIRST_OBJECT, PER_OBJECT = 9, 20, 10
"""Labels: up to `TOP` is the table, then so many for each object."""

TOP_HEIGHT = 0.74
"""Height of each top over the floor, m; chosen."""

MIN_POINTS = 500
"""An object of fewer labelled points is not counted: most of it was hidden."""

WHOLE = 0.8
"""An object is found whole if one found object has this fraction of its points, and this fraction
of what that one has is of it."""

MARGIN = 0.01
"""Points so far outside of a box still belong to it, m: the noise of the camera."""

CLUSTER_DISTANCES = (0.05, 0.03)
"""Of `objects.cluster_distance`, m: the default, which sparse scan lines need, and a finer one."""

ON_PLANE, HULL_MARGIN = 0.010, 0.02
"""A point of the top is on a plane so near to it, and excess counts so far from the hull, m."""

TOLERANCES = (0.02, 0.05)
"""Of PCL, m: that of its tutorial, and that of `objects.cluster_distance`."""


@dataclass
class Tally:
    """How labelled objects were found.

    Attributes
    ----------
    labelled, whole, merged, split, missed
        Objects by the labels: all of them; found whole; most of it in one with another object; no
        found object has most of it; nothing of it found.
    extra
        Found objects that are no labelled object's best.
    ms
        Processor time of each scene.
    """

    labelled: int = 0
    whole: int = 0
    merged: int = 0
    split: int = 0
    missed: int = 0
    extra: int = 0
    ms: list[float] = field(default_factory=list)

    def add(self, label: Labels, found: Labels) -> None:
        """Add a scene.

        Parameters
        ----------
        label
            int64 (N,), the object of each point above the top.
        found
            int64 (N,), the found object of each, -1 for none.
        """
        used = set()
        for item in np.unique(label):
            own = found[label == item]
            if len(own) < MIN_POINTS:
                continue
            self.labelled += 1
            ids, counts = np.unique(own[own >= 0], return_counts=True)
            if not len(ids):
                self.missed += 1
                continue
            best, count = ids[counts.argmax()], counts.max()
            used.add(int(best))
            if count < WHOLE * len(own):
                self.split += 1
            elif count < WHOLE * np.count_nonzero(found == best):
                self.merged += 1
            else:
                self.whole += 1
        self.extra += len({*found[found >= 0].tolist()} - used)

    def row(self) -> str:
        """Return the cells of the table."""
        times = f"{np.median(self.ms):.0f}" if self.ms else ""
        cells = self.labelled, self.whole, self.merged, self.split, self.missed, self.extra, times
        return " | ".join(map(str, cells))


def levelled(points: Array, label: Labels) -> tuple[Array, Array]:
    """Return the points with the labelled top level at `TOP_HEIGHT`, and where the camera is.

    The camera is the origin of the points.
    """
    top = points[label <= TOP]
    _, _, axes = np.linalg.svd(top - top.mean(axis=0), full_matrices=False)
    if np.mean((points[label > TOP] - top.mean(axis=0)) @ axes[2]) < 0.0:
        axes[2] *= -1.0
    axes[0] = np.cross(axes[1], axes[2])
    out: Array = (np.vstack([points, np.zeros(3)]) - top.mean(axis=0)) @ axes.T
    out[:, 2] += TOP_HEIGHT
    return out[:-1], out[-1]


def our_view(
    points: Array, viewpoint: Array, cluster_distance: float
) -> tuple[list[PlaneRecord], list[TabletopObject], float]:
    """Return planes and objects of one view, and the processor time of map, planes, objects, ms."""
    config = Config()
    group = config.objects.model_copy(update={"cluster_distance": cluster_distance})
    config = config.model_copy(update={"objects": group})
    start = time.process_time()
    builder = PartMapBuilder(config)
    builder.add_points(points)
    cuboids = builder.close(0, 0, 1).cuboids()
    fits = find_planes(cuboids, config, viewpoint)
    planes = PlaneTracker(config).update(fits)
    found = find_objects(cuboids, fits, planes, config)
    return planes, found, 1e3 * (time.process_time() - start)


def top_row(top: Array, hull: shapely.Geometry, planes: list[PlaneRecord]) -> str:
    """Return cover, excess and height error of the plane that holds most of a labelled top.

    Parameters
    ----------
    top
        float64 (N, 3), the labelled points.
    hull
        Convex hull of the top and of what stands on it, seen from above.
    planes
        All planes of the view.
    """
    best = (0.0, 0.0, np.nan)
    for plane in planes:
        if plane.kind != PlaneKind.HORIZONTAL or len(plane.boundary) < 3:
            continue
        outline = Polygon(plane.boundary[:, :2], [hole[:, :2] for hole in plane.holes])
        shape = shapely.make_valid(outline)
        off = plane.offset - top @ plane.normal
        inside = shapely.contains_xy(shape, top[:, 0], top[:, 1]) & (np.abs(off) <= ON_PLANE)
        if inside.mean() > best[0]:
            excess = shape.difference(hull.buffer(HULL_MARGIN)).area / shape.area
            best = float(inside.mean()), float(excess), 1e3 * float(np.median(off[inside]))
    return f"{best[0]:.1%} | {best[1]:.1%} | {best[2]:+.1f}"


def in_boxes(points: Array, objects: list[TabletopObject]) -> Labels:
    """Return the index of the box that each point is in, -1 for none."""
    found = np.full(len(points), -1, np.int64)
    for k, item in enumerate(objects):
        c, s = np.cos(item.yaw), np.sin(item.yaw)
        local = (points - item.center) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        found[np.all(np.abs(local) <= 0.5 * item.size + MARGIN, axis=1)] = k
    return found


def pcl_clusters(clouds: list[Array], tolerance: float) -> list[tuple[Labels, float]] | None:
    """Return the cluster of each point of each cloud, and the time, ms; None without PCL."""
    with tempfile.TemporaryDirectory() as folder:
        libraries = ("segmentation", "filters", "sample_consensus", "kdtree")
        program = pcl_program("pcl_clusters", Path(folder), libraries)
        if program is None:
            return None
        rows = run_on(program, (tolerance, 100), clouds)[:, 0]
    found, at = [], 0
    for cloud in clouds:
        end = at + len(cloud)
        found.append((rows[at:end].astype(np.int64), 1e-3 * float(rows[end + 1])))
        at = end + 2
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    shared = Path(os.environ.get("TCCM_SHARED", HERE.parents[1] / "shared"))
    parser.add_argument("folder", type=Path, nargs="?", default=shared / "data" / "tables")
    folder = parser.parse_args().folder
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        print(f"skipped, there are no scenes in {folder}")
        return
    ours = {distance: Tally() for distance in CLUSTER_DISTANCES}
    above, labels = [], []
    print("| scene | cover of the top | excess | height, mm |")
    print("|---" * 4 + "|")
    for path in paths:
        scene = np.load(path)
        label = scene["label"].astype(np.int64)
        points, viewpoint = levelled(scene["points"].astype(np.float64), label)
        on = (label >= FIRST_OBJECT) & (points[:, 2] >= TOP_HEIGHT + Config().objects.min_height)
        above.append(points[on])
        labels.append(label[on] // PER_OBJECT)
        for distance, tally in ours.items():
            planes, objects, ms = our_view(points, viewpoint, distance)
            tally.add(labels[-1], in_boxes(above[-1], objects))
            tally.ms.append(ms)
        hull = shapely.MultiPoint(points[:, :2]).convex_hull
        print(f"| {path.stem} | {top_row(points[label <= TOP], hull, planes)} |", flush=True)
    print("\n| method | objects | whole | merged | split | missed | further | median ms |")
    print("|---" * 8 + "|")
    for distance, tally in ours.items():
        print(f"| ours, {1e3 * distance:.0f} mm | {tally.row()} |", flush=True)
    for tolerance in TOLERANCES:
        clusters = pcl_clusters(above, tolerance)
        if clusters is None:
            print("PCL is not installed: no comparison")
            return
        tally = Tally(ms=[ms for _, ms in clusters])
        for label, (found, _) in zip(labels, clusters):
            tally.add(label, found)
        print(f"| PCL, {1e3 * tolerance:.0f} mm | {tally.row()} |")


if __name__ == "__main__":
    main()
