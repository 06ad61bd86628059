"""The tables of docs/design/experiments/calibration.md: recordings and their residuals.

python bench/experiments_calibration.py --floor-z -0.3 BAG [BAG ...]
python bench/experiments_calibration.py --floor-z -0.3 --one-room [--picture PNG] BAG BAG [BAG ...]

With ``--one-room`` the recordings are laid on each other by their walls, and what is left of their
floors is compared cell by cell: in cells of the room, and in cells of the base. What belongs to the
room agrees in the room's cells, what belongs to the sensor in the base's.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from tccm_ros.calibrate.calibration import Calibration, calibrate
from tccm_ros.calibrate.observability import UNITS
from tccm_ros.calibrate.quality import MIN_HITS, Flatness, cell_means
from tccm_ros.calibrate.room import hits_of_bag
from tccm_ros.report.drawing import canvas, png

Float64 = NDArray[np.float64]
Cells = dict[tuple[int, int], float]

HEADER = (
    "| recording | zero, deg | scale | roll, deg | height, mm | floor level, deg | "
    "ceiling level, deg | parallel, deg | ceiling less floor along x, y, deg | "
    "of that unevenness, deg | floor cells, mm rms |\n|---|---|---|---|---|---|---|---|---|---|---|"
)
ROOM_HEADER = (
    "| pair | distance, m | turned, deg | in cells of | cells | correlation | difference, mm rms | "
    "each, mm rms |\n|---|---|---|---|---|---|---|---|"
)

#: Cells along a block whose unevenness belongs together (1 m), and how often blocks are drawn.
BLOCK, DRAWS = 4, 400

#: Walls of two recordings of one room are the same within this: rad, m.
SAME_ANGLE, SAME_DISTANCE = 0.1, 0.6


def row(found: Calibration) -> str:
    """Return one line of the table; before -> after where both are shown."""
    room = found.rooms[0]
    cells = [room.bag]
    for q in found.observability.quantities[:4]:
        _, factor = UNITS[q.name]
        factor = 1.0 if q.name == "tilt_scale" else factor
        digits = 4 if q.name == "tilt_scale" else 1 if q.name == "height" else 2
        sigma = "open" if q.sigma is None else f"{q.sigma * factor:.{digits}f}"
        cells.append(f"{q.value * factor:.{digits}f} ± {sigma}")
    for before, after in (room.floor, room.ceiling):
        both = before is not None and after is not None
        cells.append(
            f"{np.rad2deg(before.tilt):.2f} → {np.rad2deg(after.tilt):.2f}" if both else "-"
        )
    angles = room.parallel
    cells.append("-" if angles is None else " → ".join(f"{np.rad2deg(a):.2f}" for a in angles))
    floor, ceiling = room.floor[1], room.ceiling[1]
    both = floor is not None and ceiling is not None
    difference = slopes(ceiling) - slopes(floor) if both else None
    cells.append("-" if difference is None else "{:+.2f}, {:+.2f}".format(*difference))
    cells.append("-" if difference is None else "{:.2f}, {:.2f}".format(*unevenness(found)))
    cells.append("-" if floor is None or floor.rms is None else f"{floor.rms * 1e3:.1f}")
    return "| " + " | ".join(cells) + " |"


def slopes(surface: Flatness) -> Float64:
    """Return how a horizontal surface rises along x and y of the base, deg."""
    a, b, c = surface.normal
    result: Float64 = np.rad2deg(np.arctan2([-a, -b], c))
    return result


def unevenness(found: Calibration) -> Float64:
    """Return what the slopes of ceiling less floor owe to which parts were seen, (2,), deg.

    Surfaces are not flat, and other parts of them would give other slopes: the standard deviation
    over slopes of floor and ceiling put together from blocks that are drawn at random.
    """
    estimate = found.observability.estimate
    beams, seen = hits_of_bag(found.observability, found.recording, 0)
    points = estimate.problem.model.transform_points(beams, estimate.values)
    draw = np.random.default_rng(0)
    floors, ceilings = (_drawn(points[on], draw) for on in (seen.floor, seen.ceiling))
    result: Float64 = np.rad2deg(np.std(ceilings - floors, axis=0))
    return result


def _drawn(points: Float64, draw: np.random.Generator) -> Float64:
    """Return the slopes (DRAWS, 2) of as many blocks as there are, drawn with repetition."""
    cells, means, counts = cell_means(points, points[:, :2])
    of_block = np.unique(cells // BLOCK, axis=0, return_inverse=True)[1].reshape(-1)
    blocks = int(of_block.max()) + 1
    A = np.column_stack([np.ones(len(means)), means[:, :2]])
    found = []
    for _ in range(DRAWS):
        times = np.bincount(draw.integers(0, blocks, blocks), minlength=blocks)[of_block]
        root = np.sqrt(np.minimum(counts, MIN_HITS) * times)
        found.append(np.linalg.lstsq(A * root[:, None], means[:, 2] * root, rcond=None)[0][1:])
    return np.array(found)


@dataclass(frozen=True)
class Floor:
    """The floor of a recording in its base: hits (N, 3), m, and walls (W, 2) as phi, rho."""

    bag: str
    points: Float64
    walls: Float64

    @classmethod
    def of(cls, found: Calibration) -> Floor:
        """Take the hits that count in the table, and the walls."""
        estimate = found.observability.estimate
        layout, x, model = estimate.problem.layout, estimate.solution.x, estimate.problem.model
        beams, seen = hits_of_bag(found.observability, found.recording, 0)
        points = model.transform_points(beams, estimate.values)
        walls = np.array([x[layout.wall(i)][:2] for i in range(layout.walls)])
        return cls(found.bags[0], points[seen.floor], walls)

    def register(self, other: Floor) -> tuple[float, Float64]:
        """Return the yaw and the shift (2,) that lay the other's walls on these."""
        yaws = np.angle(np.exp(1j * (self.walls[:, None, 0] - other.walls[None, :, 0])))
        off = self.walls[:, None, 1] - other.walls[None, :, 1]
        a, b = np.nonzero((np.abs(yaws) < SAME_ANGLE) & (np.abs(off) < SAME_DISTANCE))
        phi = self.walls[a, 0]
        normals = np.column_stack([np.cos(phi), np.sin(phi)])
        return float(np.mean(yaws[a, b])), np.linalg.lstsq(normals, off[a, b], rcond=None)[0]

    def residuals(self, yaw: float, shift: Float64) -> Cells:
        """Return what is left of full cells, m; cells are in the place that yaw and shift give."""
        c, s = np.cos(yaw), np.sin(yaw)
        at = self.points[:, :2] @ np.array([[c, s], [-s, c]]) + shift
        cells, means, counts = cell_means(self.points, at)
        root = np.sqrt(np.minimum(counts, MIN_HITS))
        A = np.column_stack([np.ones(len(means)), means[:, :2]])
        plane = np.linalg.lstsq(A * root[:, None], means[:, 2] * root, rcond=None)[0]
        rest = means[:, 2] - A @ plane
        full = counts >= MIN_HITS
        return {(i, j): z for (i, j), z in zip(cells[full].tolist(), rest[full].tolist())}


