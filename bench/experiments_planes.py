"""The paper's plane experiments, repeated: Table III, Fig. 7, 9, 11, 12, and real recordings.

Prints Markdown and writes pictures to docs/images. Recordings are looked for in `--recordings` (a
folder with `tables` and `bags`), and left out where they are not there. Tables I and II are printed
by bench_planes.py.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "bench"), str(ROOT / "test" / "helpers")]

from plane_scenes import (  # noqa: E402
    MISS_MM,
    REGION,
    error,
    eye,
    fitted_plane,
    in_region,
    median_ms,
    part_map_of,
    subject_fit,
)
from situation_cycle import SUBJECT, Cycle, cycle  # noqa: E402

from tccm_ros.baselines.center_cores import (  # noqa: E402
    CorePlane,
    center_cores,
    find_core_plane,
    find_core_planes,
)
from tccm_ros.baselines.neighbour_planes import find_neighbour_planes  # noqa: E402
from tccm_ros.config import Config  # noqa: E402
from tccm_ros.cuboids.cuboids import TICK, Cuboids  # noqa: E402
from tccm_ros.cuboids.part_map import PartMapBuilder  # noqa: E402
from tccm_ros.planes import PlaneFits, find_planes  # noqa: E402
from tccm_ros.replay.run import run_bag  # noqa: E402
from tccm_sim.scene import Motion, Scene  # noqa: E402

CONFIG = Config()
COARSE = Config.model_validate({"map": {"cell_size": 0.04}, "center_core": {"min_length": 0.016}})
"""What center cores need in one tilt cycle: the paper's largest cells, without short cores."""

CORE_LENGTH = COARSE.center_core.min_length
PAPER_MIN_VAL = 0.15
"""The paper's threshold on val, whose unit it does not tell; m2 here."""

CORE_MISS_DEG = 10.0
"""A plane of center cores that is further off is a miss."""

Array = NDArray[np.float64]
PAPER_THREE = {
    (20, 0): (4.354, 0.2996), (40, 0): (4.530, 0.3900), (60, 0): (3.377, 0.4382),
    (80, 0): (3.351, 0.1830), (0, 20): (3.946, 0.3464), (0, 40): (4.156, 0.2012),
    (0, 60): (4.289, 0.6344), (0, 80): (4.106, 0.7483),
}  # fmt: skip
"""Table III as published: (yaw, pitch) in deg -> ms, maximum val."""


def rotation(yaw: float, pitch: float) -> Array:
    """Return Rz(yaw) Ry(pitch), angles in deg."""
    y, p = np.deg2rad([yaw, pitch])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    return Rz @ Ry


def map_of(points: Array, config: Config = CONFIG) -> Cuboids:
    """Return the part map of bare points."""
    builder = PartMapBuilder(config)
    builder.add_points(np.ascontiguousarray(points))
    return builder.close(0, 0, 1).cuboids()


def table_three(seeds: int = 10) -> None:
    """Print Table III: the points of the shelf, situation B, turned and shifted; several seeds."""
    print(f"### Table III: the shelf turned about the laser, 2.5 mm noise, {seeds} seeds\n")
    print(
        "| yaw | pitch | ours found | ms | error, mm | deg | val | cores found | ms | error, mm |"
        " deg | val | paper: ms | val |"
    )
    print("|---" * 14 + "|")
    for (yaw, pitch), (paper_ms, paper_val) in PAPER_THREE.items():
        rows = [turned_shelf(yaw, pitch, seed) for seed in range(seeds)]
        texts = []
        for part in zip(*rows, strict=True):
            found = np.array([row for row in part if np.isfinite(row[1])]).reshape(-1, 4)
            ms = np.median([row[0] for row in part])
            if not len(found):
                texts.append(f"0 of {seeds} | {ms:.3f} | - | - | -")
                continue
            mm, deg, val = np.abs(found[:, 1]).mean(), found[:, 2].mean(), np.median(found[:, 3])
            texts.append(f"{len(found)} of {seeds} | {ms:.3f} | {mm:.2f} | {deg:.2f} | {val:.0f}")
        print(
            f"| {yaw} | {pitch} | {' | '.join(texts)} | *{paper_ms}* | *{paper_val}* |", flush=True
        )


