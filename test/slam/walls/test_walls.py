"""Association of lines with walls, held against the same rules in plain Python.

There a wall is the least-squares line of its segments by eigenvectors, and the common correction of
a keyframe is one least-squares problem with its prior as rows.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.walls.association import POOLED, _associate, _Gates, _Segments

GATE_CHI2 = 9.2  # 99 % of two degrees of freedom
GATE_SIGMAS = 3.0  # sigmas in the gates of distance and angle
JOINT_CHI2_PER_LINE = 6.0  # of the joint fit, per line
JOINT_GATE_SIGMAS = 6.0  # sigmas in the gates of the joint fit
MAX_DPHI = 0.35  # rad, 20 deg, between a line and its wall

GATES = _Gates(0.12, 0.1, 0.5)
NO_WALLS = np.zeros(0, POOLED)


def random_segments(seed, spread):
    """Return lines that keyframes with errors of `spread` (m, rad) see of six walls."""
    rng = np.random.default_rng(seed)
    phi = rng.uniform(-np.pi, np.pi, 3) + 0.02 * rng.normal(size=(2, 3))
    phi, rho = phi.ravel(), rng.uniform(0.5, 3.0, 6)
    rows = []
    for k in range(7):
        centre, error = rng.uniform(-0.5, 0.5, 2), rng.normal(0.0, spread, 3)
        for w in rng.permutation(6)[:4]:
            normal = np.array([np.cos(phi[w]), np.sin(phi[w])])
            along = np.array([-normal[1], normal[0]])
            low = rng.uniform(-2.0, 1.0)
            ends = rho[w] * normal + np.array([low, low + rng.uniform(0.3, 1.5)])[:, None] * along
            c, s = np.cos(error[2]), np.sin(error[2])
            off = rng.normal(0.0, 0.02) + (rng.random() < 0.1) * 0.1
            moved = (ends - centre) @ [[c, s], [-s, c]] + centre + error[:2] + off * normal
            facing = phi[w] + error[2] + rng.normal(0.0, 0.02)
            rows.append((k, moved, wrap_angle(facing), rng.uniform(1e-5, 1e-3), centre))
    keyframe, ends, facing, variance, centre = (np.array(column) for column in zip(*rows))
    return _Segments(keyframe, ends, facing, variance, centre)


class Wall:
    """A wall by the segments that it has."""

    def __init__(self):
        self.segments, self.low, self.high = [], np.inf, -np.inf

    def add(self, ends, facing):
        self.segments.append((ends, facing))
        lengths = np.array([np.hypot(*(e[1] - e[0])) for e, _ in self.segments])
        middles = np.array([e.mean(axis=0) for e, _ in self.segments])
        mean = lengths @ middles / lengths.sum()
        scatter = np.zeros((2, 2))
        for (e, _), length in zip(self.segments, lengths):
            # Simpson's rule is exact for squares.
            for weight, p in ((1, e[0]), (4, e.mean(axis=0)), (1, e[1])):
                scatter += length * weight / 6.0 * np.outer(p - mean, p - mean)
        normal = np.linalg.eigh(scatter)[1][:, 0]
        facings = np.array([(np.cos(f), np.sin(f)) for _, f in self.segments])
        self.normal = normal * np.sign(normal @ (lengths @ facings))
        self.rho = self.normal @ mean
        t = ends @ [-self.normal[1], self.normal[0]]
        self.low, self.high = min(self.low, t.min()), max(self.high, t.max())

    def off(self, segments, i):
        """Distance of the middle of a segment, and its angle."""
        phi = np.arctan2(self.normal[1], self.normal[0])
        away = self.normal @ segments.ends[i].mean(axis=0) - self.rho
        return away, wrap_angle(segments.phi[i] - phi)

    def chi2(self, segments, i):
        away, angle = self.off(segments, i)
        t = segments.ends[i] @ [-self.normal[1], self.normal[0]]
        gap = max(t.min() - self.high, self.low - t.max())
        if abs(angle) > MAX_DPHI or gap > GATES.max_gap:
            return np.inf
        sigma = GATES.distance / GATE_SIGMAS
        variance = (GATES.angle / GATE_SIGMAS) ** 2 + segments.v_phi[i]
        found = (away / sigma) ** 2 + angle**2 / variance
        return found if found < GATE_CHI2 else np.inf


def explained(segments, walls, chosen):
    """Drop the worst lines until one correction of the pose explains the others."""
    s_d, s_a = GATES.distance / JOINT_GATE_SIGMAS, GATES.angle / JOINT_GATE_SIGMAS
    chosen = dict(chosen)
    while chosen:
        rows, right = [np.diag([1 / s_d, 1 / s_d, 1 / s_a])], [np.zeros(3)]
        for i, w in chosen.items():
            away, angle = walls[w].off(segments, i)
            arm = segments.ends[i].mean(axis=0) - segments.centre[i]
            sigma = np.sqrt(s_a**2 + segments.v_phi[i])
            turned = walls[w].normal @ [-arm[1], arm[0]]
            rows.append(np.array([[*walls[w].normal / s_d, turned / s_d], [0, 0, 1 / sigma]]))
            right.append(np.array([away / s_d, angle / sigma]))
        x = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        rest = [float(np.square(b - A @ x).sum()) for A, b in zip(rows, right)]
        if sum(rest) <= JOINT_CHI2_PER_LINE * len(chosen):
            break
        del chosen[list(chosen)[int(np.argmax(rest[1:]))]]
    return chosen


def associated(segments):
    """The wall of each line, and the walls."""
    walls, of_line = [], np.full(len(segments.keyframe), -1)
    for k in np.unique(segments.keyframe):
        lines = np.flatnonzero(segments.keyframe == k)
        nearest = {}
        for i in lines:
            chi2 = [wall.chi2(segments, i) for wall in walls]
            if chi2 and min(chi2) < np.inf:
                nearest[i] = int(np.argmin(chi2))
        kept = explained(segments, walls, nearest)
        for i in lines:
            if i in nearest and i not in kept:
                continue
            if i not in kept:
                walls.append(Wall())
            of_line[i] = kept.get(i, len(walls) - 1)
            walls[of_line[i]].add(segments.ends[i], segments.phi[i])
    return of_line, walls


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.05])
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_lines_are_assigned_as_by_plain_python(spread, seed):
    segments = random_segments(seed, spread)
    of_line, pooled = _associate(segments, GATES, NO_WALLS)
    expected, walls = associated(segments)
    assert of_line.tolist() == expected.tolist()
    assert len(pooled) == len(walls)
    for found, wall in zip(pooled, walls):
        assert (np.cos(found["phi"]), np.sin(found["phi"])) == pytest.approx(wall.normal, abs=1e-7)
        assert found["rho"] == pytest.approx(wall.rho, abs=1e-7)
        assert (found["low"], found["high"]) == pytest.approx((wall.low, wall.high), abs=1e-6)


@pytest.mark.parametrize(("angle", "walls"), [(0.33, 1), (0.37, 2)])
def test_lines_at_more_than_20_degrees_are_of_different_walls(angle, walls):
    """However uncertain their directions are."""
    ends = np.array([[[2.0, -1.0], [2.0, 1.0]], [[2.0, -0.02], [2.0, 0.02]]])
    variance, origin = np.full(2, 0.5), np.zeros((2, 2))
    segments = _Segments(np.array([0, 1]), ends, np.array([0.0, angle]), variance, origin)
    assert len(_associate(segments, GATES, NO_WALLS)[1]) == walls


def test_the_examples_have_new_walls_shared_walls_and_dropped_lines():
    dropped = joined = 0
    for seed in range(20):
        of_line, pooled = _associate(random_segments(seed, 0.05), GATES, NO_WALLS)
        dropped += int((of_line < 0).sum())
        joined += len(of_line) - len(pooled)
    assert dropped > 20
    assert joined > 200
