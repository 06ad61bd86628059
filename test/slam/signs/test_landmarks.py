"""Door signs of an office as landmarks: from the truth, with noise and misread digits."""

from dataclasses import replace

import numpy as np
import plan
import pytest
from scipy.stats import chi2
from sign_plates import Cameras, Pictures, Plate, office, one_digit_in_ten, two_laps

from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import spatial
from tccm_ros.records import SIGN, PoseGuess
from tccm_ros.slam.wall_slam import WallSlam

MAX_ERROR = 0.05
"""Of the position of a sign, m: the target."""

WALLS, PLATES = office()
ROUTE = two_laps()
HALF_LAP = [(0, 0), (20, 0), (20, 4)]


def slam_of(run, measurements=()):
    slam = WallSlam(Config())
    for scan in run.scans:
        slam.add_scan(scan)
    for sign in measurements:
        slam.add_sign(sign)
    return slam


def errors(signs, plates=PLATES):
    """Return the errors (N, 3) of signs; the frame is that of the plan."""
    truth = {plate.number: np.array(plate.position) for plate in plates}
    return np.array([sign.position - truth[sign.number] for sign in signs])


@pytest.fixture(scope="module")
def laps():
    return plan.drive(WALLS, ROUTE, seed=1)


@pytest.fixture(scope="module")
def measurements(laps):
    return Pictures(PLATES, WALLS, misread=one_digit_in_ten).along(ROUTE, laps.stamps_ns, seed=1)


@pytest.fixture(scope="module")
def mapped(laps, measurements):
    slam = slam_of(laps, measurements)
    return slam, slam.solve()


@pytest.fixture(scope="module")
def half():
    route = plan.route(HALF_LAP, step=0.05)
    return route, plan.drive(WALLS, route, seed=3)


def pictures_of(half, plates, seed=2, **options):
    route, run = half
    return Pictures(plates, WALLS, **options).along(route, run.stamps_ns, seed=seed)


def test_ten_doors_have_ten_signs_within_five_centimetres(mapped):
    signs = mapped[1].signs
    assert sorted(s.number for s in signs) == sorted(p.number for p in PLATES)
    assert np.linalg.norm(errors(signs), axis=1).max() < MAX_ERROR
    for sign in signs:
        assert sign.text == f"{sign.number} Office"
        assert sign.confidence > 0.5
        assert len(sign.views) >= 8  # two laps


def test_errors_of_signs_are_as_their_covariances_say(mapped):
    """Within 99 % of chi-square, if errors of one trajectory were independent; not larger."""
    signs = mapped[1].signs
    total = sum(
        e @ np.linalg.solve(s.covariance, e) for e, s in zip(errors(signs), signs, strict=True)
    )
    assert 0.1 * 30 < total < chi2.ppf(0.99, 30)


def test_a_sign_is_on_its_wall_and_faces_the_corridor(mapped):
    solution = mapped[1]
    walls = {wall.id: wall for wall in solution.walls}
    for sign in solution.signs:
        wall = walls[sign.wall]
        distance = sign.position[:2] @ [np.cos(wall.phi), np.sin(wall.phi)] - wall.rho
        assert abs(distance) < 0.04
        facing = next(p.facing for p in PLATES if p.number == sign.number)
        assert sign.normal @ [np.cos(facing), np.sin(facing), 0.0] > 0.999


def test_signs_are_landmarks_of_the_graph(mapped):
    solution = mapped[1]
    marks = {m.id: m for m in solution.landmarks if m.kind == SIGN}
    assert sorted(marks) == [sign.id for sign in solution.signs]
    for sign in solution.signs:
        assert np.array_equal(marks[sign.id].position, sign.position)
        assert marks[sign.id].observations == len(sign.views)


def test_the_order_of_arrival_does_not_change_signs(laps, measurements, mapped):
    slam = WallSlam(Config())
    for sign in measurements[::-1]:
        slam.add_sign(sign)
    for scan in laps.scans:
        slam.add_scan(scan)
    other = slam.solve()
    for a, b in zip(mapped[1].signs, other.signs, strict=True):
        assert a.position.tobytes() == b.position.tobytes()
        assert (a.id, a.number, len(a.views)) == (b.id, b.number, len(b.views))


