"""Door signs as landmarks: what is found, how exactly, and where they place a robot.

Usage: python bench/bench_sign_map.py [--seeds N]

Measurements are made from the truth with noise of two pixels, 0.2 deg of roll and pitch, a tenth of
the views missing and a tenth of the numbers misread. Three tables: an office of ten doors, two laps
(signs, false ones, errors, squared Mahalanobis distance over degrees of freedom, and how far the
trajectory is from that without signs); the same with a plate renamed, moved, or seen in a mirror;
and ten identical offices on a corridor, where a robot is placed anywhere.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import numpy as np
from bench_slam import HERE

from tccm_ros.config import Config
from tccm_ros.slam.solution import Solution
from tccm_ros.slam.wall_slam import WallSlam

sys.path.insert(0, str(HERE.parent / "test" / "helpers"))
import buildings
import plan
from sign_plates import Pictures, Plate, office, one_digit_in_ten, two_laps

RENAMED, OTHER = "205", "209"
MOVED_M = 1.6


def solve(run: plan.Run, told: list) -> Solution:
    """Return the solution of a run with what pictures told."""
    slam = WallSlam(Config())
    for scan in run.scans:
        slam.add_scan(scan)
    for sign in told:
        slam.add_sign(sign)
    return slam.solve()


def row(name: str, seed: int, signs: Solution, without: Solution, plates: list[Plate]) -> str:
    """Return a line of the first table; plates at one place are one, whichever text is read."""
    truth: dict[str, list] = {}
    for plate in plates:
        truth.setdefault(plate.number, []).append(np.array(plate.position))
    places = {plate.position for plate in plates}
    errors, nees, false, found = [], [], 0, set()
    for sign in signs.signs:
        away = [sign.position - at for at in truth.get(sign.number, [])]
        nearest = min(away, key=np.linalg.norm, default=np.full(3, np.inf))
        if np.linalg.norm(nearest) > 0.5:
            false += 1
            continue
        found.add(tuple(np.round(sign.position - nearest, 6)))
        errors.append(np.linalg.norm(nearest))
        nees.append(nearest @ np.linalg.solve(sign.covariance, nearest) / 3.0)
    bent = np.hypot(*(signs.poses - without.poses)[:, :2].T).max()
    return (
        f"{name:10} {seed:4} {len(found):3} of {len(places):2} {false:6} "
        f"{100 * float(np.mean(errors)):8.1f} {100 * max(errors):7.1f} {np.mean(nees):6.2f} "
        f"{1000 * bent:8.1f}"
    )


def offices(seeds: int) -> None:
    """Print the first two tables."""
    walls, plates = office()
    route = two_laps()
    half = len(route) // 2
    renamed = [replace(p, number=OTHER, looks=OTHER) if p.number == RENAMED else p for p in plates]
    there = next(p for p in plates if p.number == RENAMED)
    x, y, z = there.position
    moved = replace(there, position=(x + MOVED_M, y, z))
    after_move = [moved if p.number == RENAMED else p for p in plates]
    mirror = Plate(RENAMED, (x, 2.0 - y, z), -np.pi / 2)
    print(
        f"{'case':10} {'seed':>4} {'signs':>9} {'false':>6} {'mean, cm':>8} {'max, cm':>7} "
        f"{'chi2/3':>6} {'bent, mm':>8}"
    )
    for seed in range(seeds):
        run = plan.drive(walls, route, seed=seed)
        stamps, without = run.stamps_ns, solve(run, [])

        def seen(what, part, walls=walls, seed=seed, stamps=stamps):
            pictures = Pictures(what, walls, misread=one_digit_in_ten)
            return pictures.along(route[part], stamps[part], seed=seed + 100 * bool(part.start))

        first, second, whole = slice(0, half), slice(half, None), slice(0, None)
        cases = {
            "two laps": (seen(plates, whole), plates),
            "renamed": (seen(plates, first) + seen(renamed, second), [*plates, *renamed]),
            "moved": (seen(plates, first) + seen(after_move, second), [*plates, moved]),
            "mirror": (seen(plates, whole) + seen([mirror], whole, np.zeros((0, 2, 2))), plates),
        }
        for name, (told, true) in cases.items():
            print(row(name, seed, solve(run, told), without, true), flush=True)


def relocalisation(seeds: int) -> None:
    """Print the third table."""
    building, robot = buildings.offices(5, alike=True), buildings.ROBOTS["good"]
    plates = [
        Plate(f"{101 + 2 * k + (side < 0)}", (4.0 * k + 1.1, side * 1.08, 1.5), -side * np.pi / 2)
        for k in range(5)
        for side in (1, -1)
    ]

    def drive(slam: WallSlam, path: list, seed: int, what: list[Plate]) -> list[np.ndarray]:
        place = buildings.Building(building.walls, building.glass, path)
        run = buildings.drive(place, robot, seed=seed, start_ns=2 * 10**18)
        poses = plan.route(path, step=robot.step, yaw_step=robot.yaw_step)
        pictures = Pictures(what, building.walls, misread=one_digit_in_ten)
        told = pictures.along(poses, run.stamps_ns, seed=seed)
        for scan in run.scans:
            while told and told[0].stamp_ns <= scan.scan.stamp_ns:
                slam.add_sign(told.pop(0))
            found = slam.add_scan(scan)
        first = plan.matrix((1.0, 0.0, 0.0))
        return [found.pose, plan.planar(np.linalg.inv(first) @ plan.matrix(poses[-1]))]

    slam = WallSlam(Config())
    drive(slam, building.route, 1, plates)
    state = slam.saved()
    random = np.random.default_rng(5)
    print(f"\n{'with':8} {'placed':>6} {'right':>6} {'wrong':>6} {'refused':>8} {'max, cm':>8}")
    starts = []
    for _ in range(4 * seeds):
        room, side = int(random.integers(5)), float(random.choice([-1.0, 1.0]))
        x = 4.0 * room + 1.95
        end = float(np.clip(x + random.choice([-6.0, 6.0]), 1.5, 18.5))
        starts.append([(x, side * 3.6), (x, 0.0), (end, 0.0)])
    for name, what in (("signs", plates), ("walls", [])):
        right, wrong, refused, errors = 0, 0, 0, [0.0]
        for k, path in enumerate(starts):
            later = WallSlam.from_saved(Config(), state)
            pose, truth = drive(later, path, 10 + k, what)
            away = float(np.hypot(*(pose - truth)[:2]))
            refused += not later.is_located
            right += later.is_located and away < 0.1
            wrong += later.is_located and away >= 0.1
            errors += [away] if later.is_located else []
        print(
            f"{name:8} {len(starts):6} {right:6} {wrong:6} {refused:8} {100 * max(errors):8.1f}",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=4)
    seeds = parser.parse_args().seeds
    offices(seeds)
    relocalisation(seeds)


if __name__ == "__main__":
    main()
