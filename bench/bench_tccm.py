"""The TCCM against its peers, as ratios in one run: docs/design/experiments/tccm.md.

Single thread, medians of CPU time, warm caches; what is compared takes turns. The rig is the
paper's: a laser at 1.52 m, 240 deg, 569 beams, 28 ms a scan, 40 scans a tilt cycle, tilt 5 to 65
deg down; situation A (a table) in a closed room, so that every beam returns. Times are of this
machine; what counts are the ratios.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "bench"), str(ROOT / "test" / "helpers")]

from situation_cycle import cycle as situation  # noqa: E402
from tccm_peers import Twin, compiled, find_octomap, numpy_part  # noqa: E402

from tccm_ros.config import Config  # noqa: E402
from tccm_ros.cuboids import binning, union  # noqa: E402
from tccm_ros.cuboids.integration_map import IntegrationMap  # noqa: E402
from tccm_ros.cuboids.part_map import PartMapBuilder  # noqa: E402
from tccm_ros.records import PosedScan, Scan  # noqa: E402

REGION = (0.2, 1.5, -0.9, 0.9, 0.1, 1.45)
"""What the arms reach, m."""

POSE_SAMPLES = 4
"""Poses per scan: every 10 ms."""

NO_OCTOMAP = "OctoMap: liboctomap-dev or pyoctomap"

WINDOW = 10
CELLS = (0.01, 0.02, 0.03, 0.04)
SCANS = (10, 20, 30, 40, 60, 80)


BATCH, WARM = 10, 3
"""Calls of one kind that follow each other, after some that are not counted."""

Call = Callable[[], object]


def median_ms(call: Call, repeats: int, before: Call | None = None) -> float:
    """Return the median CPU time of a call, ms; `before` is run before each and not timed."""
    return alternating_ms(repeats, (call, before))[0]


def alternating_ms(repeats: int, *calls: tuple[Call, Call | None]) -> list[float]:
    """Return the median CPU times of calls, ms, each with what is run before it and not timed.

    The calls take turns, `BATCH` times each, so that all of them meet the same load of the machine
    and each finds its own data in the caches.
    """
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(-(-repeats // BATCH)):
        for (call, before), own in zip(calls, times, strict=True):
            for i in range(-WARM if repeats >= BATCH else 0, min(BATCH, repeats)):
                if before is not None:
                    before()
                start = time.thread_time()
                call()
                if i >= 0:
                    own.append(time.thread_time() - start)
    return [1e3 * statistics.median(own) for own in times]


@dataclass(frozen=True)
class SimulatedCycle:
    """One simulated tilt cycle, as scans and as points."""

    ranges: NDArray[np.float32]
    bearings: NDArray[np.float64]
    tilts: NDArray[np.float64]
    times: NDArray[np.float64]
    xyz: NDArray[np.float64]
    height: float
    pose_samples: int = POSE_SAMPLES

    @property
    def step(self) -> float:
        """Angle between beams, rad."""
        return float(self.bearings[1] - self.bearings[0])

    @cached_property
    def scans(self) -> list[tuple[PosedScan, NDArray[np.bool_]]]:
        """The scans with their poses, and their valid beams."""
        increment = float(self.times[0, 1] - self.times[0, 0])
        result = []
        for ranges, times, tilts in zip(self.ranges, self.times, self.tilts, strict=True):
            at = np.linspace(0, len(ranges) - 1, self.pose_samples)
            angles = np.interp(at, np.arange(len(ranges)), tilts)
            c, s, one = np.cos(angles), np.sin(angles), np.ones_like(angles)
            T = np.zeros((self.pose_samples, 4, 4))
            T[:, 0, 0], T[:, 0, 2], T[:, 1, 1] = c, s, one
            T[:, 2, 0], T[:, 2, 2], T[:, 2, 3] = -s, c, self.height
            T[:, 3, 3] = one
            stamp = round(times[0] * 1e9)
            scan = Scan(
                stamp, "laser", float(self.bearings[0]), self.step, increment, 0.02, 30.0, ranges
            )
            stamps_ns = stamp + np.rint(at * increment * 1e9).astype(np.int64)
            base = np.broadcast_to(np.eye(4), T.shape).copy()
            result.append((PosedScan(scan, stamps_ns, base, T), np.isfinite(ranges)))
        return result

    @cached_property
    def for_twin(self) -> tuple[NDArray, ...]:
        """The same as flat arrays."""
        posed = [p for p, _ in self.scans]
        bearings = self.bearings[0] + self.step * np.arange(len(self.bearings))
        times = [
            (p.pose_stamps_ns - p.scan.stamp_ns) / (p.scan.time_increment * 1e9) for p in posed
        ]
        return (
            np.ascontiguousarray(self.ranges),
            np.stack([k for _, k in self.scans]).astype(np.uint8),
            np.stack([np.cos(bearings), np.sin(bearings)]).astype(np.float32),
            np.array(times),
            np.concatenate([p.T_odom_base for p in posed]),
            np.concatenate([p.T_base_laser for p in posed]),
        )


def simulate_cycle(
    seed: int, scans: int = 40, downwards: bool = True, room: bool = True
) -> SimulatedCycle:
    """Return a tilt cycle over situation A, in a closed room or with a floor and a back wall."""
    c = situation("a", 0.0025, seed, room=room, scans=scans, downwards=downwards)
    assert np.isfinite(c.ranges).all() == room
    return SimulatedCycle(
        c.ranges.astype(np.float32), c.bearings, c.tilts, c.times, c.points, c.laser_height
    )


class Ours:
    """The package's own steps."""

    def __init__(self, config: Config) -> None:
        self.builder, self.map = PartMapBuilder(config), IntegrationMap(config)
        self.cycle = 0

    def scans(self, scene: SimulatedCycle) -> None:
        """Project and bin all scans of a tilt cycle."""
        for posed, keep in scene.scans:
            self.builder.add(posed, keep)

    def close(self):
        """Make the part map of what was binned."""
        self.cycle += 1
        return self.builder.close(self.cycle - 1, 0, 1)

    def one(self, scene: SimulatedCycle) -> None:
        """A whole cycle."""
        self.scans(scene)
        self.map.add(self.close())


