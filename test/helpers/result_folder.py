"""A result folder of a flat, written without a replay: two rooms, a kitchen, ten surfaces.

With it tests of the report need neither a bag nor the processors.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import shapely

from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.geometry import spatial
from tccm_ros.racks.compartment import FaceState
from tccm_ros.records import Wall
from tccm_ros.results.cycles_file import CycleHistory, save_cycles
from tccm_ros.results.models import (
    CompartmentEntry,
    CountsEntry,
    CycleEntry,
    FreePlacesEntry,
    GraphFile,
    KeyframeEntry,
    LabelEntry,
    LabelsFile,
    LoopEntry,
    ObjectEntry,
    ObjectsFile,
    OpenPartEntry,
    PlacementsEntry,
    PlaneEntry,
    PlanesFile,
    RacksFile,
    ScansUsedEntry,
    SessionEntry,
    SessionKind,
    SignEntry,
    SignsFile,
    SignViewEntry,
    SummaryFile,
    SurfaceEntry,
    SurfacesFile,
    TimingFile,
    ViewEntry,
    WallsFile,
)
from tccm_ros.results.numbers import key_of
from tccm_ros.results.trajectory import Trajectory
from tccm_ros.tabletop.placements import Placement

UP = np.array([0.0, 0.0, 1.0])
CYCLES = 24
FLOOR_Z = -0.02


def box(x0, y0, x1, y1, angle=0.0):
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)
    middle = corners.mean(axis=0)
    c, s = np.cos(angle), np.sin(angle)
    return (corners - middle) @ np.array([[c, s], [-s, c]]) + middle


COUNTER = np.array([[0.0, 3.4], [0.0, 1.6], [0.6, 1.6], [0.6, 2.8], [2.6, 2.8], [2.6, 3.4]])
FURNITURE = [
    # label, height above the floor, outline, holes, stamps of the views
    ("floor", 0.0, box(-0.1, -2.1, 7.1, 3.5), [], [2.0, 30.0, 60.0]),
    ("counter", 0.90, COUNTER, [box(1.4, 2.95, 1.7, 3.25)[::-1]], [6.0, 12.0]),
    ("counter", 0.95, box(0.05, 1.7, 0.55, 2.3), [], [6.0]),
    ("table", 0.74, box(1.6, 0.2, 3.0, 1.1, 0.2), [], [8.0, 20.0, 52.0]),
    ("shelf", 0.35, box(6.6, -1.8, 7.0, -0.6), [], [36.0]),
    ("shelf", 0.75, box(6.6, -1.8, 7.0, -0.6), [], [36.0, 40.0]),
    ("shelf", 1.15, box(6.6, -1.8, 7.0, -0.6), [], [36.0]),
    ("seat", 0.44, box(4.6, 2.5, 6.6, 3.3), [], [28.0]),
    ("table", 0.42, box(5.1, 1.2, 6.2, 1.8), [], [28.0, 32.0]),
    ("ledge", 1.02, box(3.0, 3.28, 4.0, 3.42), [], [26.0]),
    ("bed", 0.55, box(0.1, -2.0, 2.1, -0.7), [], [48.0]),
]
WALLS = [
    ((0.0, -2.1), (0.0, 3.5)),
    ((0.0, 3.5), (7.1, 3.5)),
    ((7.1, 3.5), (7.1, -2.1)),
    ((7.1, -2.1), (0.0, -2.1)),
    ((0.0, -0.35), (2.6, -0.35)),
    ((3.9, -2.1), (3.9, 0.6)),
]


def area(ring):
    x, y = ring[:, 0], ring[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def horizontal_ring(ring, z):
    ring = ring if area(ring) > 0 else ring[::-1]
    return np.column_stack([ring, np.full(len(ring), z)])


def surface(index, label, height, outline, holes, stamps):
    z = height + FLOOR_Z
    size = abs(area(outline)) - sum(abs(area(h)) for h in holes)
    views = tuple(ViewEntry(stamp, int(stamp), 900) for stamp in stamps)
    return SurfaceEntry(
        id=index, label=label, confidence=0.9, height=z, normal=UP, offset=z, area=size,
        centroid=np.append(outline.mean(axis=0), z), boundary=horizontal_ring(outline, z),
        holes=tuple(horizontal_ring(h, z)[::-1] for h in holes), points=int(size * 9000),
        height_std=0.0012, first_seen=stamps[0], last_seen=stamps[-1], views=views,
    )  # fmt: skip


def driven_path():
    """Return the poses of the robot, (61, 4) of stamp, x, y, yaw; s, m and rad."""
    corners = np.array(
        [[0.8, 0.9], [1.2, 2.2], [3.2, 2.2], [4.2, 1.6], [4.6, 0.6], [5.9, 0.2], [5.6, -1.2],
         [4.6, -0.6], [4.4, 0.9], [3.2, -0.9], [2.6, -1.3], [3.3, -0.2], [1.0, 0.4]]
    )  # fmt: skip
    steps = np.linspace(0, len(corners) - 1, 61)
    xy = np.stack([np.interp(steps, np.arange(len(corners)), corners[:, i]) for i in (0, 1)], 1)
    heading = np.gradient(xy, axis=0)
    return np.column_stack([np.arange(61.0), xy, np.arctan2(heading[:, 1], heading[:, 0])])


def furniture_cuboids(center, max_range, rng):
    """Return tops of furniture and walls within a range of a point as cuboids of 2 cm cells."""
    cells = []
    for label, height, outline, holes, _ in FURNITURE:
        low, high = outline.min(axis=0), outline.max(axis=0)
        step = 0.06 if label == "floor" else 0.02
        x, y = (np.arange(low[i], high[i], step) for i in (0, 1))
        grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
        grid = grid[shapely.contains_xy(shapely.Polygon(outline, holes), *grid.T)]
        cells.append(np.column_stack([grid, np.full(len(grid), height + FLOOR_Z)]))
    for (x0, y0), (x1, y1) in WALLS:
        along = np.linspace(0, 1, int(np.hypot(x1 - x0, y1 - y0) / 0.02))
        for z in np.arange(0.1, 1.4, 0.1):
            cells.append(np.column_stack([x0 + along * (x1 - x0), y0 + along * (y1 - y0),
                                          np.full(len(along), z)]))  # fmt: skip
    points = np.concatenate(cells)
    points = points[np.hypot(*(points[:, :2] - center).T) < max_range]
    top = np.rint((points[:, 2] + rng.normal(0, 0.002, len(points))) * 1e4).astype(np.int32)
    ix, iy = (np.floor(points[:, i] / 0.02).astype(np.int32) for i in (0, 1))
    order = np.lexsort((top, iy, ix))
    return as_cuboids(ix[order], iy[order], top[order] - 300, top[order])


def as_cuboids(ix, iy, bottom, top):
    n = len(ix)
    s = np.column_stack([np.full(n, 100.0), np.full(n, 100.0), top]) * 4.0
    p = s / 4.0
    spread = np.array([2500.0, 0, 0, 900.0, 0, 40.0])
    outer = np.stack([p[:, i] * p[:, j] for i in range(3) for j in range(i, 3)], 1)
    return Cuboids(
        0.02, ix, iy, bottom, top, np.full(n, 4.0), s, (outer + spread) * 4.0,
        np.zeros(n, np.int32), np.arange(n + 1),
    )  # fmt: skip


def write_json(path, model):
    """Write a model with all digits, so that a reader gets the exact values."""
    path.write_text(json.dumps(model, default=plain, indent=1), encoding="utf-8")


def plain(value):
    if isinstance(value, np.ndarray):
        return value.tolist()
    return {key_of(field.name): getattr(value, field.name) for field in fields(value)}


def write_folder(folder: Path, *, cycles: int = CYCLES, max_range: float = 1.6) -> Path:
    """Write a result folder with all files; every call writes equal bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    surfaces = tuple(surface(i, *item) for i, item in enumerate(FURNITURE))
    write_json(folder / "surfaces.json", SurfacesFile(floor_z=FLOOR_Z, surfaces=surfaces))
    walls = tuple(wall(i, *np.array(w)) for i, w in enumerate(WALLS))
    write_json(folder / "walls.json", WallsFile(walls))
    path = driven_path()
    (folder / "trajectory.tum").write_text(trajectory(path).tum())
    keyframes = tuple(KeyframeEntry(i, t, p[:3]) for i, (t, *p) in enumerate(path.tolist()))
    closed = LoopEntry(2, 60, np.zeros(3), True, "")
    rejected = LoopEntry(7, 30, np.zeros(3), False, "ambiguous")
    write_json(folder / "graph.json", GraphFile(keyframes, (closed, rejected)))
    views = tuple(SignViewEntry(path[k, 0], k, np.array([480.0, 200.0 + k])) for k in (4, 5))
    plate = np.array([*np.mean(WALLS[0], axis=0), 1.5 + FLOOR_Z])
    sign = SignEntry(
        0, "205 Office", "205", 0.9, plate, np.array([0.0, 1.0, 0.0]), np.eye(3) * 1e-4, 0, views
    )
    write_json(folder / "signs.json", SignsFile((sign,)))
    mug = ObjectEntry(0, 3, np.array([2.2, 0.7, 0.78]), np.array([0.08, 0.08, 0.12]), 0.0)
    tray = ObjectEntry(1, 1, np.array([2.2, 3.1, 0.9]), np.array([0.4, 0.25, 0.05]), 0.3)
    bin_ = ObjectEntry(2, 0, np.array([4.4, -1.8, 0.2]), np.array([0.4, 0.3, 0.4]), 0.0)
    free = FreePlacesEntry(3, (horizontal_ring(box(1.8, 0.35, 2.1, 0.6), 0.72),))
    place = Placement(3, np.array([1.95, 0.47, 0.72]), 0.0, 0.05, np.inf)
    placements = PlacementsEntry(np.array([0.15, 0.15, 0.2]), 0.02, (place,))
    write_json(folder / "objects.json", ObjectsFile((mug, tray, bin_), (free,), placements))
    front = np.array([[2.3, 0.35, 0.72], [1.8, 0.35, 0.72]])
    space = CompartmentEntry(
        3, 3, None, front, np.array([0.0, 1.0, 0.0]), 0.5, 0.3, 0.35, FaceState.MEASURED,
        FaceState.OPEN, FaceState.UNKNOWN, FaceState.MEASURED, 0.9,
        (OpenPartEntry(front[0], np.array([0.25, 0.02, 0.3]), 1.2),),
    )  # fmt: skip
    write_json(folder / "racks.json", RacksFile((space,)))
    write_json(folder / "labels.json", LabelsFile(labels=(LabelEntry(3, "table"),)))
    write_cycles_and_cuboids(folder, path, cycles, max_range)
    write_json(folder / "summary.json", summary(cycles))
    write_json(folder / "timing.json", TimingFile({"reading": 0.21, "mapping": 0.94}, 52.2))
    return folder