def compare(floors: list[Floor]) -> list[Cells]:
    """Print a line for each pair and frame; return what is left of each floor, in the room."""
    still = (0.0, np.zeros(2))
    poses = [floors[0].register(floor) for floor in floors]
    in_room = [floor.residuals(*pose) for floor, pose in zip(floors, poses)]
    in_base = [floor.residuals(*still) for floor in floors]
    print(ROOM_HEADER)
    for i, j in combinations(range(len(floors)), 2):
        distance = float(np.linalg.norm(poses[i][1] - poses[j][1]))
        turned = np.rad2deg(abs(poses[i][0] - poses[j][0]))
        for frame, maps in (("room", in_room), ("base", in_base)):
            both = sorted(maps[i].keys() & maps[j].keys())
            z = 1e3 * np.array([[maps[i][cell], maps[j][cell]] for cell in both])
            each, difference = np.sqrt(np.mean(z**2)), np.sqrt(np.mean((z[:, 0] - z[:, 1]) ** 2))
            print(
                f"| {floors[i].bag}, {floors[j].bag} | {distance:.2f} | {turned:.1f} | {frame} | "
                f"{len(both)} | {np.corrcoef(z.T)[0, 1]:.2f} | {difference:.1f} | {each:.1f} |"
            )
    return in_room


def draw(floors: list[Floor], maps: list[Cells], path: Path) -> None:
    """Draw what is left of each floor in the cells of the room."""
    everywhere = np.array([cell for cells in maps for cell in cells]) * 0.25
    low, high = everywhere.min(axis=0) - 0.3, everywhere.max(axis=0) + 0.5
    colours = Normalize(-15.0, 15.0)
    with canvas(3.0 * len(maps) + 0.8, 4.6) as (figure, _):
        panels = figure.subplots(1, len(maps), sharex=True, sharey=True)
        for axes, floor, cells in zip(panels, floors, maps):
            x, y = 0.25 * (np.array(list(cells)).T + 0.5)
            axes.scatter(x, y, c=1e3 * np.array(list(cells.values())), norm=colours, s=34,
                         marker="s", cmap="RdBu", edgecolors="none")  # fmt: skip
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x in room, m")
            axes.set_aspect("equal")
            axes.set_title(floor.bag, fontsize=9)
            axes.grid(lw=0.3)
        panels[0].set_ylabel("y in room, m")
        figure.colorbar(ScalarMappable(colours, "RdBu"), ax=list(panels), label="off the plane, mm",
                        shrink=0.8)  # fmt: skip
        path.write_bytes(png(figure))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bags", nargs="+")
    parser.add_argument("--floor-z", type=float, default=None)
    parser.add_argument("--one-room", action="store_true", help="the bags are of one room")
    parser.add_argument("--picture", type=Path, help="of the floors in the room")
    arguments = parser.parse_args()
    found = []
    print(HEADER)
    for bag in arguments.bags:
        found.append(calibrate(bag, floor_z=arguments.floor_z))
        print(row(found[-1]), flush=True)
    if arguments.one_room:
        print()
        floors = [Floor.of(one) for one in found]
        maps = compare(floors)
        if arguments.picture is not None:
            draw(floors, maps, arguments.picture)


if __name__ == "__main__":
    main()
