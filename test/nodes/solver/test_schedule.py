"""When the map is solved again."""

import numpy as np
import pytest
from empty_view import empty_view

from tccm_ros.nodes.solver.schedule import SolveSchedule
from tccm_ros.records import Odometry


@pytest.fixture
def schedule():
    return SolveSchedule(100.0)


def test_no_solution_without_new_records(schedule):
    schedule.note(Odometry(1, "odom", "base", np.eye(4)), 100.0)
    assert not schedule.is_due(110.0)
    assert not schedule.is_final_due(110.0, is_batch=True)


def test_a_view_is_solved_when_all_its_parts_are_there(schedule):
    *first, last = empty_view(1)
    for part in first:
        schedule.note(part, 100.0)
        assert not schedule.is_due(100.1)
    schedule.note(last, 100.1)
    assert schedule.is_due(100.1)


def test_a_part_that_never_comes_delays_by_half_a_second(schedule):
    schedule.note(empty_view(1)[0], 100.0)
    assert not schedule.is_due(100.4)
    assert schedule.is_due(100.6)


def test_five_keyframes_are_as_good_as_a_view(schedule):
    schedule.note_mapped({"keyframes": 3}, {"keyframes": 7})
    assert not schedule.is_due(100.0)
    schedule.note_mapped({"keyframes": 7}, {"keyframes": 8})
    assert schedule.is_due(100.0)


def test_two_seconds_lie_between_solutions(schedule):
    schedule.note_asked(100.0)
    schedule.request()
    assert not schedule.is_due(101.9)
    assert schedule.is_due(102.0)


@pytest.mark.parametrize("duration_s", [0.1, 1.0, 5.0])
def test_solving_takes_up_to_three_tenths_of_the_time(schedule, duration_s):
    schedule.note_solved(duration_s, 200.0)
    schedule.request()
    times = np.arange(200.0, 230.0, 0.01)
    next_s = next(t for t in times if schedule.is_due(float(t)))
    assert duration_s / (next_s - 200.0 + duration_s) < 0.301
    assert next_s - 200.0 + duration_s >= 2.0 - 1e-6


def test_a_final_solution_follows_two_seconds_after_the_last_record(schedule):
    for part in empty_view(1):
        schedule.note(part, 100.0)
    assert not schedule.is_final_due(101.9, is_batch=True)
    assert schedule.is_final_due(102.1, is_batch=True)
    schedule.note_asked(102.1)
    assert not schedule.is_final_due(110.0, is_batch=True)
    assert schedule.is_final_due(110.0, is_batch=False)


def test_another_map_has_nothing_to_solve(schedule):
    schedule.request()
    schedule.forget()
    assert not schedule.is_due(200.0)
