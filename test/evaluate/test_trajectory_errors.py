from decimal import Decimal

import numpy as np
import pytest

from tccm_ros.errors import LogError
from tccm_ros.evaluate.plot import plot_score
from tccm_ros.evaluate.score import score_trajectory
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
    Reference,
    Relations,
    read_reference,
    read_relations,
    read_truth,
)
from tccm_ros.geometry import between2, compose2, quaternion, spatial
from tccm_ros.results.trajectory import Trajectory, read_tum

START = 976_052_857_337_530_000


def circle(count=80, step=0.5):
    poses = [np.zeros(3)]
    for _ in range(count - 1):
        poses.append(compose2(poses[-1], [step, 0.0, 2 * np.pi * 2 / count]))
    return np.stack(poses)


def write_tum(path, poses, stamps):
    rows = []
    for stamp, T in zip(stamps, spatial(poses)):
        numbers = " ".join(f"{v:.9f}" for v in (*T[:3, 3], *quaternion(T)))
        rows.append(f"{stamp // 10**9}.{stamp % 10**9:09d} {numbers}")
    path.write_text("# a comment\n" + "\n".join(rows) + "\n")
    return path


def stamps_of(count):
    return START + np.arange(count) * 200_000_001


def write_relations(path, poses, stamps, pairs):
    rows = []
    for i, j in pairs:
        x, y, yaw = between2(poses[i], poses[j])
        ends = " ".join(f"{s // 10**9}.{s % 10**9:09d}" for s in (stamps[i], stamps[j]))
        rows.append(f"{ends} {x:.9f} {y:.9f} 0 0 0 {yaw:.9f}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_stamps_keep_their_nanoseconds(tmp_path):
    poses, stamps = circle(), stamps_of(80)
    read = read_tum(write_tum(tmp_path / "a.tum", poses, stamps))
    assert np.array_equal(read.stamps_ns, stamps)
    assert np.allclose(read.T_map_base, spatial(poses), atol=1e-8)


def test_the_kind_of_a_truth_file_is_found_from_its_numbers(tmp_path):
    poses, stamps = circle(), stamps_of(80)
    tum = write_tum(tmp_path / "a.txt", poses, stamps)
    relations = write_relations(tmp_path / "b.txt", poses, stamps, [(0, 5), (3, 40)])
    reference = tmp_path / "c.txt"
    reference.write_text(
        f"# head\n169 {START / 1e9:.6f} 0.6 -0.03 -0.35 0.7 -0.015 -0.46\n"
        f"178 {START / 1e9 + 1:.6f} 0.7 -0.1 -0.93 0.7 -0.018 -1.02\n"
    )
    assert isinstance(read_truth(tum), Trajectory)
    assert isinstance(read_truth(relations), Relations)
    assert isinstance(read_truth(reference), Reference)
    assert list(read_reference(reference).scan_index) == [169, 178]
    assert read_relations(relations).to_ns[1] == stamps[40]


def test_relations_may_be_planar(tmp_path):
    """Five columns say the same as eight."""
    poses, stamps, pairs = circle(), stamps_of(80), [(0, 5), (3, 40)]
    whole = read_relations(write_relations(tmp_path / "a.relations", poses, stamps, pairs))
    rows = [line.split() for line in (tmp_path / "a.relations").read_text().splitlines()]
    planar = tmp_path / "b.txt"
    planar.write_text("".join(f"{a} {b} {x} {y} {yaw}\n" for a, b, x, y, *_, yaw in rows))
    found = read_truth(planar)
    assert isinstance(found, Relations)
    assert np.array_equal(found.from_ns, whole.from_ns)
    assert np.array_equal(found.to_ns, whole.to_ns)
    assert np.allclose(found.deltas, whole.deltas)


def test_errors_of_relations_depend_on_the_order_as_computed_by_hand():
    """The robot is found 0.1 rad too far left at the end of a straight metre."""
    T_from, delta = np.eye(4)[None], spatial(np.array([[1.0, 0.0, 0.0]]))
    found = spatial(np.array([[1.0, 0.0, 0.1]]))
    published = relation_errors(T_from, found, delta)
    assert published.translation[0] == pytest.approx(0.0, abs=1e-12)
    other = relation_errors(T_from, found, delta, Order.CARTOGRAPHER)
    # found * inverse(delta) turns the metre back by 0.1 rad: a chord of 2 sin(0.05).
    assert other.translation[0] == pytest.approx(2 * np.sin(0.05))
    assert published.rotation[0] == pytest.approx(0.1)
    assert other.rotation[0] == pytest.approx(0.1)


def test_absolute_errors_ignore_a_rigid_motion():
    truth = spatial(circle())
    moved = spatial(np.array([3.0, -2.0, 1.2])) @ truth
    assert absolute_errors(moved, truth).translation.max() < 1e-9
    assert absolute_errors(moved, truth).rotation.max() < 1e-6
    assert absolute_errors(moved, truth, aligned=False).translation.max() > 1.0


@pytest.mark.parametrize("heights", [False, True])
def test_alignment_minimises_the_squared_distances(heights):
    random = np.random.default_rng(0)
    points = random.normal(size=(40, 3)) * [3, 3, 1.0 if heights else 0.0]
    T = spatial(np.array([1.0, 2.0, 0.7]))
    moved = points @ T[:3, :3].T + T[:3, 3]
    assert np.allclose(align(points, moved), T, atol=1e-9)
    noisy = moved + random.normal(size=(40, 3)) * 0.05 * [1, 1, float(heights)]
    best = align(points, noisy)

    def cost(A):
        return np.sum((points @ A[:3, :3].T + A[:3, 3] - noisy) ** 2)

    for nudge in np.eye(3) * 1e-3:
        assert cost(best @ spatial(nudge)) > cost(best)


def test_a_trajectory_stretched_by_2_percent_has_that_error_over_distance():
    truth = spatial(np.stack([np.arange(60) * 0.5, np.zeros(60), np.zeros(60)], axis=1))
    found = truth.copy()
    found[:, 0, 3] *= 1.02
    errors = distance_errors(found, truth, 10.0)
    assert len(errors) == 40
    assert np.allclose(errors.translation, 0.2)
    assert len(distance_errors(found, truth, 100.0)) == 0


def test_poses_are_interpolated_and_unknown_within_gaps():
    stamps = np.array([0, 10**9, 20 * 10**9])
    poses = spatial(np.array([[0.0, 0, 0], [1.0, 0, 0.2], [2.0, 0, 0]]))
    asked = np.array([0, 5 * 10**8, 10**9, 10 * 10**9, 20 * 10**9, 21 * 10**9, -2_000_000])
    found, known = poses_at(stamps, poses, asked)
    assert known.tolist() == [True, True, True, False, True, False, False]
    assert found[1, 0, 3] == pytest.approx(0.5)


def test_the_pose_of_a_rounded_stamp_is_known_beside_a_gap():
    stamps = np.array([0, 5 * 10**9, 10 * 10**9])
    poses = spatial(np.array([[0.0, 0, 0], [1.0, 0, 0.2], [2.0, 0, 0]]))
    asked = np.array([-900_000, 4_999_999_100, 5_000_900_000, 5_001_100_000, 10_000_000_500])
    found, known = poses_at(stamps, poses, asked)
    assert known.tolist() == [True, True, True, False, True]
    assert found[known, 0, 3].tolist() == [0.0, 1.0, 1.0, 2.0]


@pytest.mark.parametrize("spoil", ["byte order mark", "index", "zero quaternion"])
def test_a_trajectory_is_known_by_its_numbers_whatever_stands_before(tmp_path, spoil):
    poses, stamps = circle(), stamps_of(80)
    path = write_tum(tmp_path / "truth.txt", poses, stamps)
    rows = [row for row in path.read_text().splitlines() if not row.startswith("#")]
    if spoil == "byte order mark":
        path.write_text("\ufeff" + "\n".join(rows), encoding="utf-8")
    elif spoil == "index":
        path.write_text("\n".join(f"{k} {row}" for k, row in enumerate(rows)))
    else:
        rows[3] = " ".join(rows[3].split()[:4]) + " 0 0 0 0"
        path.write_text("\n".join(rows))
        with pytest.raises(LogError, match="quaternion of pose 3 has length 0"):
            read_truth(path)
        return
    truth = read_truth(path)
    assert isinstance(truth, Trajectory)
    assert np.array_equal(truth.stamps_ns, stamps)
    assert np.allclose(truth.T_map_base, spatial(poses), atol=1e-8)


def test_pairs_that_meet_are_those_of_a_brute_force_search():
    positions = circle()[:, :2]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    expected = [
        (i, j)
        for i in range(80)
        for j in range(i + 1, 80)
        if np.hypot(*(positions[i] - positions[j])) < 3.0 and along[j] - along[i] > 10.0
    ]
    assert [tuple(p) for p in pairs_that_meet(positions)] == expected
    assert expected


def test_a_result_is_compared_with_each_kind_of_truth(tmp_path):
    poses, stamps = circle(), stamps_of(80)
    result = tmp_path / "result"
    result.mkdir()
    write_tum(result / "trajectory.tum", compose2(np.array([1.0, 1.0, 0.3]), poses), stamps)
    truth = write_tum(tmp_path / "truth.tum", poses, stamps)
    score = score_trajectory(result, truth)
    assert score.errors["absolute, aligned"].translation.max() < 1e-6
    assert "relative over 10 m" in score.text()
    assert score.to_json()["missing"] == 0
    relations = write_relations(tmp_path / "truth.relations", poses, stamps, [(0, 40), (5, 9)])
    score = score_trajectory(result, relations)
    assert [len(e) for e in score.errors.values()] == [2, 2]
    assert max(e.translation.max() for e in score.errors.values()) < 1e-6
    plot_score(score, tmp_path / "one.png")
    plot_score(score_trajectory(result, relations), tmp_path / "two.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_stamps_that_the_importer_changed_are_matched(tmp_path):
    """Truth has the log's stamps, which step back; stamps.csv leads to the bag's."""
    poses, stamps = circle(), stamps_of(80)
    logged = stamps.copy()
    logged[40] -= 900_000_000
    result = tmp_path / "result"
    result.mkdir()
    write_tum(result / "trajectory.tum", poses, stamps)
    text = ["raw_scan_index,ipc_time,stamp"]
    for k, (old, new) in enumerate(zip(logged, stamps)):
        text.append(f"{k},{old // 10**9}.{old % 10**9:09d},{new // 10**9}.{new % 10**9:09d}")
    (tmp_path / "stamps.csv").write_text("\n".join(text) + "\n")
    relations = write_relations(tmp_path / "x.relations", poses, logged, [(0, 40), (40, 60)])
    score = score_trajectory(result, relations)
    assert score.errors["relations (Kuemmerle)"].translation.max() < 1e-6
    rows = [f"{k} {logged[k] / 1e9:.6f} " + " ".join(map(str, poses[k])) for k in range(0, 80, 8)]
    reference = tmp_path / "reference.txt"
    reference.write_text("\n".join(rows))
    score = score_trajectory(result, reference)
    assert score.missing == 0
    assert score.errors["rows < 3 m, path > 10 m"].translation.max() < 1e-6


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no rows"),
        ("1 2 3\n", "needs"),
        ("a b c d e f g h\n", "not made of numbers"),
        ("1.5 0 0 0 0.1 0.1 0.1 0.1\n1.6 0 0 0 0.1 0.1 0.1 0.1\n", "length"),
        ("1 nan 0 0 0 0 0 1\n", "finite"),
        ("1700000000000000000 0 0 0 0 0 0 1\n", "row 0: stamp 17.* is no time in s"),
    ],
)
def test_files_of_another_form_are_errors(tmp_path, text, said):
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(LogError, match=said):
        score_trajectory(path, path)