def wall(index, start, end):
    (x0, y0), (x1, y1) = start, end
    phi = float(np.arctan2(x1 - x0, -(y1 - y0)))
    rho = float(x0 * np.cos(phi) + y0 * np.sin(phi))
    if rho < 0:
        phi, rho = phi - np.pi if phi > 0 else phi + np.pi, -rho
    return Wall(index, phi, rho, np.stack([start, end]), 40, np.diag([1e-6, 1e-5]))


def trajectory(path):
    return Trajectory((path[:, 0] * 1e9).astype(np.int64), spatial(path[:, 1:]))


def write_cycles_and_cuboids(folder, path, cycles, max_range):
    rng = np.random.default_rng(7)
    history = CycleHistory(window=10)
    plane_cycles = []
    stamps = np.linspace(2.0, 58.0, cycles)
    newest = None
    for cycle, stamp in enumerate(stamps):
        center = path[int(stamp), 1:3]
        newest = furniture_cuboids(center, max_range, rng)
        history.add(cycle, int(stamp * 1e9), newest)
        planes = tuple(planes_near(center, max_range))
        plane_cycles.append(CycleEntry(cycle, float(stamp), "odom", planes))
    T_map_odom = np.tile(np.eye(4), (cycles, 1, 1))
    T_map_odom[:, 0, 3] = np.linspace(0.0, 0.03, cycles)
    save_cycles(folder / "cycles.npz", history.parts(T_map_odom))
    write_json(folder / "planes.json", PlanesFile(tuple(plane_cycles)))
    final = furniture_cuboids(path[30, 1:3], 2.5, rng)
    n = len(final)
    np.savez_compressed(
        folder / "cuboids.npz", ix=final.ix, iy=final.iy, top=final.top * 1e-4,
        bottom=final.bottom * 1e-4, count=final.count, cls=np.full(n, -1), mean=final.mean(),
        cov=final.cov(), cycles=(np.arange(n) % 10 + cycles - 10).astype(np.int32),
        cycle_offsets=np.arange(n + 1), cell_size=0.02, frame_id="odom",
    )  # fmt: skip