def turned_shelf(yaw: float, pitch: float, seed: int) -> list[tuple[float, float, float, float]]:
    """Return ms, mm, deg and val of our plane of the shelf's front, and of center cores'."""
    simulated = cycle("b", 0.0025, seed, room=True)
    R, shift = rotation(yaw, pitch), np.array([0.3, -0.2, 0.1])
    use = in_region(simulated.points)
    points = (simulated.points[use] - eye(simulated)) @ R.T + shift
    middle = points[simulated.labels[use] == SUBJECT].mean(axis=0)
    truth, cuboids = moved(simulated, R, shift), map_of(points)
    fit = subject_fit(find_planes(cuboids, CONFIG, shift), truth, middle)
    row = [median_ms(lambda: find_planes(cuboids, CONFIG, shift), 20), *[np.nan] * 3]
    if fit is not None:
        row[1:] = *error(fit.normal, fit.offset, truth, middle), fit.quality
    coarse = map_of(points, COARSE)

    def by_cores() -> CorePlane | None:
        return find_core_plane(center_cores(coarse, CORE_LENGTH), CONFIG, 50, seed)

    plane = by_cores()
    other = [median_ms(by_cores, 5), *[np.nan] * 3]
    if plane is not None:
        mm, deg = error(plane.normal, plane.offset, truth, middle)
        if abs(mm) < MISS_MM and deg < CORE_MISS_DEG:
            other[1:] = mm, deg, plane.quality
    return [tuple(row), tuple(other)]


def clutter(maps: int = 20, points: int = 20_000) -> None:
    """Print the vals of the best trials in uniformly random clutter, where there is no plane."""
    vals = []
    for seed in range(maps):
        points_m = np.random.default_rng(seed).uniform(
            (0.2, -1.0, 0.0), (2.2, 1.0, 2.0), (points, 3)
        )
        cores = center_cores(map_of(points_m, COARSE), CORE_LENGTH)
        plane = find_core_plane(cores, COARSE, 50, seed)
        vals.append(0.0 if plane is None else plane.quality)
    above = sum(val > PAPER_MIN_VAL for val in vals)
    print(
        f"\nclutter: val above {PAPER_MIN_VAL} in {above} of {maps} maps, {max(vals):.1f} at most\n"
    )


def moved(simulated: Cycle, R: Array, shift: Array) -> Cycle:
    """Return a tilt cycle whose true plane is turned about the laser and shifted."""
    normal = R @ simulated.normal
    offset = simulated.offset - float(simulated.normal @ eye(simulated)) + float(normal @ shift)
    return Cycle(**{**{f: getattr(simulated, f) for f in simulated.__dataclass_fields__},
                    "normal": normal, "offset": offset})  # fmt: skip


def draw_map(axes: Axes, cuboids: Cuboids, labels: NDArray[np.int32] | None = None) -> None:
    """Draw cuboids in a 3D plot, as their vertical middles, coloured by height or label."""
    x = (cuboids.ix + 0.5) * cuboids.cell_size
    y = (cuboids.iy + 0.5) * cuboids.cell_size
    top, bottom = cuboids.top * TICK, cuboids.bottom * TICK
    colour = plt.get_cmap("viridis")(np.clip(top / 1.3, 0, 1))
    if labels is not None:
        colour = plt.get_cmap("tab10")(labels % 10)
        colour[labels < 0] = (0.75, 0.75, 0.75, 1)
    lines = np.stack([np.stack([x, y, bottom], 1), np.stack([x, y, top], 1)], axis=1)
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    axes.add_collection3d(Line3DCollection(lines, colors=colour, linewidths=1.6))
    axes.set(xlim=(0.2, 1.5), ylim=(-0.9, 0.9), zlim=(0, 1.3))
    axes.set_box_aspect((1.3, 1.8, 1.3))
    axes.view_init(28, 205)


def draw_outlines(axes: Axes, fits: PlaneFits) -> None:
    """Draw the outlines of planes in a 3D plot."""
    for fit in fits:
        colour = plt.get_cmap("tab10")(fit.index % 10)
        for ring in (fit.boundary, *fit.holes):
            closed = np.vstack([ring, ring[:1]])
            axes.plot(*closed.T, color=colour, lw=1.5)