def settings(**values) -> Config:
    return Config.model_validate({"map": {"window_cycles": WINDOW, **values}})


class Table:
    """Rows of a Markdown table."""

    def __init__(self, *head: str) -> None:
        print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)

    def row(self, *cells: str) -> None:
        """Print a row."""
        print("| " + " | ".join(cells) + " |", flush=True)


def ms(value: float | None) -> str:
    return "not here" if value is None else f"{value:.3f}"


def times_as_fast(ours: float, peer: float | None) -> str:
    return "-" if peer is None else f"{peer / ours:.2f} x"


def part_maps(twin_library, new_octomap, repeats: int) -> None:
    """Row: points -> part map with moments, in the closed room and without its walls."""
    for name, scene in (
        ("full room", simulate_cycle(0)),
        ("open scene", simulate_cycle(0, room=False)),
    ):
        one_scene(name, scene, twin_library, new_octomap, repeats)


def one_scene(name: str, scene: SimulatedCycle, twin_library, new_octomap, repeats: int) -> None:
    """Row: points -> part map with moments."""
    print(f"\n### Points -> part map with moments ({len(scene.xyz)} points, 20 mm, {name})\n")
    xyz, single = scene.xyz, np.ascontiguousarray(scene.xyz, np.float32)
    config = settings(gap="fixed")
    builder = PartMapBuilder(config)

    def ours():
        builder.add_points(xyz)
        return builder.close(0, 0, 1)

    part = ours()
    keys, bounds, moments = numpy_part(xyz, 200, 300)
    assert (part.keys == keys).all()
    assert (part.bounds == bounds).all()
    assert (part.moments == moments).all()
    calls: list[tuple[Call, Call | None]] = [(ours, None)]
    if twin_library is not None:
        twin = Twin(twin_library, config)

        def theirs():
            twin.points(xyz)
            return twin.part_alone()

        same = twin.read_part(theirs())
        assert all((a == b).all() for a, b in zip(same, (keys, bounds, moments), strict=True))
        calls.append((theirs, None))
    mine, *twins = alternating_ms(3 * repeats, *calls)
    table = Table("what", "ms", "peer / ours", "cuboids")
    table.row("ours (compiled Python)", ms(mine), "1", str(len(part)))
    for elapsed in twins:
        table.row(
            "C++ -O3 twin, same cuboids bit for bit",
            ms(elapsed),
            times_as_fast(mine, elapsed),
            "same",
        )
    numpys = median_ms(lambda: numpy_part(xyz, 200, 300), max(repeats // 10, 3))
    table.row(
        "numpy twin, same cuboids bit for bit", ms(numpys), times_as_fast(mine, numpys), "same"
    )
    if new_octomap is not None:
        octo = new_octomap(0.02)
        ends = median_ms(lambda: octo.endpoints(single), max(repeats // 10, 3), octo.clear)
        rays = median_ms(lambda: octo.rays(single, (0, 0, scene.height)), 2, octo.clear)
        for name, elapsed in (("endpoints", ends), ("ray cast", rays)):
            row = f"{octo.name}, {name} (no moments)"
            table.row(row, ms(elapsed), times_as_fast(mine, elapsed), "voxels")
    else:
        table.row(NO_OCTOMAP, ms(None), "-", "-")
    target = np.empty_like(xyz)
    copy = median_ms(lambda: np.copyto(target, xyz), repeats)
    table.row("copy of the points", ms(copy), times_as_fast(mine, copy), "-")


def profile(repeats: int) -> None:
    """Where the time of a part map goes, kernel by kernel."""
    scene = simulate_cycle(0)
    n = len(scene.xyz)
    print(f"\n### Profile: points -> part map ({n} points, full room, 20 mm)\n")
    builder, flat = PartMapBuilder(settings(gap="fixed")), scene.xyz.reshape(-1)
    builder.add_points(scene.xyz)
    part, tiles, work = builder.close(0, 0, 1), builder._tiles, builder._work
    s, points = builder._scratch_for(n), np.empty(2 * n, np.int64)
    cells, starts, addresses = s.cells
    ends, stamps = np.array([n], np.int32), np.zeros(1, np.int64)
    sums, seen = np.empty(10 * len(part), np.int64), np.empty(2 * len(part), np.int64)
    records, _, counts, _, _ = tiles.arrays
    found: list[int] = []

    def prepare():
        tiles.clear(listed=False)

    def bin_points():
        binning.bin_points(flat, np.zeros(0), 0, builder._settings, work, tiles.arrays)

    def list_cells():
        found[:] = [binning.list_cells(tiles.arrays, cells, starts, addresses)]

    steps: dict[str, Call] = {
        "place: ticks, cells, counting": bin_points,
        "list the cells": list_cells,
        "sort by cell": lambda: union.gather_points(records, ends, counts, points),
        "sort by height": lambda: union.sort_cells(points, starts, found[0], s.sorting),
        "mark the cells": lambda: union.mark_cells(starts, found[0], addresses, counts, s.begins),
        "unite": lambda: union.merge_intervals(points, n, s.begins, cells, found[0], s.found),
        "sum the moments": lambda: union.sum_cuboids(points, n, s.begins, stamps, sums, seen),
    }
    times: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(repeats + 3):
        prepare()
        for name, step in steps.items():
            start = time.thread_time()
            step()
            times[name].append(1e3 * (time.thread_time() - start))
    assert (sums.reshape(-1, 10) == part.moments).all()
    table = Table("step", "ms", "ns a point")
    for name, own in times.items():
        elapsed = statistics.median(own[3:])
        table.row(name, ms(elapsed), f"{1e6 * elapsed / n:.1f}")


def whole_cycles(twin_library, new_octomap, repeats: int) -> None:
    """Rows: a whole cycle, in the region of interest and in the full room."""
    print("\n### A whole cycle: project, part map, newest in, oldest out, 10 part maps, exact\n")
    scenes = [simulate_cycle(seed) for seed in range(WINDOW + 1)]
    table = Table(
        "scene, gap", "ours ms", "of it scans / close / merge", "C++ twin ms", "ours / twin",
        "reading all moments: ours, twin ms", "OctoMap rebuild ms: endpoints, rays",
        "pieces, cuboids",
    )  # fmt: skip
    for name, region in (("region of interest", REGION), ("full room", None)):
        for gap in ("fixed", "adaptive"):
            config = settings(region=region, gap=gap)
            row = one_cycle(config, scenes, twin_library, repeats)
            octo = rebuilt(scenes, region, new_octomap) if gap == "fixed" else ""
            table.row(f"{name}, {gap}", *row[:-1], octo, row[-1])


def one_cycle(
    config: Config, scenes: list[SimulatedCycle], twin_library, repeats: int
) -> list[str]:
    ours, numbers = Ours(config), iter(range(10**9))
    pick = lambda: scenes[next(numbers) % len(scenes)]  # noqa: E731
    for _ in range(2 * WINDOW):
        ours.one(pick())
    scans = median_ms(lambda: ours.scans(pick()), repeats, ours.builder.clear)
    ours.builder.clear()
    parts = []

    def close():
        # Only the last is kept, so that memory is reused as in a node.
        parts[:] = [ours.close()]

    closing = median_ms(close, repeats, lambda: ours.scans(pick()))
    del parts[:]
    merging = median_ms(
        lambda: ours.map.add(parts.pop()), repeats, lambda: (ours.scans(pick()), close())
    )

    def one():
        ours.one(pick())

    detail = f"{scans:.3f} / {closing:.3f} / {merging:.3f}"
    if twin_library is None:
        mine, reading = median_ms(one, repeats), median_ms(ours.map.cuboids, repeats, one)
        sizes = f"{len(ours.map.pieces)}, {len(ours.map.cuboids())}"
        return [ms(mine), detail, ms(None), "-", ms(reading), sizes]
    twin, twin_numbers = Twin(twin_library, config), iter(range(10**9))

    def theirs():
        twin.scans(scenes[next(twin_numbers) % len(scenes)])
        twin.close()
        return twin.merge()

    for _ in range(2 * WINDOW):
        theirs()
    mine, twins = alternating_ms(3 * repeats, (one, None), (theirs, None))
    reading, twin_reading = alternating_ms(repeats, (ours.map.cuboids, one), (twin.compose, theirs))
    sizes = f"{len(ours.map.pieces)}, {len(ours.map.cuboids())}"
    compare(config, scenes, twin_library)
    both = f"{reading:.3f}, {twin_reading:.3f}"
    return [ms(mine), detail, ms(twins), f"{mine / twins:.2f}", both, sizes]


def compare(config: Config, scenes: list[SimulatedCycle], twin_library) -> None:
    """Check that the twin's map is ours, bit for bit."""
    ours, twin = Ours(config), Twin(twin_library, config)
    for scene in scenes:
        ours.one(scene)
        twin.scans(scene)
        twin.close()
        count = twin.merge()
    keys, pieces = twin.read_pieces(count)
    assert (keys == ours.map.keys).all()
    assert (pieces == ours.map.pieces).all()
    moments, c = twin.read_composites(twin.compose()), ours.map.cuboids()
    assert (moments == np.column_stack([c.count, c.s, c.S])).all()


def rebuilt(scenes: list[SimulatedCycle], region, new_octomap) -> str:
    """Return OctoMap's time to rebuild its map of the window, as it cannot forget."""
    if new_octomap is None:
        return ms(None)
    octo, clouds = new_octomap(0.02), []
    for scene in scenes[:WINDOW]:
        p = scene.xyz
        if region is not None:
            low, high = np.array(region[::2]), np.array(region[1::2])
            p = p[((p >= low) & (p <= high)).all(axis=1)]
        clouds.append(np.ascontiguousarray(p, np.float32))
    ends = median_ms(lambda: [octo.endpoints(c) for c in clouds], 3, octo.clear)
    rays = median_ms(lambda: [octo.rays(c, (0, 0, 1.52)) for c in clouds], 1, octo.clear)
    return f"{ends:.1f}, {rays:.0f}"


def point_order(repeats: int) -> None:
    """Row: tilt direction, point order."""
    print("\n### Tilt direction and point order (points -> part map, 20 mm, full room)\n")
    down, up = simulate_cycle(0).xyz, simulate_cycle(0, downwards=False).xyz
    shuffled = np.random.default_rng(0).permutation(down)
    table = Table(
        "order",
        "ms fixed gap",
        "against the first",
        "ms whole tilt cycle, adaptive",
        "against the first",
    )
    names = ("tilting down", "tilting up", "beams backwards", "random")
    builder, ours = PartMapBuilder(settings(gap="fixed")), Ours(settings())

    def part_of(points):
        return lambda: (builder.add_points(points), builder.close(0, 0, 1)), None

    def cloud_of_scene(scene):
        return lambda: (ours.scans(scene), ours.close()), None

    clouds = down, up, np.ascontiguousarray(down[::-1]), shuffled
    elapsed = alternating_ms(3 * repeats, *map(part_of, clouds))
    whole = alternating_ms(
        3 * repeats,
        cloud_of_scene(simulate_cycle(0)),
        cloud_of_scene(simulate_cycle(0, downwards=False)),
    )
    for i, name in enumerate(names):
        cells = [ms(elapsed[i]), f"{100 * (elapsed[i] / elapsed[0] - 1):+.0f} %", "-", "-"]
        if i < len(whole):
            cells[2:] = ms(whole[i]), f"{100 * (whole[i] / whole[0] - 1):+.0f} %"
        table.row(name, *cells)


def memory(new_octomap) -> None:
    """Row: geometry memory."""
    print("\n### Memory (10 tilt cycles of the full room, 20 mm)\n")
    scenes = [simulate_cycle(seed) for seed in range(WINDOW)]
    table = Table("what", "kB", "against OctoMap endpoints")
    base = None
    if new_octomap is not None:
        for name, rays in (("endpoints", False), ("ray cast", True)):
            octo = new_octomap(0.02)
            for scene in scenes[: 1 if rays else WINDOW]:
                points = np.ascontiguousarray(scene.xyz, np.float32)
                if rays:
                    octo.rays(points, (0, 0, scene.height))
                else:
                    octo.endpoints(points)
            size = octo.memory()
            base = base or size
            table.row(f"{octo.name}, {name}", f"{size / 1e3:.0f}", f"1/{base / size:.1f}")
    for gap in ("adaptive", "fixed"):
        ours = Ours(settings(gap=gap))
        for scene in scenes:
            ours.one(scene)
        c, parts = ours.map.cuboids(), ours.map.parts
        newest = parts[-1]
        sizes = {
            "one part map, geometry": newest.cuboids().columns().nbytes,
            "integration map, geometry (12 bytes a cell, 8 a cuboid)": c.columns().nbytes,
            "the same with moments": c.columns().nbytes + 80 * len(c),
            "all it is made of: pieces and ten part maps with moments and times": (
                ours.map.keys.nbytes + ours.map.pieces.nbytes
                + sum(a.nbytes for p in parts for a in (p.keys, p.bounds, p.moments, p.seen_ns))
            ),
        }  # fmt: skip
        for name, size in sizes.items():
            table.row(
                f"ours, {gap} gap: {name}",
                f"{size / 1e3:.0f}",
                "-" if base is None else f"1/{base / size:.1f}",
            )


def ghosts(new_octomap) -> None:
    """Row: what stays of a box that has left."""
    print("\n### Ghosts: a box 0.3 m wide stands on the table for 10 cycles and leaves\n")
    box = (0.75, 1.05, -0.15, 0.15, 0.72, 1.05)
    with_box, without = [], []
    for seed in range(WINDOW):
        scene = simulate_cycle(seed)
        without.append(scene.xyz)
        with_box.append(put_box(scene, box))
    config = settings(gap="fixed")
    builder, map_, left = PartMapBuilder(config), IntegrationMap(config), []
    for cycle, points in enumerate(with_box + without):
        builder.add_points(points)
        map_.add(builder.close(cycle, 0, 1))
        left.append(inside(map_.cuboids().mean(), box))
    table = Table("map", "elements of the box before it leaves", "10 cycles later", "stays")
    table.row(
        "ours", str(left[WINDOW - 1]), str(left[-1]), f"{100 * left[-1] / left[WINDOW - 1]:.0f} %"
    )
    if new_octomap is None:
        table.row(NO_OCTOMAP, ms(None), "-", "-")
        return
    wider = np.array(box) + np.array((-0.02, 0.02, -0.02, 0.02, 0.0, 0.02))
    for name, rays in (("endpoints", False), ("ray cast", True)):
        octo, counts = new_octomap(0.02), []
        for clouds in (with_box, without):
            for points in clouds:
                single = np.ascontiguousarray(points, np.float32)
                if rays:
                    octo.rays(single, (0, 0, 1.52))
                else:
                    octo.endpoints(single)
            counts.append(octo.occupied(wider))
        table.row(f"{octo.name}, {name}", *map(str, counts), f"{100 * counts[1] / counts[0]:.0f} %")


def inside(points, box) -> int:
    # Its faces with their noise, but not the table that it stands on.
    low = np.array(box[::2]) - (0.02, 0.02, 0.0)
    high = np.array(box[1::2]) + 0.02
    return int(((points > low) & (points < high)).all(axis=1).sum())


def put_box(scene: SimulatedCycle, box) -> NDArray[np.float64]:
    """Return the points with a box in the way (slab test)."""
    origin = np.array([0.0, 0.0, scene.height])
    direction = scene.xyz - origin
    with np.errstate(divide="ignore"):
        a = (np.array(box[::2]) - origin) / direction
        b = (np.array(box[1::2]) - origin) / direction
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    hit = (near <= far) & (near > 0) & (near < 1)
    return np.where(hit[:, None], origin + near[:, None] * direction, scene.xyz)


def figure_8(twin_library, repeats: int, image: Path | None) -> None:
    """Time against number of scans, per cell size, and compression."""
    print("\n### Fig. 8: cell size x scans a tilt cycle (full room, adaptive gap)\n")
    table = Table(
        "cell", "scans", "part map ms", "whole cycle ms", "C++ twin ms", "cuboids of a part map",
        "points per cuboid", "cuboids of the map", "beams inserted per cuboid",
    )  # fmt: skip
    curves: dict[float, list[float]] = {}
    for scans in SCANS:
        scenes = [simulate_cycle(seed, scans) for seed in range(WINDOW + 1)]
        for cell in CELLS:
            config = settings(cell_size=cell)
            ours, numbers = Ours(config), iter(range(10**9))
            pick = lambda: scenes[next(numbers) % len(scenes)]  # noqa: B023, E731
            for _ in range(WINDOW + 2):
                ours.one(pick())
            part = median_ms(lambda: (ours.scans(pick()), ours.close()), repeats)  # noqa: B023
            calls: list[tuple[Call, Call | None]] = [(lambda: ours.one(pick()), None)]  # noqa: B023
            if twin_library is not None:
                twin = Twin(twin_library, config)
                step = lambda: (twin.scans(pick()), twin.close(), twin.merge())  # noqa: B023, E731
                for _ in range(WINDOW + 2):
                    step()
                calls.append((step, None))
            cycle, *twins = alternating_ms(repeats, *calls)
            newest, c = ours.map.parts[-1], ours.map.cuboids()
            points = int(newest.moments[:, 0].sum())
            curves.setdefault(cell, []).append(cycle)
            table.row(
                f"{1e3 * cell:.0f} mm", str(scans), ms(part), ms(cycle),
                ms(twins[0] if twins else None), str(len(newest)),
                f"{points / len(newest):.1f}", str(len(c)), f"{points * WINDOW / len(c):.1f}",
            )  # fmt: skip
    if image is not None:
        plot(curves, image)


def plot(curves: dict[float, list[float]], image: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for cell, times in curves.items():
        axes.plot(SCANS, times, marker="o", label=f"{1e3 * cell:.0f} mm")
    axes.set(
        xlabel="scans a tilt cycle (569 beams each)", ylabel="whole cycle, ms", ylim=(0, None),
        title="Project, part map, newest in, oldest out of ten (full room)",
    )  # fmt: skip
    axes.grid(alpha=0.3)
    axes.legend(title="cell")
    image.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(image, dpi=110, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=60, help="measurements per figure")
    parser.add_argument("--plot", type=Path, help="write Fig. 8 as a picture")
    parser.add_argument(
        "--only", choices=["part", "profile", "cycle", "order", "memory", "ghosts", "fig8"]
    )
    parser.add_argument(
        "--octomap", choices=["c++", "python"], help="which OctoMap; the first that is there"
    )
    options = parser.parse_args()
    twin = compiled("tccm_twin", "-ffp-contract=off")
    octo = find_octomap(options.octomap)
    sections: dict[str, Callable[[], None]] = {
        "part": lambda: part_maps(twin, octo, options.repeats),
        "profile": lambda: profile(options.repeats),
        "cycle": lambda: whole_cycles(twin, octo, options.repeats),
        "order": lambda: point_order(options.repeats),
        "memory": lambda: memory(octo),
        "ghosts": lambda: ghosts(octo),
        "fig8": lambda: figure_8(twin, max(options.repeats // 3, 5), options.plot),
    }
    for name, section in sections.items():
        if options.only in (None, name):
            section()


if __name__ == "__main__":
    main()
