"""Approaches in flats of random furniture, by a simulated base: gap, yaw, contacts, reasons.

Usage: python bench/bench_approach.py OUT.jsonl [--flats 50] [--first 0]

Each flat is a line of OUT.jsonl; flats that are in it are not run again. The state machine that
`approach_node` runs is stepped in simulated time, without DDS. The base has a latency of 0.1 s, an
error of up to 2 % in each wheel and 5 mm of noise in each beam; maps are made of the true furniture
before it moved, with errors of 5 mm and 0.3 deg of the surface and 2 cm and 0.4 deg of
localisation.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Point, Polygon, affinity

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "helpers")]

from approach_world import ROBOT as BASE  # noqa: E402
from approach_world import (  # noqa: E402
    Flat,
    Piece,
    SimulatedBase,
    a_goal,
    circle,
    l_shape,
    piece,
    rectangle,
    run,
    surroundings,
)

from tccm_ros.approach.approach import Approach  # noqa: E402

GAP_M, YAW_DEG = 0.02, 1.5
"""What is promised."""


def random_flat(rng: Generator) -> Flat:
    """Return a room with a table that has been moved, a second piece, chairs, and perhaps a
    person.
    """
    while True:
        width, depth = rng.uniform(4.5, 6.5, 2)
        room = shapely.box(0.0, 0.0, width, depth)
        top, is_round = _top(rng)
        place = rng.uniform([1.2, 1.2], [width - 1.2, depth - 1.2])
        turned = affinity.rotate(top, rng.uniform(0, 360), (0, 0))
        mapped = piece(affinity.translate(turned, *place), rng.uniform(0.66, 0.80))
        way, yaw = rng.uniform(0.0, 0.5), rng.uniform(-30.0, 30.0)
        angle = rng.uniform(0.0, 2.0 * math.pi)
        target = mapped.moved(way * math.cos(angle), way * math.sin(angle), math.radians(yaw))
        others = [_sideboard(room, rng)]
        chairs = [_chair(target, rng) for _ in range(rng.integers(0, 4))]
        start = np.array([*rng.uniform(0.5, [width - 0.5, depth - 0.5]), rng.uniform(-3, 3)])
        solid = [target.top, mapped.top, *(p.top for p in others + chairs)]
        body = Point(start[:2]).buffer(0.5)
        inside = room.buffer(-0.15)
        if not all(inside.contains(s) for s in (target.top, mapped.top, others[0].top)):
            continue
        chairs = [c for c in chairs if inside.contains(c.top)]
        if any(body.intersects(s) for s in solid) or not room.contains(body):
            continue
        if others[0].top.buffer(0.3).intersects(shapely.union_all([target.top, mapped.top])):
            continue
        known = [c for c in chairs if rng.random() < 0.5 and not c.top.intersects(mapped.top)]
        person = _person(room, start, rng) if rng.random() < 0.4 else None
        return Flat(
            room, target, mapped, others + chairs, others + known, person, start, is_round
        )  # fmt: skip


def _top(rng: Generator) -> tuple[Polygon, bool]:
    kind = rng.random()
    if kind < 0.5:
        return rectangle(rng.uniform(0.8, 1.8), rng.uniform(0.6, 0.95)), False
    if kind < 0.75:
        return circle(rng.uniform(0.35, 0.65)), True
    made = l_shape(rng.uniform(1.3, 1.8), rng.uniform(1.2, 1.6), rng.uniform(0.55, 0.7))
    return affinity.translate(made, -0.7, -0.6), False


def _sideboard(room: Polygon, rng: Generator) -> Piece:
    _, _, width, depth = room.bounds
    x = rng.uniform(0.8, width - 0.8)
    made = rectangle(rng.uniform(0.8, 1.4), 0.4)
    y = 0.36 if rng.random() < 0.5 else depth - 0.36
    return piece(affinity.translate(made, x, y), rng.uniform(0.6, 0.9))


def _chair(target: Piece, rng: Generator) -> Piece:
    """Return a chair that stands at a side of the table, partly under it or beside it."""
    line = target.top.exterior
    at = line.interpolate(rng.uniform(0.0, line.length))
    middle = target.top.centroid
    away = np.array([at.x - middle.x, at.y - middle.y])
    away /= np.hypot(*away)
    x, y = np.array([at.x, at.y]) + rng.uniform(0.1, 0.5) * away
    seat = affinity.rotate(rectangle(0.42, 0.42), rng.uniform(0, 90), (0, 0))
    return piece(affinity.translate(seat, x, y), 0.45, inset=0.03)


def _person(room: Polygon, start: np.ndarray, rng: Generator) -> tuple:
    """Return someone who walks across the room, beside where the robot begins."""
    _, _, width, depth = room.bounds
    side = depth - 0.4 if start[1] < depth / 2 else 0.4
    a = np.array([0.35, rng.uniform(0.4, depth - 0.4)])
    b = np.array([width - 0.35, side])
    way = (b - a) / np.hypot(*(b - a))
    return a, way, rng.uniform(0.5, 1.0), 0.2, rng.uniform(3.0, 25.0)


def approach_in(seed: int) -> dict[str, object]:
    """Return the figures of one flat."""
    rng = np.random.default_rng(seed)
    flat = random_flat(rng)
    base = SimulatedBase(flat, rng)
    approach = Approach(BASE, a_goal(flat, rng), surroundings(flat))
    outcome = run(approach, base, 240.0)
    gap, yaw = base.true_figures()
    kind = (
        "round"
        if flat.is_round
        else "L"
        if len(flat.mapped.top.exterior.coords) > 5
        else "straight"
    )
    return {
        "flat": seed,
        "kind": kind,
        "person": flat.person is not None,
        "chairs": len(flat.others) - 1,
        "reason": "TIME" if outcome is None else outcome.reason.name,
        "message": "" if outcome is None else outcome.message,
        "gap_error_m": round(gap - 0.05, 4),
        "yaw_error_deg": round(math.degrees(yaw), 2),
        "contacts": base.contacts,
        "seconds": round(base.t, 1),
    }


def is_there(row: dict) -> bool:
    within = abs(row["gap_error_m"]) <= GAP_M and abs(row["yaw_error_deg"]) <= YAW_DEG
    return row["reason"] == "NONE" and within


def summary(rows: list[dict]) -> str:
    """Return the table of the docs."""
    lines = ["| top | flats | within 2 cm and 1.5 deg | a reason | contacts | median error |"]
    lines.append("|---|---|---|---|---|---|")
    for kind in ("straight", "round", "L", "all"):
        some = [r for r in rows if kind in (r["kind"], "all")]
        there = [r for r in some if is_there(r)]
        told = sum(r["reason"] not in ("NONE", "TIME") for r in some)
        contacts = sum(r["contacts"] > 0 for r in some)
        gap = np.median([abs(r["gap_error_m"]) for r in there] or [np.nan])
        yaw = np.median([abs(r["yaw_error_deg"]) for r in there] or [np.nan])
        lines.append(
            f"| {kind} | {len(some)} | {len(there)} | {told} | {contacts} "
            f"| {1e3 * gap:.0f} mm, {yaw:.1f} deg |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--flats", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    rows = []
    if options.out.exists():
        rows = [json.loads(line) for line in options.out.read_text().splitlines()]
    done = {row["flat"] for row in rows}
    for seed in range(options.first, options.first + options.flats):
        if seed in done:
            continue
        row = approach_in(seed)
        rows.append(row)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(row, flush=True)
    print(summary(rows))


if __name__ == "__main__":
    main()
