"""A graph that is changed piece by piece, against a batch of what it then has."""

import itertools

import gtsam
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tccm_ros.geometry import compose2, spatial
from tccm_ros.slam.factors.factor import by_variables
from tccm_ros.slam.factors.keys import keyframe_key, view_key, wall_key
from tccm_ros.slam.factors.poses import BetweenKeyframes, Planar, PriorPose
from tccm_ros.slam.factors.views import BetweenViews, KeyframeView
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.incremental import IncrementalGraph
from tccm_ros.slam.graph.pose_graph import PoseGraph

RELINEARIZE = 0.005  # m, rad: larger motions are linearised again
SAME_MEASUREMENT = 1e-4  # m, rad, between equal factors
WILDFIRE = 1e-6  # m, rad: smaller motions end a round

STEP_COV = np.diag([0.02, 0.02, 0.01]) ** 2
WALL_COV = np.diag([0.01, 0.02]) ** 2
VIEW_COV = np.eye(6) * 0.02**2
MAX_M = 2.0 * RELINEARIZE
"""What is left (m, rad) where outliers of robust factors are weighed again: poses that move by less
than `RELINEARIZE` in a round are not. A factor too many or too few moves poses by centimetres."""


def key_of(k):
    return keyframe_key(k, 0.3 + 0.1 * (k % 3))


def truth_of(k):
    return np.array([0.3 * k, 0.5 * np.sin(0.4 * k), 0.2 * np.cos(0.4 * k)])


def noisy_step(a, b, random):
    ta, tb = truth_of(a), truth_of(b)
    c, s = np.cos(ta[2]), np.sin(ta[2])
    d = tb - ta
    exact = np.array([c * d[0] + s * d[1], -s * d[0] + c * d[1], d[2]])
    return exact + random.normal(0.0, [0.02, 0.02, 0.01])


def wall_seen(k, w, random):
    """The line of wall w, y = 3 + w or x = 3 + w, in keyframe k."""
    x, y, yaw = truth_of(k)
    phi = 0.5 * np.pi * (w % 2)
    rho = 3.0 + w - (x * np.cos(phi) + y * np.sin(phi))
    seen = random.normal([phi - yaw, rho], [0.01, 0.02])
    return WallObservation(key_of(k), wall_key(w), float(seen[0]), float(seen[1]), WALL_COV)


@st.composite
def histories(draw):
    """Steps of a graph: how many keyframes come, who sees what, what is registered anew."""
    steps = []
    count = 0
    for _ in range(draw(st.integers(2, 5))):
        new = draw(st.integers(1, 4))
        loops = draw(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), max_size=2))
        moved = draw(st.sampled_from([0.0, 0.5 * SAME_MEASUREMENT, 0.01, 0.05]))
        views = draw(st.sets(st.integers(0, count + new - 1), max_size=3))
        steps.append((new, loops, moved, sorted(views)))
        count += new
    return steps, draw(st.integers(0, 2**16))


@given(histories())
@settings(max_examples=25, deadline=None)
def test_incremental_solution_equals_the_batch_solution(history):
    """With all rounds that robust factors take: elsewhere the next solution goes on with them."""
    steps, seed = history
    random = np.random.default_rng(seed)
    kept, fixed, starts, measured = graph(), [], {}, {}
    count, changing_in = 0, {}
    for new, loops, moved, views in steps:
        fresh, poses = [], {}
        for k in range(count, count + new):
            start = truth_of(k) if not k else compose2(starts[key_of(k - 1)], np.array([0.3, 0, 0]))
            starts[key_of(k)] = poses[key_of(k)] = start
            first = PriorPose(key_of(k), truth_of(0), np.eye(3) * 1e-8)
            fresh.append(Planar(key_of(k), start) if k else first)
            if k:
                step = noisy_step(k - 1, k, random)
                fresh.append(BetweenKeyframes(key_of(k - 1), key_of(k), step, STEP_COV))
            fresh += [wall_seen(k, w, random) for w in (0, 1)]
        count += new
        named = by_variables(fresh)
        for a, b in loops:
            if a % count != b % count:
                step = noisy_step(a % count, b % count, random)
                loop = BetweenKeyframes(key_of(a % count), key_of(b % count), step, STEP_COV)
                named[loop] = loop
        changing, wanted = [], {}
        for k in views:
            wanted[view_key(k)] = starts[key_of(k)]
            changing.append(KeyframeView(key_of(k), view_key(k), np.zeros(3), STEP_COV))
        for i, j in itertools.pairwise(views):
            measured.setdefault((i, j), noisy_step(i, j, random))
            shifted = measured[i, j] + [moved, 0.0, 0.0]
            keys = view_key(i), view_key(j)
            changing.append(BetweenViews(*keys, spatial(shifted), VIEW_COV))
        fixed += named.values()
        before, changing_in = changing_in, by_variables(changing)
        gone = dict.fromkeys(before.keys() - changing_in.keys())
        kept.update({**named, **gone, **changing_in}, {**poses, **wanted})
        kept.relinearise(50)
        batch = optimum([*fixed, *changing], {**starts, **wanted})
        keys = [*starts, *wanted]
        found = kept.solution()
        away = np.array([found.pose(key) - batch.pose(key) for key in keys])
        assert np.abs(away).max() < MAX_M
        walls = np.array([found.plane(wall_key(w)) - batch.plane(wall_key(w)) for w in (0, 1)])
        assert np.abs(walls).max() < MAX_M


