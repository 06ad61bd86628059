"""`tccm evaluate` for trajectories: errors of a result relative to a truth file, as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.errors import LogError
from tccm_ros.evaluate.trajectory_errors import (
    Errors,
    Order,
    absolute_errors,
    align,
    distance_errors,
    pairs_that_meet,
    poses_at,
    relation_errors,
)
from tccm_ros.evaluate.truth_files import (
    STAMP_UNITS,
    Reference,
    Relations,
    read_stamps,
    read_truth,
)
from tccm_ros.geometry import inverse
from tccm_ros.results.trajectory import Trajectory, read_tum

DISTANCES = (1.0, 5.0, 10.0, 20.0, 50.0)
"""Path lengths of relative errors, m."""


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryScore:
    """Errors by name, and the aligned positions of both trajectories for a plot.

    Attributes
    ----------
    errors
        Errors by name of the measure.
    missing
        Number of truth rows without a pose in the trajectory.
    positions, truth
        float64 (N, 2) and (M, 2), m; empty for relations.
    stamp_unit
        Unit of the truth's stamps, a key of `STAMP_UNITS`.
    """

    errors: Mapping[str, Errors]
    missing: int
    positions: Float64 = field(default_factory=lambda: np.zeros((0, 2)))
    truth: Float64 = field(default_factory=lambda: np.zeros((0, 2)))
    stamp_unit: str = "s"

    def to_json(self) -> dict[str, Any]:
        """Return the statistics in m and deg, rounded to 1e-6."""
        return {"missing": self.missing, **{k: _statistics(e) for k, e in self.errors.items()}}

    def text(self) -> str:
        """Return the statistics as text, one row per measure."""
        head = f"{'measure':28} {'pairs':>7} {'mean m':>18} {'rms m':>8} {'max m':>8}"
        rows = [f"{head} {'mean deg':>17}"]
        for name, errors in self.errors.items():
            f = _statistics(errors)
            rows.append(
                f"{name:28} {f['count']:7d} {f['mean_m']:8.4f} +- {f['std_m']:6.4f} "
                f"{f['rms_m']:8.4f} {f['max_m']:8.4f} {f['mean_deg']:8.3f} +- {f['std_deg']:5.3f}"
            )
        if self.missing:
            rows.append(f"{self.missing} rows of the truth have no pose in the trajectory")
        if self.stamp_unit != "s":
            rows.append(f"the stamps of the truth are taken as {self.stamp_unit}, expected s")
        return "\n".join(rows)


def _statistics(errors: Errors) -> dict[str, Any]:
    count = len(errors)
    t = errors.translation if count else np.zeros(1)
    r = np.degrees(errors.rotation) if count else np.zeros(1)
    figures = {
        "mean_m": t.mean(),
        "std_m": t.std(),
        "rms_m": np.sqrt(np.mean(t**2)),
        "median_m": np.median(t),
        "max_m": t.max(),
        "mean_deg": r.mean(),
        "std_deg": r.std(),
        "median_deg": np.median(r),
        "max_deg": r.max(),
    }
    return {"count": count, **{k: round(float(v), 6) for k, v in figures.items()}}


def score_trajectory(
    result: Path | str, truth: Path | str, *, stamps: Path | str | None = None
) -> TrajectoryScore:
    """Compare the trajectory of a result with truth.

    Stamps of the truth that are not in the time of the trajectory are tried as ms, us and ns.

    Parameters
    ----------
    result
        A folder with trajectory.tum, or a trajectory file.
    truth
        A trajectory (TUM), relations, or a reference by scan index.
    stamps
        stamps.csv of the imported log, which matches relations and references of a log whose stamps
        stepped back. By default it is searched for next to the result and the truth.

    Raises
    ------
    LogError
        If a file cannot be read, or the truth is of another time than the trajectory.
    """
    path = Path(result)
    path = path / "trajectory.tum" if path.is_dir() else path
    found = read_tum(path)
    if not len(found):
        raise LogError(f"{path}: no rows")
    errors = []
    for unit, per_second in STAMP_UNITS.items():
        try:
            known = read_truth(truth, per_second=per_second)
            return replace(_score(found, path, known, Path(truth), stamps), stamp_unit=unit)
        except LogError as error:
            errors.append(error)
    raise errors[0]


def _score(
    found: Trajectory,
    path: Path,
    known: Trajectory | Relations | Reference,
    truth: Path,
    stamps: Path | str | None,
) -> TrajectoryScore:
    """Compare a trajectory with truth; `path` and `truth` name their files."""
    index, logged = _find_stamps(stamps, path.parent, truth.parent)
    if isinstance(known, Relations):
        score = _score_relations(found, _restamped(known, logged))
    elif isinstance(known, Reference):
        score = _score_reference(found, known, index)
    else:
        score = _score_trajectory(found, known)
    if not any(len(errors) for errors in score.errors.values()):
        start, end = found.stamps[[0, -1]]
        raise LogError(
            f"{truth}: no row is in the time of {path}, {start:.3f} to {end:.3f} s, whether its "
            f"stamps are {', '.join(STAMP_UNITS)}; are they relative to the start?"
        )
    return score


def _find_stamps(given: Path | str | None, *folders: Path) -> tuple[dict[int, int], dict[int, int]]:
    """Return the bag's stamps by scan index, and by logged stamp, ns."""
    paths = [Path(given)] if given is not None else [f / "stamps.csv" for f in folders]
    for path in paths:
        if given is not None or path.is_file():
            return read_stamps(path), read_stamps(path, key="ipc_time")
    return {}, {}


