"""Refused messages: each kind is said at once and once a minute, and sets the level for 10 s."""

from tccm_ros.errors import MessageError
from tccm_ros.nodes.intake.inputs import Blocking
from tccm_ros.nodes.intake.refusals import Refusals, kind_of

REPEAT_S = 60.0  # s, between two log messages of a persistent refusal
WINDOW_S = 10.0  # s: older refusals do not set the level


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


def refusals():
    said, clock = [], Clock()
    return Refusals(said.append, clock), said, clock


def test_figures_do_not_make_another_kind():
    assert kind_of("point_step 20, expected 32") == kind_of("point_step 8, expected 32.5")


def test_each_kind_is_logged_at_once_and_once_a_minute():
    found, said, clock = refusals()
    for step in (20, 24):
        found.note("points", MessageError(f"point_step {step}"))
    found.note("points", MessageError("no field z"))
    assert said == ["points: point_step 20", "points: no field z"]
    clock.now_s += REPEAT_S
    found.note("points", MessageError("point_step 28"))
    assert said[2:] == ["points: 2 more refused: point_step 28"]
    assert found.counts["points"] == 4


def test_recent_refusals_are_a_warning_or_an_error_if_nothing_is_used():
    found, _, clock = refusals()
    assert found.problem("points") is None
    for step in (20, 24):
        found.note("points", MessageError(f"point_step {step}"))
    found.note("points", MessageError("no field z"))
    text = found.problem("points")
    assert text == "all messages of 'points' are refused: no field z; point_step 24"
    assert isinstance(text, Blocking)
    found.note_used("points")
    assert found.problems() == ["some messages of 'points' are refused: no field z; point_step 24"]
    assert not isinstance(found.problems()[0], Blocking)
    clock.now_s += WINDOW_S + 1.0
    assert found.problems() == []