def optimum(factors, poses):
    """Return the batch's solution, to more digits than its own end asks for."""
    graph = PoseGraph(factors, poses)
    for _ in range(10):
        solution = graph.optimise()
    return solution


def graph():
    return IncrementalGraph(RELINEARIZE, WILDFIRE)


def small_graph():
    random = np.random.default_rng(1)
    kept = graph()
    factors = [PriorPose(key_of(0), truth_of(0), np.eye(3) * 1e-8)]
    factors += [wall_seen(0, w, random) for w in (0, 1)]
    kept.update(by_variables(factors), {key_of(0): truth_of(0)})
    return kept, factors, random


def test_a_factor_replaces_the_one_of_its_name():
    kept, factors, random = small_graph()
    old, new = ([wall_seen(0, 0, random) for _ in range(2)] for _ in range(2))
    kept.update(by_variables(old, "seen"), {})
    kept.update(by_variables(new, "seen"), {})
    kept.relinearise()
    batch = PoseGraph([*factors, *new], {key_of(0): truth_of(0)}).optimise()
    found = kept.solution().plane(wall_key(0))
    assert np.abs(found - batch.plane(wall_key(0))).max() < 1e-6
    without = PoseGraph([*factors, *old], {key_of(0): truth_of(0)}).optimise()
    assert np.abs(found - without.plane(wall_key(0))).max() > 1e-4


def test_a_factor_that_is_removed_counts_no_more():
    kept, factors, random = small_graph()
    kept.update({"seen": wall_seen(0, 0, random)}, {})
    assert np.abs(kept.solution().plane(wall_key(0)) - plane_of(factors)).max() > 1e-4
    kept.update({"seen": None}, {})
    kept.relinearise()
    assert np.abs(kept.solution().plane(wall_key(0)) - plane_of(factors)).max() < 1e-6


def plane_of(factors):
    batch = PoseGraph(factors, {key_of(0): truth_of(0)}).optimise()
    return batch.plane(wall_key(0))


def test_covariance_is_recomputed_after_many_new_factors():
    kept, _, random = small_graph()
    before = kept.solution().covariance(wall_key(0))
    kept.update(by_variables([wall_seen(0, 0, random) for _ in range(8)], "seen"), {})
    after = kept.solution().covariance(wall_key(0))
    # The angle's variance is that of nine lines, and no longer of one.
    assert after[0, 0] < before[0, 0] / 4.0


def test_variables_of_the_newest_factors_stay_at_the_root_of_the_tree():
    """Elsewhere the covariance of the newest keyframe takes seconds in a large map."""
    kept, _, random = small_graph()
    pose = truth_of(0)
    for k in range(1, 60):
        pose = compose2(pose, noisy_step(k - 1, k, random))
        step = noisy_step(k - 1, k, random)
        factors = [
            Planar(key_of(k), pose),
            BetweenKeyframes(key_of(k - 1), key_of(k), step, STEP_COV),
        ]
        factors += [wall_seen(k, w, random) for w in (0, 1)]
        if k > 9 and k % 3 == 0:
            a = k % 7
            loop = BetweenKeyframes(key_of(a), key_of(k), noisy_step(a, k, random), STEP_COV)
            factors.append(loop)
        kept.update(by_variables(factors), {key_of(k): pose})
        kept.relinearise()
        assert gtsam.DefaultKeyFormatter(key_of(k).symbol) in root_of(kept)


def root_of(kept):
    """Return the names of the variables of the root of ISAM2's tree."""
    label = next(line for line in kept._isam.dot().splitlines() if "label" in line)
    return label.split('"')[1].replace(",", " ").split()