def test_without_walls_and_matching_signs_correct_odometry(laps, measurements):
    """Odometry turns by 12 mrad/m: it is metres off after two laps. Signs alone hold the map."""
    config = Config()
    config.matching.enabled = config.loops.enabled = config.walls.enabled = False
    blind = WallSlam(config)
    for scan in laps.scans:
        blind.add_scan(scan)
    assert blind.solve().signs == ()
    for sign in measurements:
        blind.add_sign(sign)
    assert all(sign.wall is None for sign in blind.solve().signs)


def test_signs_are_found_on_odometry_alone(half):
    route, _ = half
    slam = WallSlam(Config())
    stamps = 10**18 + np.arange(len(route)) * 100_000_000
    for pose, stamp in zip(route, stamps.tolist()):
        slam.add_odometry(stamp, spatial(pose))
    for sign in Pictures(PLATES, WALLS).along(route, stamps, seed=5):
        slam.add_sign(sign)
    signs = slam.solve().signs
    assert sorted(s.number for s in signs) == ["201", "203", "205", "207", "209"]
    for sign, error in zip(signs, errors(signs), strict=True):
        assert error @ np.linalg.solve(sign.covariance, error) < chi2.ppf(0.999, 3)


def test_two_signs_with_one_text_stay_separate(half):
    plates = [replace(p, number="EXIT" if p.number in ("203", "207") else p.number) for p in PLATES]
    signs = slam_of(half[1], pictures_of(half, plates)).solve().signs
    exits = sorted(s.position[0] for s in signs if s.number == "EXIT")
    assert np.allclose(exits, [5.2, 12.5], atol=MAX_ERROR)
    assert len(signs) == 5


def test_adjacent_signs_with_one_text_stay_separate(half):
    """A metre from each other: in one picture together."""
    plates = [Plate("7", (9.0, -0.98, 1.5), np.pi / 2), Plate("7", (10.0, -0.98, 1.5), np.pi / 2)]
    signs = slam_of(half[1], pictures_of(half, plates)).solve().signs
    assert np.allclose(sorted(s.position[0] for s in signs), [9.0, 10.0], atol=MAX_ERROR)


def test_a_plate_that_is_often_misread_is_one_sign_with_its_own_number(half):
    def misread(text, random):
        return text if text != "205" or random.random() < 0.6 else "206"

    signs = slam_of(half[1], pictures_of(half, PLATES, misread=misread)).solve().signs
    assert sorted(s.number for s in signs) == ["201", "203", "205", "207", "209"]
    (sign,) = [s for s in signs if s.number == "205"]
    assert sign.confidence < 0.8


def test_a_reflection_in_a_wall_is_no_sign(half):
    """A mirror on the wall at y = 1 shows the plate at y = -0.98 at y = 2.98."""
    mirrored = Plate("205", (9.0, 2.98, 1.5), -np.pi / 2)
    route, run = half
    seen = Pictures([mirrored], np.zeros((0, 2, 2))).along(route, run.stamps_ns, seed=5)
    assert len(seen) >= 3
    assert slam_of(run, seen).solve().signs == ()
    own = pictures_of(half, PLATES)
    signs = slam_of(run, [*own, *seen]).solve().signs
    assert sorted(s.number for s in signs) == ["201", "203", "205", "207", "209"]
    assert np.linalg.norm(errors(signs), axis=1).max() < MAX_ERROR


def test_a_number_that_is_carried_along_is_no_sign(half):
    """Somebody walks beside the robot with a number on the back."""
    run, seen = half[1], pictures_of(half, PLATES)
    carried = [replace(seen[0], stamp_ns=int(s), number="10") for s in run.stamps_ns[100:300:5]]
    signs = slam_of(run, [*seen, *carried]).solve().signs
    assert "10" not in {s.number for s in signs}
    assert len(signs) == 5


def test_plate_straight_ahead_is_no_landmark_without_parallax(half):
    """The plate at the end of the corridor: the robot comes towards it, then turns away from it."""
    route, run = half
    ahead = Plate("300", (20.98, 0.0, 1.1), np.pi)
    seen = Pictures([ahead], WALLS, Cameras((0.0,)), found=1.0).along(route, run.stamps_ns)
    straight = [s for s in seen if s.stamp_ns < run.stamps_ns[380]]
    assert len(straight) > 5
    assert slam_of(run, straight).solve().signs == ()


