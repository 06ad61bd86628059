"""Recorded tilt cycles: figures 7 to 9 of the first paper, and planes of all detectors.

Usage: python bench/real_scenes.py [--recordings FOLDER] [--bags NAME ...] [--images FOLDER]
       [--rows FILE]

With --rows, the rows of each recording are added to a file as soon as they are measured, and those
that are in it already are not measured again.

The recordings are a SICK LMS 291 on a tilting platform in offices (`dlut_*`) and in a corridor
(`kurt3d_corridor`), each with the rig that `calibrate` gives. One row a recording is of its first
tilt cycle. Recordings that are not there are left out.

Counts are of the part map in cells of 20 and 40 mm (Fig. 7 and 8), heights are those of the floor's
cuboids against its plane (Fig. 9). A desk top is a horizontal plane 0.5 to 1.1 m above the floor, a
wall a vertical plane of at least 1 m2. Planes are of the part map, found by each detector at the
settings of docs/design/planes.md.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from tccm_ros.calibrate.calibration import calibrate
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import TICK, Cuboids
from tccm_ros.mapping.tccm import DETECTORS, CycleResult
from tccm_ros.planes import PlaneFit, PlaneFits
from tccm_ros.replay.run import run_bag

ROOT = Path(__file__).resolve().parents[1]

FLOOR_Z = {"dlut": -0.3, "kurt3d": None}
"""Height of the floor in the base frame by the recording's robot, m; None: as calibrated."""

CELLS = {"moments": 0.02, "neighbours": 0.04, "center_cores": 0.04}
"""Cell size of each detector, m: neighbours need cells wider than the gaps between scan lines."""

MIN_LENGTH = 0.016
"""Shortest core in cells of 40 mm, m."""

FLOOR_BAND = 0.1
"""A floor is within this of the lowest large horizontal plane, m (chosen)."""

DESK_HEIGHTS = (0.5, 1.1)
"""Of desk tops over the floor, m (chosen)."""

MIN_DESK, MIN_WALL = 0.1, 1.0
"""Smallest desk top and wall that are counted, m2 (chosen)."""

VERTICAL = 0.1
"""Max |z| of the normal of a vertical plane: 6 deg, as `planes.horizontal_angle`."""

COLOURS = {"floor": "tab:brown", "desk top": "tab:green", "wall": "tab:blue", "other": "tab:grey"}


@dataclass(frozen=True)
class Scene:
    """A tilt cycle: its part map by cell size, and its planes by detector."""

    name: str
    scans: int
    cuboids: dict[float, Cuboids]
    fits: dict[str, PlaneFits]
    floor_z: float

    def kind(self, fit: PlaneFit) -> str:
        """Return floor, desk top, wall or other."""
        height = float(fit.centroid[2]) - self.floor_z
        if fit.kind == "horizontal":
            if abs(height) < FLOOR_BAND:
                return "floor"
            is_desk = DESK_HEIGHTS[0] < height < DESK_HEIGHTS[1] and fit.area >= MIN_DESK
            return "desk top" if is_desk else "other"
        is_wall = abs(fit.normal[2]) < VERTICAL and fit.area >= MIN_WALL
        return "wall" if is_wall else "other"


def scene_of(bag: Path) -> Scene:
    """Return the first tilt cycle of a recording, with the rig that it is calibrated to."""
    rig = calibrate(bag, floor_z=FLOOR_Z[bag.name.split("_")[0]]).rig
    taken: list[tuple[CycleResult, Cuboids]] = []
    for cell in sorted(set(CELLS.values())):
        config = Config.model_validate({"rig": rig, "map": {"cell_size": cell}})
        cycles: list[tuple[CycleResult, Cuboids]] = []
        # The map after the first tilt cycle is its part map.
        run_bag(bag, config, on_cycle=lambda cycle, map_, own=cycles: own.append((cycle, map_)))
        taken.append(cycles[0])
    cycle = taken[0][0]
    cuboids = {map_.cell_size: map_ for _, map_ in taken}
    T = cycle.T_odom_base
    eye = T[:3, :3] @ cycle.surfaces.viewpoint + T[:3, 3]
    fits = {}
    for name, cell in CELLS.items():
        groups = {"map": {"cell_size": cell}, "center_core": {"min_length": MIN_LENGTH}}
        fits[name] = DETECTORS[name](cuboids[cell], Config.model_validate(groups), eye)
    low = [f for f in fits["moments"] if f.kind == "horizontal" and f.area >= MIN_WALL]
    floor_z = min(float(f.centroid[2]) for f in low)
    return Scene(bag.name, cycle.scans, cuboids, fits, floor_z)


