"""One office swept from three later_sessions that share no odometry, and offices next door."""

import numpy as np
import pytest
from shared_data import shared

from tccm_ros.calibrate.calibration import calibrate
from tccm_ros.config import Config
from tccm_ros.errors import MapError
from tccm_ros.geometry import inverse, planar
from tccm_ros.replay.run import run_bag

OFFICE = ("dlut_A617", "dlut_query_07", "dlut_query_08")


@pytest.fixture(scope="module")
def rig():
    """The configuration with the rig that the first recording's floor and ceiling give."""
    found = calibrate(shared(f"bags/{OFFICE[0]}"), Config())
    return Config().model_copy(update={"rig": found.rig})


def run(name, config, saved=None):
    outcome = run_bag(shared(f"bags/{name}"), config, saved=saved)
    return outcome.slam.saved(outcome.solution), outcome.solution


def floors(solution):
    return sorted((s for s in solution.surfaces if s.label == "floor"), key=lambda s: -s.area)


@pytest.fixture(scope="module")
def first(rig):
    return run(OFFICE[0], rig)


@pytest.fixture(scope="module")
def later_sessions(rig, first):
    """The second and the third recording, each continuing the map before."""
    second = run(OFFICE[1], rig, first[0])
    return second, run(OFFICE[2], rig, second[0])


def test_recordings_of_one_office_at_three_positions_become_one_map(rig, first, later_sessions):
    second, (saved, solution) = later_sessions
    assert second[1].alignment.found
    assert solution.alignment.found
    floor = floors(solution)[0]
    assert {view.stamp_ns for view in floor.views} == {s.view.stamp_ns for s in saved.views}
    assert floor.area > floors(first[1])[0].area
    assert abs(floor.height - floors(first[1])[0].height) < 0.01
    shared_surfaces = [s for s in solution.surfaces if s.label != "floor" and len(s.views) > 1]
    assert shared_surfaces, "furniture that two later_sessions saw is one surface"
    # The pose of the third session is the same with and without the second.
    straight = run(OFFICE[2], rig, first[0])[1]
    difference = planar(
        inverse(straight.alignment.T_map_session) @ solution.alignment.T_map_session
    )
    assert np.hypot(difference[0], difference[1]) < 0.10
    assert abs(difference[2]) < np.radians(2.0)


def test_the_floor_is_one_surface_but_for_small_pieces(later_sessions):
    _, (_, solution) = later_sessions
    floor, *rest = floors(solution)
    assert sum(s.area for s in rest) < 0.05 * floor.area


def test_the_floor_of_a_corridor_seen_at_three_positions_is_one_surface():
    # Without calibration: the tilt zero is wrong by degrees.
    _, solution = run("kurt3d_corridor", Config())
    floor, *rest = floors(solution)
    assert len(floor.views) == 3
    assert sum(s.area for s in rest) < 0.05 * floor.area


@pytest.mark.parametrize("other", ["dlut_A605", "dlut_A607", "dlut_A609"])
def test_another_office_is_refused(rig, first, other):
    with pytest.raises(
        MapError, match=r"unchanged \((no place fits|ambiguous|too little structure)\)"
    ):
        run(other, rig, first[0])
