"""Time of updates of a graph in one room, and of the newest covariance, with simulated factors.

Usage: python bench/bench_room_graph.py [--keyframes 3000]. Laps of a room with 15 walls, of which
each keyframe sees four; every third keyframe closes a loop with an earlier lap. The last 1,400
keyframes come in updates of 50, as solutions while driving. Times are processor time.
"""

from __future__ import annotations

import argparse
import time
from itertools import chain

import numpy as np

from tccm_ros.geometry import between2, compose2
from tccm_ros.slam.chain import yaw_offset_for
from tccm_ros.slam.factors.factor import Factor, by_variables
from tccm_ros.slam.factors.keys import Key, keyframe_key, wall_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.incremental import IncrementalGraph
from tccm_ros.slam.growth import RELINEARIZE, WILDFIRE

LAP, WALLS, SEEN, EVERY, GROWN = 35, 15, 4, 50, 1400
STEP_SIGMA, LOOP_SIGMA = np.array([0.004, 0.004, 0.002]), np.array([0.012, 0.012, 0.003])
LINE_SIGMA = 0.01


def room(count: int) -> tuple[list[Key], list[list[Factor]], np.ndarray]:
    """Return the variables of keyframes, the factors that come with each, and its true pose."""
    random = np.random.default_rng(0)
    phi = np.linspace(0.0, 2.0 * np.pi, WALLS + 1)[:-1]
    rho = 4.0 + random.uniform(0.0, 1.0, WALLS)
    angle = np.arange(count) * 2.0 * np.pi / LAP
    x, y = 1.7 * np.stack([np.cos(angle), np.sin(angle)]) + random.normal(0.0, 0.2, (2, count))
    truth = np.stack([x, y, angle + 0.5 * np.pi], axis=1)
    truth = between2(truth[0], truth)
    seen = [random.choice(WALLS, SEEN, replace=False) for _ in range(count)]
    keys = [keyframe_key(k, yaw_offset_for(phi[seen[k]] - truth[k, 2])) for k in range(count)]

    def measured(a: int, b: int, sigma: np.ndarray) -> BetweenKeyframes:
        delta = between2(truth[a], truth[b]) + random.normal(size=3) * sigma
        return BetweenKeyframes(keys[a], keys[b], delta, np.diag(sigma**2))

    groups: list[list[Factor]] = []
    for k in range(count):
        new: list[Factor] = [Planar(keys[k], truth[k])]
        new.append(
            measured(k - 1, k, STEP_SIGMA) if k else PriorPose(keys[0], truth[0], np.eye(3) * 1e-8)
        )
        for w in seen[k].tolist():
            away = rho[w] - truth[k, :2] @ [np.cos(phi[w]), np.sin(phi[w])]
            line = np.array([phi[w] - truth[k, 2], away]) + random.normal(size=2) * LINE_SIGMA
            cov = np.eye(2) * LINE_SIGMA**2
            new.append(WallObservation(keys[k], wall_key(w), float(line[0]), float(line[1]), cov))
        if k % 3 == 0 and k > 2 * LAP:
            new.append(measured(k - LAP * int(random.integers(1, k // LAP + 1)), k, LOOP_SIGMA))
        groups.append(new)
    return keys, groups, truth


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keyframes", type=int, default=3000)
    count = parser.parse_args().keyframes
    keys, groups, truth = room(count)
    graph, known = IncrementalGraph(RELINEARIZE, WILDFIRE), count - GROWN
    graph.update(by_variables(chain.from_iterable(groups[:known])), dict(zip(keys, truth[:known])))
    graph.relinearise()
    totals, covariances = [], []
    for first in range(known, count, EVERY):
        new = range(first, first + EVERY)
        pose, starts = graph.planar_poses(keys[first - 1 : first])[0], {}
        for k in new:
            pose = compose2(pose, between2(truth[k - 1], truth[k]))
            starts[keys[k]] = pose
        start = time.process_time()
        graph.update(by_variables(chain.from_iterable(groups[k] for k in new)), starts)
        graph.relinearise()
        updated = time.process_time()
        graph.covariance(keys[new[-1]])
        end = time.process_time()
        totals.append(end - start)
        covariances.append(end - updated)
    print("| keyframes | update and covariance, median s | longest s | covariance, longest s |")
    print("|---|---|---|---|")
    row = f"{np.median(totals):.2f} | {max(totals):.2f} | {max(covariances):.2f}"
    print(f"| {count} | {row} |")


if __name__ == "__main__":
    main()
