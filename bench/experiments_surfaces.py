"""The experiments of docs/design/experiments/surface_map.md, as Markdown.

- the table of the surface mapping paper's Section V on the simulated flat, published and ours;
- its main result: views on full-SLAM poses against views frozen at the estimate of their time,
  before and after registration, on the flat and on the ring;
- flats at random: which surfaces are found, how well, and what is false.
"""

from __future__ import annotations

import argparse
import bisect
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(Path(__file__).resolve().parent)]

from in_view import edge_errors, seen_fraction, true_hits, true_outlines  # noqa: E402
from random_flats import random_flat  # noqa: E402

from tccm_ros.config import Config  # noqa: E402
from tccm_ros.evaluate.surfaces import (  # noqa: E402
    SurfaceMatch,
    SurfaceScore,
    score_surfaces,
)
from tccm_ros.geometry import inverse, spatial, transform  # noqa: E402
from tccm_ros.mapping.surface_slam import SurfaceSolution  # noqa: E402
from tccm_ros.records import PosedScan, Scan, ScanPose, Surface  # noqa: E402
from tccm_ros.replay.processors import Pipeline  # noqa: E402
from tccm_ros.results.models import SurfacesFile  # noqa: E402
from tccm_ros.results.numbers import json_text  # noqa: E402
from tccm_sim import truth  # noqa: E402
from tccm_sim.engine import (  # noqa: E402
    EPOCH_NS,
    Simulation,
)
from tccm_sim.options import Options  # noqa: E402
from tccm_sim.world import World  # noqa: E402
from tccm_sim.worlds import build_world  # noqa: E402

Array = NDArray[np.float64]

IN_VIEW = 0.7
"""A surface of which a smaller fraction was hit by any beam was not in view."""

GOOD = 0.7
"""Overlap with the true outline of a surface that is found well."""

RIGHT = {
    "counter": {"counter"},
    "table": {"table"},
    "side table": {"table", "other"},
    "bench": {"seat"},
    "chair": {"seat"},
    "shelf": {"shelf"},
    "ledge": {"ledge"},
    "sideboard": {"other"},
}
"""The labels that are right for furniture of `random_flats`: none means a sideboard; a small side
table looks like a stool."""

HARD = Options(sigma=0.006, odometry=2.0, heading_drift=0.02)
"""6 mm of noise, and odometry with twice the usual errors that turns away by 20 mrad/m."""


