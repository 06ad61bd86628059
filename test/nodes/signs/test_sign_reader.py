"""The process that reads door signs for a node: as offline, at a limited rate, started again."""

import os
import signal

import numpy as np
import pytest
from posed_pictures import START, needs_reader, posed, wall_with

from tccm_ros.config import Config
from tccm_ros.nodes.signs import reader as sign_reader
from tccm_ros.nodes.signs.reader import SignReader
from tccm_ros.signs.processor import SignProcessor

pytestmark = needs_reader


def never():
    """Wait for the reader without a limit."""
    return False


@pytest.fixture
def read():
    """Return a reader, and the measurements that it has given."""
    given = []
    reader = SignReader(Config(), given.append)
    yield reader, given
    reader.close()


def test_live_sign_measurements_equal_those_of_a_replay(read):
    reader, given = read
    pictures = [
        posed(wall_with(number), START + k * 10**9) for k, number in enumerate(("317", "5B"))
    ]
    for picture in pictures:
        reader.offer(picture)
    reader.wait(never)
    offline = SignProcessor(Config())
    for signs, picture in zip(given, pictures, strict=True):
        searched, *expected_signs = offline.add(picture)
        assert signs[0].key == searched.key
        for sign, expected in zip(signs[1:], expected_signs, strict=True):
            assert (sign.stamp_ns, sign.text) == (expected.stamp_ns, expected.text)
            assert sign.bearing.tobytes() == expected.bearing.tobytes()
            assert sign.patch.tobytes() == expected.patch.tobytes()
    assert given[0][1].number == "317"
    assert reader.counts == {"pictures": 2, "signs": sum(map(len, given)) - 2}


def test_pictures_beyond_the_rate_are_not_given_to_the_process(read):
    reader, given = read
    blank = np.full((48, 64, 3), 120, np.uint8)
    for k in range(20):
        reader.offer(posed(blank, START + k * 50_000_000))
    reader.wait(never)
    assert len(given) == 2
    assert reader.dropped == {"pictures beyond signs.rate": 18}


def test_a_process_that_dies_is_started_again(read):
    reader, given = read
    blank = np.full((48, 64, 3), 120, np.uint8)
    reader.offer(posed(blank, START))
    reader.wait(never)
    os.kill(reader._process.pid, signal.SIGKILL)
    reader._process.wait()
    reader.offer(posed(blank, START + 10**9))
    reader.offer(posed(blank, START + 2 * 10**9))
    reader.wait(never)
    assert len(given) == 2
    assert reader.problem == ""
    assert sum(reader.dropped.values()) == 1


def test_signs_read_before_a_map_reset_are_dropped(read):
    reader, given = read
    reader.offer(posed(wall_with("317"), START))
    reader.begin()
    reader.wait(never)
    # It may have been given before; then nothing else is.
    assert len(given) <= 1
    reader.offer(posed(wall_with("317"), START))
    reader.wait(never)
    assert given[-1][1].number == "317"


def test_where_reading_is_too_slow_pictures_are_dropped_and_counted(read, monkeypatch):
    monkeypatch.setattr(sign_reader, "MAX_WAITING", 0)
    reader, given = read
    reader.offer(posed(np.full((48, 64, 3), 120, np.uint8)))
    reader.wait(never)
    assert given == []
    assert reader.dropped == {"overload: pictures": 1}