def test_missing_files_and_truth_of_another_time_are_errors(tmp_path):
    with pytest.raises(LogError, match="cannot be read"):
        read_tum(tmp_path / "none.tum")
    a = write_tum(tmp_path / "a.tum", circle(), stamps_of(80))
    b = write_tum(tmp_path / "b.tum", circle(), stamps_of(80) + 10**12)
    with pytest.raises(LogError, match="no row is in the time"):
        score_trajectory(a, b)


@pytest.mark.parametrize(("unit", "per_second"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_truth_stamps_in_another_unit_are_converted_and_reported(tmp_path, unit, per_second):
    found = write_tum(tmp_path / "found.tum", circle(), stamps_of(80))
    rows = [line.split() for line in found.read_text().splitlines()[1:]]
    truth = tmp_path / "truth.tum"
    scaled = [(f"{Decimal(stamp) * per_second:f}", *values) for stamp, *values in rows]
    truth.write_text("".join(" ".join(row) + "\n" for row in scaled))
    score = score_trajectory(found, truth)
    assert len(score.errors["absolute, aligned"]) == 80
    assert f"the stamps of the truth are taken as {unit}, expected s" in score.text()
    assert "taken as" not in score_trajectory(found, found).text()


def test_no_poses_have_no_errors():
    assert len(Errors.of(np.zeros((0, 4, 4)))) == 0
