"""Draw the film strip of an approach: a random flat of bench_approach.py from above.

python bench/approach_film.py docs/images/approach_film.png --flat 3
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from bench_approach import (
    BASE,
    Flat,
    SimulatedBase,
    a_goal,
    random_flat,
    run,
    surroundings,
)
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as Patch

from tccm_ros.approach.approach import Approach

MOMENTS = 5
"""Number of pictures."""


def states_of(seed: int) -> tuple[Flat, list[tuple[float, str, np.ndarray]]]:
    """Return a flat, and time, phase and true pose of the base at each step of its approach."""
    rng = np.random.default_rng(seed)
    flat = random_flat(rng)
    base = SimulatedBase(flat, rng)
    approach = Approach(BASE, a_goal(flat, rng), surroundings(flat))
    states: list[tuple[float, str, np.ndarray]] = []
    run(
        approach, base, 240.0,
        lambda b: states.append((b.t, approach.phase.name.lower(), b.truth.copy())),
    )  # fmt: skip
    return flat, states


def moments(states: list[tuple[float, str, np.ndarray]]) -> list[int]:
    """Return the steps to draw: equally far along the way of the base, with both ends."""
    xy = np.array([pose[:2] for _, _, pose in states])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    return [int(np.searchsorted(way, f * way[-1])) for f in np.linspace(0.0, 1.0, MOMENTS)]


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--flat", type=int, default=0)
    options = parser.parse_args()
    flat, states = states_of(options.flat)
    figure = Figure((2.4 * MOMENTS, 2.9), dpi=80, layout="constrained")
    path = np.array([pose for _, _, pose in states])
    for axes, k in zip(figure.subplots(1, MOMENTS), moments(states)):
        t, phase, pose = states[k]
        axes.set_title(f"{t:.0f} s, {phase}", fontsize=9)
        axes.set_aspect("equal")
        axes.set_axis_off()
        shapes = [(flat.room, "none", "#3a3f47", "-"), (flat.mapped.top, "none", "#7a828c", "--")]
        shapes += [(p.top, "#d9dde2", "#7a828c", "-") for p in flat.others]
        shapes.append((flat.target.top, "#e69f00", "#1f2328", "-"))
        person = flat.person_at(t)
        shapes += [(person, "#cc79a7", "none", "-")] if person is not None else []
        for shape, face, edge, style in shapes:
            corners = np.asarray(shape.exterior.coords)
            axes.add_patch(Patch(corners, facecolor=face, edgecolor=edge, linestyle=style))
        body = BASE.footprint.at(pose)
        axes.add_patch(Patch(body, facecolor="#0072b2", edgecolor="#1f2328"))
        axes.plot(*path[: k + 1, :2].T, color="#0072b2", linewidth=1.0)
        axes.plot(*(pose[:2, None] + 0.35 * np.array([[0.0, np.cos(pose[2])],
                  [0.0, np.sin(pose[2])]])), color="#1f2328")  # fmt: skip
        axes.autoscale_view()
    figure.savefig(options.out)


if __name__ == "__main__":
    main()
