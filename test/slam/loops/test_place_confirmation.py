"""Which searches place a robot in a saved map."""

from dataclasses import replace

import numpy as np
import plan
import pytest

from tccm_ros.config import Config
from tccm_ros.geometry import between2, compose2
from tccm_ros.slam.loops.matching import LoopReason, Proposal
from tccm_ros.slam.loops.place_confirmation import PlaceConfirmation
from tccm_ros.slam.wall_slam import WallSlam

CERTAIN_AGREEMENT = 0.9  # of a search that needs no other; other rooms reach 0.80
CONFIRMED_M = 2.5  # m of path over which all searches agree

COV = np.diag([0.02**2, 0.02**2, 0.006**2])
SHIFT = np.array([5.0, 2.0, 0.8])
"""The session's frame in the map."""

LOW = 0.6
STEP_M = 0.3
POSES = np.array([[0.0, 0.0, 0.0], *([STEP_M * k, 0.0, 0.1 * k] for k in range(40))])
"""The map's only keyframe, and those of a session."""

PATH = STEP_M * np.arange(len(POSES))


def place(b, shift=SHIFT):
    """Return the right place of keyframe b of the session, seen from the map's keyframe."""
    return Proposal(0, b, compose2(shift, POSES[b]), COV, 0.8, 0.7, 2.0)


def searches(found):
    """Return the index of the search after which a place is accepted; None if never."""
    confirmation = PlaceConfirmation()
    for i, (proposal, agreement) in enumerate(found):
        if confirmation.add(proposal, agreement, POSES, PATH):
            return i
    return None


def test_one_search_that_explains_the_scan_suffices():
    assert searches([(place(1), CERTAIN_AGREEMENT)]) == 0
    assert searches([(place(1), CERTAIN_AGREEMENT - 0.01)]) is None


def test_otherwise_all_searches_along_a_path_must_agree():
    needed = int(np.ceil(CONFIRMED_M / STEP_M))
    assert searches([(place(b), LOW) for b in range(1, 30)]) == needed


def test_the_first_and_the_last_agreeing_places_become_loop_closures():
    confirmation, accepted = PlaceConfirmation(), []
    for b in range(1, 30):
        accepted = accepted or confirmation.add(place(b), LOW, POSES, PATH)
    assert accepted[0].b == 1
    assert PATH[accepted[-1].b] - PATH[1] >= CONFIRMED_M


@pytest.mark.parametrize(
    "other",
    [
        None,
        replace(place(7), reason=LoopReason.IN_FREE_SPACE.format(0.2)),
        replace(place(7), reason=LoopReason.TWO_PLACES_IN_MAP),
        place(7, SHIFT + np.array([1.5, 0.0, 0.0])),
    ],
    ids=["nothing", "refused", "ambiguous", "another place"],
)
def test_a_search_that_does_not_agree_begins_anew(other):
    found = [(place(b), LOW) for b in range(1, 30)]
    found[6] = (other, LOW)
    needed = int(np.ceil(CONFIRMED_M / STEP_M))
    assert searches(found) == 7 + needed


def test_a_robot_that_rotates_in_place_confirms_nothing():
    assert searches([(place(5), LOW)] * 200) is None


def test_where_a_scan_fits_at_several_places_twice_as_much_is_needed():
    ambiguous = replace(place(1), reason=LoopReason.TWO_PLACES_IN_MAP)
    sure = [(place(b), 1.0) for b in (2, 3)]
    assert searches([(ambiguous, 1.0), *sure]) == 2
    assert searches([(ambiguous, LOW), *sure]) == 1, "an ambiguous poor match tells nothing"


def test_place_whose_walls_the_robot_sees_through_is_refused():
    """The map's room has the same outline and a wall across; the robot would see through it."""
    outline, niche = plan.box(0.0, 0.0, 7.0, 4.5), plan.box(2.0, 0.0, 2.8, 0.6)
    across = np.array([[[4.6, 1.2], [4.6, 3.4]]])
    slam = WallSlam(Config())
    lap = plan.route([(1, 1), (4, 1), (4, 3.7), (1, 3.7), (1, 1)])
    for scan in plan.drive(np.concatenate([outline, niche, across]), lap, seed=1).scans:
        slam.add_scan(scan)
    again = WallSlam.from_saved(Config(), slam.saved())
    path = plan.route([(1.5, 2.0), (3.5, 2.4)])
    for scan in plan.drive(np.concatenate([outline, niche]), path, seed=2).scans:
        again.add_scan(scan)
        assert not again.is_located
    # In the room itself, it is found.
    again = WallSlam.from_saved(Config(), slam.saved())
    run = plan.drive(np.concatenate([outline, niche, across]), path, seed=3)
    pose = again.add_scan(run.scans[0]).pose
    assert again.is_located
    assert np.hypot(*between2(between2(lap[0], path[0]), pose)[:2]) < 0.1