def test_a_sign_that_moved_is_a_second_sign_and_bends_nothing(laps):
    """Between two laps the plate 205 goes from its door to another."""
    half_time = len(ROUTE) // 2
    moved = [
        replace(p, position=(10.6, *p.position[1:])) if p.number == "205" else p for p in PLATES
    ]
    before = Pictures(PLATES, WALLS).along(ROUTE[:half_time], laps.stamps_ns[:half_time], seed=4)
    after = Pictures(moved, WALLS).along(ROUTE[half_time:], laps.stamps_ns[half_time:], seed=5)
    solution = slam_of(laps, [*before, *after]).solve()
    found = sorted(s.position[0] for s in solution.signs if s.number == "205")
    assert np.allclose(found, [9.0, 10.6], atol=MAX_ERROR)
    assert len(solution.signs) == 11
    assert_not_bent(solution, slam_of(laps).solve())


def assert_not_bent(solution, without, limit=0.01):
    """Assert that no pose differs by more than a centimetre from the map without signs."""
    away = solution.poses[:, :2] - without.poses[:, :2]
    assert np.hypot(*away.T).max() < limit


def test_a_renamed_plate_bends_nothing(laps):
    """In the second lap, the plate 205 says 209: the text of another, seven metres further on."""
    half_time = len(ROUTE) // 2
    renamed = [replace(p, number="209", looks="209") if p.number == "205" else p for p in PLATES]
    before = Pictures(PLATES, WALLS).along(ROUTE[:half_time], laps.stamps_ns[:half_time], seed=4)
    after = Pictures(renamed, WALLS).along(ROUTE[half_time:], laps.stamps_ns[half_time:], seed=5)
    one, other = slam_of(laps, [*before, *after]).solve(), slam_of(laps).solve()
    assert_not_bent(one, other)
    assert len(one.signs) == 10


def test_a_wrong_association_in_a_saved_map_bends_nothing(laps, measurements, mapped):
    """Views of one sign have the id of another: association begins with rays, and finds it."""
    state = mapped[0].saved()
    wrong = {**state, "sign_id": state["sign_id"].copy()}
    at = np.flatnonzero(wrong["sign_id"] == 3)
    wrong["sign_id"][at[: len(at) // 3]] = 7
    good, bad = (WallSlam.from_saved(Config(), s).solve() for s in (state, wrong))
    for a, b in zip(good.signs, bad.signs, strict=True):
        assert a.position.tobytes() == b.position.tobytes()
        assert a.id == b.id
    away = [a.pose - b.pose for a, b in zip(good.keyframes, bad.keyframes, strict=True)]
    assert np.abs(away).max() < 1e-9


def test_a_later_session_recognises_the_signs_of_a_saved_map(mapped, half):
    before, route = mapped[1], half[0]
    later = WallSlam.from_saved(Config(), mapped[0].saved())
    run = plan.drive(WALLS, route, seed=8, start_ns=2 * 10**18)
    later.add_guess(PoseGuess(2 * 10**18, np.zeros(3), np.diag([0.2, 0.2, 0.1]) ** 2))
    for scan in run.scans:
        later.add_scan(scan)
    assert later.is_located
    for sign in Pictures(PLATES, WALLS).along(route, run.stamps_ns, seed=8):
        later.add_sign(sign)
    after = later.solve()
    assert [s.id for s in after.signs] == [s.id for s in before.signs]
    views = {b.number: len(b.views) - len(a.views) for a, b in zip(before.signs, after.signs)}
    assert all((views[p.number] > 0) == (p.position[1] < 0.0) for p in PLATES)
    assert np.linalg.norm(errors(after.signs), axis=1).max() < MAX_ERROR


def test_damaged_signs_of_a_saved_map_are_refused(mapped):
    state = mapped[0].saved()
    with pytest.raises(MapError, match="a sign was seen from a keyframe that the map"):
        WallSlam.from_saved(Config(), {**state, "sign_keyframe": state["sign_keyframe"] + 10**6})
    with pytest.raises(MapError, match="damaged"):
        WallSlam.from_saved(Config(), {**state, "sign_pixel": state["sign_pixel"][1:]})
    older = {name: x for name, x in state.items() if not name.startswith("sign_")}
    assert WallSlam.from_saved(Config(), older).solve().signs == ()