def figure_seven(folder: Path) -> None:
    """Draw the maps before and after horizontal planes are taken out: ours, and as published."""
    figure, rows = plt.subplots(3, 2, figsize=(9, 12), subplot_kw={"projection": "3d"})
    print("\n### Fig. 7: cuboids before and after taking out the horizontal planes\n")
    for column, name in enumerate("cd"):
        simulated = cycle(name, 0.0025, 1, room=True)
        cuboids = part_map_of(simulated, CONFIG, REGION)
        draw_map(rows[0][column], cuboids)
        rows[0][column].set_title(f"{name.upper()}: {len(cuboids)} cuboids")
        for row, (title, find) in enumerate(
            (("horizontal planes", find_planes), ("labels of neighbours", find_neighbour_planes)), 1
        ):
            fits = find(cuboids, CONFIG, eye(simulated))
            horizontal = [fit.index for fit in fits if fit.kind == "horizontal"]
            rest = cuboids.select(~np.isin(fits.labels, horizontal))
            draw_map(rows[row][column], rest)
            rows[row][column].set_title(f"without {title}: {len(rest)}")
            print(f"- {name.upper()}, {title}: {len(cuboids)} -> {len(rest)}")
    save(figure, folder / "planes_fig7.png")


def figure_nine(folder: Path) -> None:
    """Draw the height profile across a table top."""
    simulated = cycle("a", 0.005, 1, room=True, quantum=0.001)
    cuboids = part_map_of(simulated, CONFIG, REGION)
    fits = find_planes(cuboids, CONFIG, eye(simulated))
    fit = next(f for f in fits if f.kind == "horizontal")
    mean = cuboids.mean()[fit.members]
    figure, axes = plt.subplots(figsize=(8, 3))
    axes.plot(1e3 * mean[:, 1], 1e3 * cuboids.top[fit.members] * TICK, ".", ms=3, label="u (top)")
    axes.plot(1e3 * mean[:, 1], 1e3 * mean[:, 2], ".", ms=3, label="mean of a cuboid's points")
    axes.axhline(1e3 * fit.centroid[2], color="k", lw=1, label="fitted plane")
    axes.set(xlabel="y, mm", ylabel="height, mm", title="Table top, noise 5 mm (Fig. 9)")
    axes.legend(fontsize=8)
    save(figure, folder / "planes_fig9.png")
    spread = np.ptp(1e3 * cuboids.top[fit.members] * TICK)
    height = 1e3 * fit.centroid[2]
    print(f"\n### Fig. 9\n\nTops spread over {spread:.0f} mm (paper: about 20 mm); the plane's")
    print(f"middle is at {height:.2f} mm of 700.")


def figure_eleven(folder: Path) -> None:
    """Draw the center cores of a shelf with knobs, seen from a base with a pitch of 1 deg."""
    simulated = cycle("d", 0.0025, 1, yaw=-np.deg2rad(20.0), pitch=np.deg2rad(1.0))
    cores = center_cores(part_map_of(simulated, CONFIG, (0.2, 1.5, -0.9, 0.9, -0.1, 1.45)), 0.004)
    ends = cores.ends()
    figure, (front, side) = plt.subplots(1, 2, figsize=(9, 5), sharey=True)
    for axes, k, title in ((front, 1, "front view"), (side, 0, "side view")):
        axes.plot(ends[:, :, k].T, ends[:, :, 2].T, color="tab:blue", lw=0.8)
        axes.set(title=title, xlabel="y, m" if k else "x, m", aspect="equal")
    front.set_ylabel("z, m")
    save(figure, folder / "planes_fig11.png")
    print(f"\n### Fig. 11\n\n{len(cores)} center cores; the front is tilted by 1 deg and shows it.")


def seen(scene: Scene, seed: int = 1, sigma: float = 0.0025) -> Array:
    """Return the points of one tilt cycle over a scene, in the region of interest, m."""
    rig = cycle("a", 0.0)
    x, y = np.cos(rig.bearings), np.sin(rig.bearings)
    across = np.broadcast_to(y, rig.tilts.shape)
    rays = np.stack([x * np.cos(rig.tilts), across, -x * np.sin(rig.tilts)], -1).reshape(-1, 3)
    origins = np.broadcast_to(eye(rig), rays.shape)
    ranges, codes = scene.freeze().cast(origins, rays, rig.times.reshape(-1), 30.0)
    ranges = ranges + sigma * np.random.default_rng(seed).standard_normal(len(ranges))
    hit = codes >= 0
    points = origins[hit] + ranges[hit, None] * rays[hit]
    return points[in_region(points)]