@dataclass(frozen=True)
class Run:
    """One simulated drive: the pipeline at its end, the truth, live poses by stamp, and what the
    tilting laser's beams hit, float64 (N, 3) in map.
    """

    pipeline: Pipeline
    simulation: Simulation
    live: list[tuple[int, Array]]
    hits: Array

    def true_poses(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return the true poses of the base in map, float64 (V, 4, 4)."""
        times = np.asarray((stamps_ns - EPOCH_NS) * 1e-9, np.float64)
        T_map_world = truth.map_from_world(self.simulation)
        return np.asarray(T_map_world @ self.simulation.true_poses(times), np.float64)

    def frozen_poses(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Return what was believed at the time of each stamp, float64 (V, 4, 4)."""
        known = [stamp for stamp, _ in self.live]
        rows = [max(bisect.bisect_right(known, int(s)) - 1, 0) for s in stamps_ns]
        return spatial(np.array([self.live[row][1] for row in rows]))


def play(world: World, seed: int, options: Options, config: Config) -> Run:
    """Drive through a world and feed the pipeline."""
    simulation = Simulation(world, seed, options)
    topics = simulation.rig.topics
    roles = {
        topics.tilt_scan: "tilt_scan", topics.scan: "scan", topics.joint_states: "joint_states",
        topics.odom: "odom", "/robot_description": "robot_description", "/tf_static": "tf_static",
    }  # fmt: skip
    pipeline, live = Pipeline(config, expects_odometry=True), [(-1, np.zeros(3))]
    hits, walls = [np.zeros((0, 3))], pipeline.slam.wall_slam
    add_scan = walls.add_scan

    def noted(scan: PosedScan) -> ScanPose:
        found = add_scan(scan)
        live.append((found.stamp_ns, found.pose))
        return found

    walls.add_scan = noted
    for message in simulation.run():
        for record in message.records:
            pipeline.add(roles[message.topic], record)
            if isinstance(record, Scan) and message.topic == topics.tilt_scan:
                hits.append(true_hits(simulation, record))
    pipeline.finish()
    return Run(pipeline, simulation, live, np.concatenate(hits))


def solve(run: Run, *, registration: bool = True) -> SurfaceSolution:
    """Build the map, with or without the registration of views."""
    slam = run.pipeline.slam
    surfaces = slam.config.surfaces.model_copy(update={"registration": registration})
    slam.config = slam.config.model_copy(update={"surfaces": surfaces})
    return slam.solve()


def misalignments(solution: SurfaceSolution, T_map_view: Array, T_true: Array) -> Array:
    """Return the distance of two views of one surface, float64 (N, 3), m.

    Each view puts the surface's middle where its own pose is wrong; floors are left out.
    """
    error = T_map_view @ inverse(T_true)
    rows = [np.zeros((0, 3))]
    for surface, members in zip(solution.surfaces, solution.mapped.members):
        views = sorted({member.view for member in members})
        if surface.label == "floor" or len(views) < 2:
            continue
        middle = np.asarray(surface.centroid)[None]
        places = np.concatenate([transform(error[v], middle) for v in views])
        a, b = np.triu_indices(len(views), 1)
        rows.append(places[a] - places[b])
    return np.concatenate(rows)


def score(solution: SurfaceSolution, simulation: Simulation) -> SurfaceScore:
    """Compare a map with the truth of its world."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "found.json").write_text(
            json_text(SurfacesFile.of(solution.surfaces, solution.floor_z, "map"))
        )
        (folder / "truth.json").write_text(json.dumps(truth.surfaces(simulation)))
        return score_surfaces(folder / "found.json", folder / "truth.json")


def fractions(run: Run, score: SurfaceScore) -> list[float]:
    """Return the fraction of each true surface that was in view, in the order of the score."""
    outlines = true_outlines(run.simulation)
    return [
        seen_fraction(outline, match.height, run.hits)
        for outline, match in zip(outlines, score.matches)
    ]


def pair(values: Array) -> str:
    """Return mean and largest, mm."""
    if not len(values):
        return "-"
    return f"{1e3 * values.mean():.1f} / {1e3 * values.max():.1f}"


def view_errors(name: str, run: Run) -> Iterator[str]:
    """Yield rows: frozen poses, full SLAM, and full SLAM with registered views."""
    before, after = solve(run, registration=False), solve(run)
    stamps = after.view_stamps_ns
    true = run.true_poses(stamps)
    for kind, solution, poses in (
        ("frozen at their time", after, run.frozen_poses(stamps)),
        ("full SLAM", before, before.T_map_views),
        ("full SLAM, registered", after, after.T_map_views),
    ):
        place = np.linalg.norm(poses[:, :2, 3] - true[:, :2, 3], axis=1)
        distances = misalignments(solution, poses, true)
        flat, height = np.hypot(distances[:, 0], distances[:, 1]), np.abs(distances[:, 2])
        cells = [name, kind, pair(place), len(distances), pair(flat), pair(height)]
        yield f"| {' | '.join(map(str, cells))} |"


def section_five(ours: Run, seed_run: Run) -> None:
    """Print which surfaces of the flat either pipeline finds."""
    print("### Section V: the published pipeline and ours on the flat\n")
    ours_map, seed_map = solve(ours), solve(seed_run, registration=False)
    a, b = score(seed_map, seed_run.simulation), score(ours_map, ours.simulation)
    views = [{s.id: len(s.views) for s in m.surfaces} for m in (seed_map, ours_map)]
    print("| surface | in view | published: overlap | mm | views | ours: overlap | mm | views |")
    print("|---|---|---|---|---|---|---|---|")
    for old, new, fraction in zip(a.matches, b.matches, fractions(ours, b)):
        cells = [f"{fraction:.2f}"]
        for match, count in ((old, views[0]), (new, views[1])):
            if match.is_found and match.found is not None:
                cells += [f"{match.overlap:.2f}", f"{1e3 * match.height_error:+.1f}"]
                cells.append(str(count[match.found]))
            else:
                cells += ["missed", "", ""]
        print(f"| {old.label} | {' | '.join(cells)} |")
    print(f"| found | | {a.found} of {len(a.matches)} | | | {b.found} of {len(b.matches)} | | |")
    print(f"| false, 0.1 m2 and more | | {len(a.false)} | | | {len(b.false)} | | |\n")


@dataclass
class Tally:
    """What all flats together show of the surfaces in view.

    Attributes
    ----------
    overlaps, height_errors
        Of each, the latter in m.
    corners
        Number of corners found of each true rectangle.
    edges, flush
        Errors of the edges in view, m; those of `flush` are beside another solid of their height.
    seen
        Errors of those of `edges` that the map says were seen, m.
    false
        Number of false surfaces.
    labels
        How often what stands there (its name in the world) was given each label.
    """

    overlaps: list[float] = field(default_factory=list)
    height_errors: list[float] = field(default_factory=list)
    corners: list[int] = field(default_factory=list)
    edges: list[float] = field(default_factory=list)
    flush: list[float] = field(default_factory=list)
    seen: list[float] = field(default_factory=list)
    false: int = 0
    labels: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, match: SurfaceMatch, outline: Polygon, found: Surface | None) -> None:
        """Add a true surface in view, with the one that was found for it."""
        self.overlaps.append(match.overlap)
        if found is None or not match.is_found:
            return
        self.height_errors.append(abs(match.height_error))
        if len(outline.exterior.coords) == 5:
            self.corners.append(len(found.boundary))
        kind = match.label.split(" of ")[0].split(" at ")[0].rstrip("0123456789 ")
        self.labels[kind, found.label] += 1

    def names(self) -> str:
        """Return how many labels are right, wrong, and ``other`` where there is a right one."""
        right = sum(n for (kind, label), n in self.labels.items() if label in RIGHT[kind])
        total = self.labels.total()
        unsure = sum(
            n
            for (kind, label), n in self.labels.items()
            if label == "other" and label not in RIGHT[kind]
        )
        return (
            f"{total} labels: {right / total:.1%} right, {(total - right - unsure) / total:.1%} "
            f"wrong, {unsure / total:.1%} unsure"
        )

    def text(self) -> str:
        """Return the summary and the confusion table, as Markdown."""
        overlaps = np.array(self.overlaps)
        every = self.edges + self.flush
        lines = [
            f"{len(overlaps)} surfaces in view: mean overlap {overlaps.mean():.3f}, "
            f"{np.mean(overlaps >= GOOD):.1%} at {GOOD} or more, {self.false} false; heights "
            f"within {1e3 * max(self.height_errors):.1f} mm; {len(every)} edges in view "
            f"{1e3 * np.sqrt(np.mean(np.square(every))):.1f} mm rms, {len(self.edges)} of them "
            f"where nothing goes on at their height "
            f"{1e3 * np.sqrt(np.mean(np.square(self.edges))):.1f} mm, {len(self.seen)} of these "
            f"called seen {1e3 * np.sqrt(np.mean(np.square(self.seen))):.1f} mm, median of all "
            f"{1e3 * np.median(np.abs(every)):.1f} mm; median corners of a true "
            f"rectangle {np.median(self.corners):.0f}",
            "",
            self.names(),
            "",
        ]
        names = sorted({label for _, label in self.labels})
        lines += [f"| is | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
        for kind in sorted({kind for kind, _ in self.labels}):
            lines.append(f"| {kind} | {' | '.join(str(self.labels[kind, n]) for n in names)} |")
        return "\n".join(lines)


def flats(first: int, count: int) -> None:
    """Print how well flats at random are found, every other one with `HARD` noise."""
    print("### Flats at random, surfaces of 0.1 m2 and more\n")
    print(
        "| flat | noise | surfaces | overlap >= 0.7 | of these in view | overlap >= 0.7 | "
        "largest height error, mm | edges in view | error, mm rms | within a spacing | false |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    tally = Tally()
    for seed in range(first, first + count):
        options = HARD if seed % 2 else Options()
        run = play(random_flat(seed, options), seed, options, Config())
        solution = solve(run)
        result = score(solution, run.simulation)
        large = [m for m in result.matches if m.area >= 0.1]
        by_id = {surface.id: surface for surface in solution.surfaces}
        seen = []
        for match, outline, fraction in zip(
            result.matches, true_outlines(run.simulation), fractions(run, result)
        ):
            if match in large and fraction >= IN_VIEW:
                seen.append(match)
                tally.add(match, outline, by_id.get(-1 if match.found is None else match.found))
        errors = [abs(match.height_error) for match in large if match.is_found]
        edges = edge_errors(solution, result, run.simulation, run.hits)
        tally.edges += edges[edges[:, 2] == 0.0, 0].tolist()
        tally.flush += edges[edges[:, 2] > 0.0, 0].tolist()
        tally.seen += edges[(edges[:, 2] == 0.0) & (edges[:, 3] > 0.0), 0].tolist()
        tally.false += len(result.false)
        within = np.count_nonzero(np.abs(edges[:, 0]) <= edges[:, 1])
        for match in seen:
            if match.overlap < GOOD:
                print(f"in view, overlap {match.overlap:.2f}: {match.label}", file=sys.stderr)
        print(
            f"| {seed} | {'hard' if seed % 2 else 'usual'} | {len(large)} | "
            f"{sum(match.overlap >= GOOD for match in large)} | {len(seen)} | "
            f"{sum(match.overlap >= GOOD for match in seen)} | "
            f"{1e3 * max(errors, default=0.0):.1f} | {len(edges)} | "
            f"{1e3 * np.sqrt(np.mean(np.square(edges[:, 0]))):.0f} | {within} | "
            f"{len(result.false)} |",
            flush=True,
        )
    print(f"\n{tally.text()}\n")


def compare_views(flat: Run) -> None:
    """Print the distances of views, on frozen poses and on those of the graph."""
    print(
        "### Views on full-SLAM poses, and frozen at the estimate of their time; mean / max, mm\n"
    )
    print("| world | poses | error of the views | pairs | distance in x, y | distance in height |")
    print("|---|---|---|---|---|---|")
    print("\n".join(view_errors("flat", flat)), flush=True)
    for name, world, options in (("ring", "ring", Options()), ("flat, hard", "flat", HARD)):
        run = play(build_world(world, options), 1, options, Config())
        print("\n".join(view_errors(name, run)), flush=True)
    print()


def main() -> None:
    """Run what is asked for; all of it without arguments."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("five", "claim", "flats"), help="one of the parts")
    parser.add_argument("--flats", type=int, default=8, help="how many flats at random")
    parser.add_argument("--first", type=int, default=1, help="seed of the first of them")
    arguments = parser.parse_args()
    config, options = Config(), Options()
    if arguments.only in (None, "five", "claim"):
        flat = play(build_world("flat", options), 1, options, config)
        if arguments.only != "claim":
            seed = config.surfaces.model_copy(update={"segmentation": "seed"})
            published = config.model_copy(update={"surfaces": seed})
            section_five(flat, play(build_world("flat", options), 1, options, published))
        if arguments.only != "five":
            compare_views(flat)
    if arguments.only in (None, "flats"):
        flats(arguments.first, arguments.flats)


if __name__ == "__main__":
    main()