def counts_row(scene: Scene) -> str:
    """Return points, cuboids and reduction in both cell sizes, and the spread of the floor."""
    row = [scene.name, str(scene.scans)]
    row.append(f"{scene.cuboids[0.02].count.sum():,.0f}")
    for cell in (0.02, 0.04):
        cuboids = scene.cuboids[cell]
        row += [f"{len(cuboids):,}", f"{cuboids.count.sum() / len(cuboids):.1f}"]
    floor = max(
        (f for f in scene.fits["moments"] if scene.kind(f) == "floor"), key=lambda f: f.area
    )
    tops, means = heights_over(floor, scene.cuboids[0.02])
    for heights in (tops, means):
        width = np.ptp(np.percentile(heights, [2.5, 97.5]))
        row.append(f"{1e3 * heights.std():.1f}, {1e3 * width:.0f}")
    return "| " + " | ".join(row) + " |"


def heights_over(fit: PlaneFit, cuboids: Cuboids) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights of tops u and of means of a plane's cuboids over it, float64 (N,), m."""
    means = cuboids.mean()[fit.members]
    at = (fit.offset - means[:, :2] @ fit.normal[:2]) / fit.normal[2]
    return cuboids.top[fit.members] * TICK - at, means[:, 2] - at


def planes_rows(scene: Scene) -> list[str]:
    """Return a row for each detector: floor, walls and desk tops."""
    rows = []
    for name, fits in scene.fits.items():
        own: dict[str, list[PlaneFit]] = {kind: [] for kind in COLOURS}
        for fit in fits:
            own[scene.kind(fit)].append(fit)
        areas = {kind: sum(fit.area for fit in members) for kind, members in own.items()}
        height = "-"
        if own["floor"]:
            largest = max(own["floor"], key=lambda fit: fit.area)
            height = f"{1e3 * (largest.centroid[2] - scene.floor_z):+.0f}"
        desks = ", ".join(
            f"{fit.centroid[2] - scene.floor_z:.2f}"
            for fit in sorted(own["desk top"], key=lambda fit: -fit.area)[:4]
        )
        cells = [scene.name, name, str(len(fits)), height]
        cells += [f"{len(own[k])}, {areas[k]:.1f}" for k in ("floor", "wall", "desk top")]
        rows.append("| " + " | ".join([*cells, desks or "-"]) + " |")
    return rows


def draw(scenes: list[Scene], path: Path) -> None:
    """Draw the planes of each recording and detector from above, coloured by kind."""
    names = list(CELLS)
    figure, axes = plt.subplots(
        len(scenes), len(names), figsize=(4 * len(names), 3.4 * len(scenes)), squeeze=False
    )
    for panels, scene in zip(axes, scenes, strict=True):
        for panel, name in zip(panels, names, strict=True):
            mean = scene.cuboids[CELLS[name]].mean()
            panel.plot(mean[:, 0], mean[:, 1], ",", color="0.8")
            for fit in scene.fits[name]:
                ring = np.vstack([fit.boundary, fit.boundary[:1]])
                colour = COLOURS[scene.kind(fit)]
                panel.plot(ring[:, 0], ring[:, 1], color=colour, lw=1.2)
            low, high = np.percentile(mean[:, :2], [1, 99], axis=0)
            panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            panel.set_title(f"{scene.name}, {name}", fontsize=9)
    handles = [plt.Line2D([], [], color=c, label=kind) for kind, c in COLOURS.items()]
    figure.legend(handles=handles, loc="lower center", ncol=len(COLOURS))
    figure.tight_layout(rect=(0, 0.03, 1, 1))
    figure.savefig(path, dpi=70, metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Print both tables and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--recordings", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--bags", nargs="*", help="names of recordings; all by default")
    parser.add_argument("--images", type=Path, help="folder of the picture")
    parser.add_argument("--rows", type=Path, help="file that keeps the rows of each recording")
    options = parser.parse_args()
    folder = options.recordings / "bags"
    bags = [*sorted(folder.glob("dlut_*")), *sorted(folder.glob("kurt3d_corridor"))]
    bags = [bag for bag in bags if not options.bags or bag.name in options.bags]
    rows = json.loads(options.rows.read_text()) if options.rows and options.rows.exists() else {}
    scenes = []
    for bag in bags:
        if bag.name not in rows or options.images:
            scene = scene_of(bag)
            scenes.append(scene)
            rows[bag.name] = [counts_row(scene), planes_rows(scene)]
        if options.rows:
            options.rows.write_text(json.dumps(rows, indent=1))
    print(
        "| recording | scans | points | cuboids, 20 mm | points a cuboid | cuboids, 40 mm |"
        " points a cuboid | floor's tops: std, width of 95 %, mm | floor's means: the same |"
    )
    print("|---" * 9 + "|")
    for bag in bags:
        print(rows[bag.name][0])
    print(
        "\n| recording | detector | planes | floor's height, mm | floor: planes, m2 |"
        " walls: number, m2 | desk tops: number, m2 | their heights, m |"
    )
    print("|---" * 8 + "|")
    for bag in bags:
        print("\n".join(rows[bag.name][1]))
    if options.images is not None and scenes:
        draw(scenes, options.images / "real_scenes.png")


if __name__ == "__main__":
    main()