def held_plate() -> Scene:
    """Return a person behind a table, who moves a white plate to the front of the robot."""
    scene = Scene()
    scene.floor_and_ceiling((-4.0, 8.0), (-6.0, 6.0))
    scene.table("table", (0.8, 1.2), 0.700, (0.9, 0.0))
    scene.cylinder("person", 0.17, 1.75, (1.75, 0.1, 0.875))
    # The plate comes in from the left at 0.15 m/s and hides part of the person and of the table.
    motion = Motion.through([(0.0, 0.0, 0.10, 0.0), (2.0, 0.0, -0.20, 0.0)])
    scene.box("plate", (0.35, 0.35, 0.01), (0.75, 0.0, 1.05), (0.0, -0.7, 0.3), motion=motion)
    scene.cylinder("forearm", 0.04, 0.45, (1.1, 0.05, 1.1), (0.0, 1.45, 0.0), motion=motion)
    return scene


def boxed_table() -> Scene:
    """Return a table with a package box on it."""
    scene = Scene()
    scene.floor_and_ceiling((-4.0, 8.0), (-6.0, 6.0))
    scene.table("table", (0.8, 1.2), 0.700, (0.9, 0.0))
    scene.box("package", (0.25, 0.35, 0.20), (0.95, 0.05, 0.80), (0.0, 0.0, 0.2))
    return scene


def figure_twelve(folder: Path) -> None:
    """Draw a plate that a person holds before the robot, and a package on a table."""
    place = eye(cycle("a", 0.0))
    figure, axes = plt.subplots(3, 2, figsize=(10, 13), subplot_kw={"projection": "3d"})
    print("\n### Fig. 12: a plate held by a person, a package on a table\n")
    for column, (title, scene) in enumerate(
        (("a plate before the robot", held_plate()), ("a package on a table", boxed_table()))
    ):
        points = seen(scene)
        draw_map(axes[0][column], map_of(points))
        axes[0][column].set_title(title)
        fine, coarse = map_of(points), map_of(points, COARSE)
        rows = (
            ("pooled moments", fine, find_planes(fine, CONFIG, place)),
            ("center cores", coarse, find_core_planes(coarse, COARSE, place)),
        )
        for row, (method, cuboids, fits) in enumerate(rows, 1):
            chosen = fits.labels >= 0
            draw_map(axes[row][column], cuboids.select(chosen), fits.labels[chosen])
            draw_outlines(axes[row][column], fits)
            axes[row][column].set_title(f"what belongs to its {len(fits)} planes: {method}")
            for fit in fits:
                tilt = np.degrees(np.arccos(min(1.0, abs(fit.normal[2]))))
                print(
                    f"- {title}, {method}: tilt {tilt:.1f} deg, {fit.support} points,"
                    f" {fit.area:.3f} m2, at ({', '.join(f'{x:.2f}' for x in fit.centroid)})"
                )
    save(figure, folder / "planes_fig12.png")


def real_tables(recordings: Path, folder: Path) -> None:
    """Print what is found of the labelled tables, levelled and as seen by the camera."""
    files = sorted((recordings / "tables").glob("*.npz"))
    if not files:
        print("\nThe recorded tables are not here: left out.")
        return
    print("\n### Recorded tables (range camera), against least squares on the labelled top\n")
    print("| scene | frame | found | false | angle, deg | offset, mm | rms, mm | planes |")
    print("|---|---|---|---|---|---|---|---|")
    camera = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pictures = []
    for path in files:
        data = np.load(path)
        points, labels = (
            data["points"].astype(float),
            data["labels" if "labels" in data else "label"],
        )
        good = np.isfinite(points).all(axis=1)
        points, is_top = points[good], (labels[good] >= 1) & (labels[good] <= 9)
        for frame, R in (("level", leveling(points[is_top])), ("camera", camera)):
            turned = points @ R.T
            cuboids = map_of(turned)
            fits = find_planes(cuboids, CONFIG, np.zeros(3))
            row, fit = fit_table(turned, is_top, cuboids, fits)
            print(f"| {path.stem} | {frame} | {row} | {len(fits)} |")
            if frame == "level":
                pictures.append((path.stem, turned, is_top, fit))
    draw_tables(pictures, folder)


def leveling(points: Array) -> Array:
    """Return the rotation that makes a table level."""
    normal = fitted_plane(points)[0]
    normal = normal if normal @ points.mean(axis=0) < 0 else -normal
    x = np.cross((0.0, 1.0, 0.0), normal)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])


