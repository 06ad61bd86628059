"""A player's time: rate, pause and rewind against hand-computed times."""

from tccm_ros.nodes.timeline import Timeline


def test_time_stands_still_until_it_runs():
    timeline = Timeline(100, 2.0)
    assert timeline.now(5_000) == 100
    timeline.run(5_000)
    assert timeline.now(5_000) == 100
    assert timeline.now(5_010) == 120


def test_a_pause_holds_and_goes_on_where_it_was():
    timeline = Timeline(0, 1.0)
    timeline.run(0)
    timeline.pause(50)
    assert timeline.now(1_000) == 50
    timeline.run(2_000)
    assert timeline.now(2_030) == 80


def test_a_rewound_timeline_starts_over():
    timeline = Timeline(10, 1.0)
    timeline.run(0)
    assert timeline.now(90) == 100
    timeline.rewind(10, 90)
    assert timeline.now(90) == 10
    assert timeline.now(95) == 15
