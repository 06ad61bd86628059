"""Rooms at random whose furniture changes while the robot is elsewhere: events, ghosts and ids.

    python bench/bench_changes.py [--first 1] [--sequences 60] [--verbose]

The rooms are those of `random_changes`; the map is solved after each tilt cycle, as a robot does
it. Each true event must be told once and no other, with one id for each piece, and the last map
must have what is there and nothing else.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "test" / "helpers")]

from changing_rooms import solved, told  # noqa: E402
from experiments_surfaces import score  # noqa: E402
from random_changes import Piece, in_map, random_rooms  # noqa: E402

from tccm_ros.config import Config  # noqa: E402
from tccm_ros.mapping.surface_slam import SurfaceSlam  # noqa: E402
from tccm_ros.replay.processors import Pipeline  # noqa: E402
from tccm_ros.scene.changes import Change, ChangeKind, MapChanges  # noqa: E402
from tccm_sim.engine import Simulation  # noqa: E402
from tccm_sim.options import Options  # noqa: E402

NEAR = np.array([0.12, 0.12, 0.02])
"""Middles of outlines that are measured with scan lines at 5 cm are so near to the truth, m."""


@dataclass(frozen=True)
class Outcome:
    """What came of a sequence.

    Attributes
    ----------
    true
        Number of true events.
    untold
        Names of pieces and kinds of true events that were not told.
    wrong
        Events that are not true, or were told before.
    ids
        Names of pieces of which two ids were told, or an id that another piece has.
    missing, ghosts
        Names of pieces that the last map does not have, and ids of its surfaces that are none.
    """

    true: int
    untold: tuple[tuple[str, ChangeKind], ...]
    wrong: tuple[Change, ...]
    ids: tuple[str, ...]
    missing: tuple[str, ...]
    ghosts: tuple[int, ...]

    @property
    def is_right(self) -> bool:
        """Whether all is told, and nothing is wrong, missing or left over."""
        return not (self.untold or self.wrong or self.ids or self.missing or self.ghosts)

    @property
    def told(self) -> int:
        """Number of true events that were told."""
        return self.true - len(self.untold)


def slam_inputs(simulation: Simulation) -> list[object]:
    """Return what the SLAM processor is given while the robot drives, in order."""
    topics = simulation.rig.topics
    roles = {
        topics.tilt_scan: "tilt_scan", topics.scan: "scan", topics.joint_states: "joint_states",
        topics.odom: "odom", "/robot_description": "robot_description", "/tf_static": "tf_static",
    }  # fmt: skip
    pipeline, inputs = Pipeline(Config(), expects_odometry=True), []
    add = pipeline.slam.add

    def note(event: object) -> object:
        inputs.append(event)
        return add(event)

    pipeline.slam.add = note
    for message in simulation.run():
        for record in message.records:
            pipeline.add(roles[message.topic], record)
    pipeline.finish()
    return inputs


def outcome(inputs: Iterable[object], pieces: list[Piece], simulation: Simulation) -> Outcome:
    """Tell what changes, as a robot does, and compare it with what happened."""
    slam = SurfaceSlam(Config())
    found = [e for e in told(solved(inputs, slam), MapChanges()) if e.object_id < 0]
    untold, wrong = judged(found, pieces)
    result = score(slam.solve(), simulation)
    return Outcome(
        sum(len(piece.kinds) for piece in pieces),
        untold,
        wrong,
        _confused(found, [_piece_of(event, pieces) for event in found]),
        tuple(m.label for m in result.matches if not m.is_found),
        result.false,
    )


def judged(
    found: list[Change], pieces: list[Piece]
) -> tuple[tuple[tuple[str, ChangeKind], ...], tuple[Change, ...]]:
    """Return the true events that were not told, and those that are wrong or were told before."""
    untold = {(p.name, kind) for p in pieces for kind in p.kinds}
    wrong = []
    for event in found:
        piece = _piece_of(event, pieces)
        key = (piece.name if piece else "", event.kind)
        if key not in untold:
            wrong.append(event)
        untold.discard(key)
    return tuple(sorted(untold)), tuple(wrong)


def _confused(found: list[Change], owners: list[Piece | None]) -> tuple[str, ...]:
    """Return the names of pieces that have two ids, or one that another piece has."""
    ids: dict[str, set[int]] = {}
    for piece, event in zip(owners, found):
        if piece is not None:
            ids.setdefault(piece.name, set()).update(event.ids_before, event.ids_after)
    holders = Counter(identity for own in ids.values() for identity in own)
    return tuple(n for n, own in ids.items() if len(own) > 1 or any(holders[k] > 1 for k in own))


def _piece_of(event: Change, pieces: list[Piece]) -> Piece | None:
    """Return the piece of which an event tells where it is: its poses are true; None: none."""
    for piece in pieces:
        is_moved = event.kind == ChangeKind.MOVED
        before = event.T_before is None or _is_near(event.T_before, piece.first)
        after = event.T_after is None or _is_near(
            event.T_after, piece.last if is_moved else piece.first
        )
        if before and after:
            return piece
    return None


def _is_near(T: NDArray[np.float64], place: NDArray[np.float64]) -> bool:
    return bool((np.abs(T[:3, 3] - place) <= NEAR).all())


def describe(event: Change) -> str:
    """Return an event with its places."""
    places = [
        "nowhere" if T is None else "({:.2f}, {:.2f}, {:.2f})".format(*T[:3, 3])
        for T in (event.T_before, event.T_after)
    ]
    return f"{event}, {places[0]} -> {places[1]}"


def main() -> None:
    """Print a row for each sequence, and their sums."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--first", type=int, default=1, help="seed of the first sequence")
    parser.add_argument("--sequences", type=int, default=60, help="number of sequences")
    parser.add_argument("--verbose", action="store_true", help="print pieces and wrong events")
    args = parser.parse_args()
    print("| seed | true events | told | wrong or twice | ids confused | not found | ghosts |")
    print("|---|---|---|---|---|---|---|")
    outcomes, fates = [], Counter[str]()
    for seed in range(args.first, args.first + args.sequences):
        world, furniture = random_rooms(seed, Options())
        simulation = Simulation(world, seed, Options())
        pieces = in_map(furniture, simulation)
        fates.update(p.fate for p in pieces)
        found = outcome(slam_inputs(simulation), pieces, simulation)
        outcomes.append(found)
        print(
            f"| {seed} | {found.true} | {found.told} | {len(found.wrong)} | "
            f"{', '.join(found.ids)} | {', '.join(found.missing)} | {len(found.ghosts)} |",
            flush=True,
        )
        if args.verbose:
            for piece in pieces:
                print(f"  {piece.name}: {piece.first.round(2)} -> {piece.last.round(2)}")
            print("".join(f"  wrong: {describe(event)}\n" for event in found.wrong), end="")
    right = sum(found.is_right for found in outcomes)
    print(
        f"\n{right} of {len(outcomes)} sequences without a fault; "
        f"{sum(o.told for o in outcomes)} of {sum(o.true for o in outcomes)} events told, "
        f"{sum(len(o.wrong) for o in outcomes)} wrong or twice; "
        f"ids confused in {sum(bool(o.ids) for o in outcomes)} sequences; "
        f"{sum(len(o.missing) for o in outcomes)} surfaces not found, "
        f"{sum(len(o.ghosts) for o in outcomes)} ghosts"
    )
    print("pieces: " + ", ".join(f"{count} {fate}" for fate, count in sorted(fates.items())))


if __name__ == "__main__":
    main()