def planes_near(center, max_range):
    for index, (label, height, outline, holes, _) in enumerate(FURNITURE):
        middle = outline.mean(axis=0)
        if label != "floor" and np.hypot(*(middle - center)) < max_range:
            item = surface(index, label, height, outline, holes, [0.0])
            yield PlaneEntry(
                index, "horizontal", UP, item.offset, np.eye(3), item.points, item.area, 0.2,
                item.boundary, item.holes, 0.0021,
            )  # fmt: skip
    front = [[center[0] + x, center[1], z] for x, z in ((-1, 0), (1, 0), (1, 2.2), (-1, 2.2))]
    yield PlaneEntry(
        90, "any", np.array([0.0, -1.0, 0.0]), -center[1], np.eye(3), 800, 4.4, 0.2,
        np.array(front), (), 0.003,
    )  # fmt: skip


def summary(cycles):
    counts = CountsEntry(
        messages={"/tilt_scan": 4120}, scans_used=ScansUsedEntry(tilt=1810, level=0),
        dropped={"no bracketing joint sample": 3}, cycles=cycles, planes=12, keyframes=61,
        walls=len(WALLS), loops_accepted=1, loops_rejected=1, surfaces=10, small_surfaces=0,
        objects=3,
    )  # fmt: skip
    session = SessionEntry(SessionKind.FIRST)
    config = Config().model_dump(mode="json")
    return SummaryFile({"tccm_ros": "0.1.0"}, 60.0, session, counts, config)