def _restamped(truth: Relations, logged: dict[int, int]) -> Relations:
    """Replace logged stamps by those in the bag, if the log's importer changed them."""
    ends = [
        np.array([logged.get(int(t), int(t)) for t in stamps], np.int64)
        for stamps in (truth.from_ns, truth.to_ns)
    ]
    return Relations(ends[0], ends[1], truth.deltas)


def _score_trajectory(found: Trajectory, truth: Trajectory) -> TrajectoryScore:
    T_true, known = poses_at(truth.stamps_ns, truth.T_map_base, found.stamps_ns)
    poses, T_true = found.T_map_base[known], T_true[known]
    if len(poses) < 2:
        return TrajectoryScore({}, len(known))
    errors = {
        "absolute, aligned": absolute_errors(poses, T_true),
        "absolute, as it is": absolute_errors(poses, T_true, aligned=False),
    }
    for distance in DISTANCES:
        over = distance_errors(poses, T_true, distance)
        if len(over):
            errors[f"relative over {distance:g} m"] = over
    return _with_positions(errors, int((~known).sum()), poses, T_true)


def _score_relations(found: Trajectory, truth: Relations) -> TrajectoryScore:
    T_from, known_from = poses_at(found.stamps_ns, found.T_map_base, truth.from_ns)
    T_to, known_to = poses_at(found.stamps_ns, found.T_map_base, truth.to_ns)
    known = known_from & known_to
    T_from, T_to, deltas = T_from[known], T_to[known], truth.deltas[known]
    errors = {
        "relations (Kuemmerle)": relation_errors(T_from, T_to, deltas),
        "relations (Cartographer)": relation_errors(T_from, T_to, deltas, Order.CARTOGRAPHER),
    }
    return TrajectoryScore(errors, int((~known).sum()))


def _score_reference(found: Trajectory, truth: Reference, index: dict[int, int]) -> TrajectoryScore:
    asked = truth.stamps_ns
    if index:
        asked = np.array([index.get(int(i), -1) for i in truth.scan_index], np.int64)
    poses, known = poses_at(found.stamps_ns, found.T_map_base, asked)
    poses, T_true = poses[known], truth.poses[known]
    if len(poses) < 2:
        return TrajectoryScore({}, len(known))
    errors = {"absolute, aligned": absolute_errors(poses, T_true)}
    rows = np.arange(len(poses) - 1)
    pairs = {
        "neighbouring rows": np.stack([rows, rows + 1], axis=1),
        "rows < 3 m, path > 10 m": pairs_that_meet(T_true[:, :3, 3]),
    }
    for name, ij in pairs.items():
        i, j = ij.T
        deltas = inverse(T_true[i]) @ T_true[j]
        errors[name] = relation_errors(poses[i], poses[j], deltas)
    return _with_positions(errors, int((~known).sum()), poses, T_true)


def _with_positions(
    errors: Mapping[str, Errors], missing: int, poses: Float64, truth: Float64
) -> TrajectoryScore:
    T = align(poses[:, :3, 3], truth[:, :3, 3])
    return TrajectoryScore(errors, missing, (T @ poses)[:, :2, 3], truth[:, :2, 3])