def fit_table(points: Array, is_top, cuboids: Cuboids, fits: PlaneFits):  # type: ignore[no-untyped-def]
    """Return a table row and the fit that holds most of a labelled top."""
    labels = fits.labels[owners(points, cuboids)]
    found = labels[is_top]
    index = int(np.bincount(found[found >= 0]).argmax())
    member = labels == index
    normal, offset = fitted_plane(points[is_top])
    fit, middle = fits[index], points[is_top].mean(axis=0)
    sign = np.sign(normal @ fit.normal)
    off = 1e3 * ((fit.offset - fit.normal @ middle) - sign * (offset - normal @ middle))
    angle = np.degrees(np.arccos(min(1.0, abs(float(normal @ fit.normal)))))
    fraction = (member & is_top).sum() / is_top.sum()
    false = (member & ~is_top).sum() / member.sum()
    text = f"{100 * fraction:.1f} % | {100 * false:.2f} % | {angle:.3f} | {off:.2f}"
    return f"{text} | {1e3 * fit.rms:.2f}", fit


def owners(points: Array, cuboids: Cuboids) -> NDArray[np.int64]:
    """Return the cuboid of each point: the last of its cell whose bottom is not above it."""
    ticks = np.rint(points / TICK).astype(np.int64)
    cell = round(cuboids.cell_size / TICK)
    order = [np.floor_divide(ticks[:, k], cell) + (1 << 18) for k in (0, 1)]
    key = ((order[0] << 20) + order[1]) * (1 << 22) + ticks[:, 2] + (1 << 20)
    x, y, z = (np.asarray(k, np.int64) for k in (cuboids.ix, cuboids.iy, cuboids.bottom))
    keys = (((x + (1 << 18)) << 20) + y + (1 << 18)) * (1 << 22) + z + (1 << 20)
    return np.searchsorted(keys, key, side="right") - 1


def draw_tables(pictures: list, folder: Path) -> None:
    """Draw the tables from above with the outlines found."""
    figure, axes = plt.subplots(2, 4, figsize=(14, 7))
    for panel, (name, points, is_top, fit) in zip(axes.flat, pictures, strict=False):
        some = slice(None, None, 40)
        panel.plot(*points[is_top][some][:, :2].T, ",", color="tab:green")
        panel.plot(*points[~is_top][some][:, :2].T, ",", color="tab:red")
        for ring in (fit.boundary, *fit.holes):
            panel.plot(*np.vstack([ring, ring[:1]])[:, :2].T, "k", lw=1.2)
        panel.set(title=name, aspect="equal")
    save(figure, folder / "planes_tables.png")


def real_bags(recordings: Path) -> None:
    """Print the planes of the recorded office and corridor tilt cycles."""
    bags = sorted((recordings / "bags").glob("dlut_*")) + sorted(
        (recordings / "bags").glob("kurt3d_corridor")
    )
    if not bags:
        print("\nThe recorded bags are not here: left out.")
        return
    print("\n### Recorded tilt cycles: planes of the part map of each, largest first\n")
    print("| bag | cycle | planes | largest: tilt deg, offset m, area m2 |")
    print("|---|---|---|---|")
    for bag in bags:
        for result in run_bag(bag, CONFIG).cycles:
            planes = sorted(result.planes, key=lambda p: -p.area)
            texts = [
                f"{np.degrees(np.arccos(min(1.0, abs(p.normal[2])))):.1f}, {p.offset:.2f},"
                f" {p.area:.1f}"
                for p in planes[:5]
            ]
            print(f"| {bag.name} | {result.cycle} | {len(planes)} | " + "; ".join(texts) + " |")


def save(figure: plt.Figure, path: Path) -> None:
    """Write a picture without metadata, so that the same scene gives the same bytes."""
    figure.tight_layout()
    figure.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(figure)


def main() -> int:
    """Run all experiments."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("--recordings", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--simulated", action="store_true", help="leave the recordings out")
    options = parser.parse_args()
    options.images.mkdir(parents=True, exist_ok=True)
    table_three()
    clutter()
    for draw in (figure_seven, figure_nine, figure_eleven, figure_twelve):
        draw(options.images)
    if not options.simulated:
        real_tables(options.recordings, options.images)
        real_bags(options.recordings)
    return 0


if __name__ == "__main__":
    sys.exit(main())
