"""Each pair of maps is matched once: a map that is added is matched with the others alone."""

import itertools

import numpy as np
import pytest

from tccm_ros.config import Config
from tccm_ros.errors import FleetError
from tccm_ros.fleet import pair_tasks
from tccm_ros.fleet.cluster import Workers
from tccm_ros.fleet.pair_matching import PairLoop, PairMatch, PairReason
from tccm_ros.fleet.pair_tasks import match_all, pair_file
from tccm_ros.progress import Bars
from tccm_ros.results.folder_reader import read_json_or_none
from tccm_ros.results.numbers import json_text

COUNT = 12


@pytest.fixture
def matching(tmp_path, monkeypatch):
    """Return matching of some maps, with tasks that note their pair and find nothing."""
    noted = tmp_path / "noted"
    noted.mkdir()
    text = json_text(PairMatch(PairReason.NO_MATCH, np.zeros(3)))

    def note(one, other, config, cache):
        (noted / f"{one.name}-{other.name}").touch(exist_ok=False)
        cache.parent.mkdir(exist_ok=True)
        cache.write_text(text)

    monkeypatch.setattr(pair_tasks, "match_files", note)

    def match(names):
        for path in noted.iterdir():
            path.unlink()
        maps = {k: (tmp_path / name, f"checksum {name}") for k, name in enumerate(names)}
        found, matched = match_all(maps, tmp_path / "pairs", Config(), Workers(), Bars())
        assert set(found) == set(itertools.combinations(range(len(names)), 2))
        done = {tuple(path.name.split("-")) for path in noted.iterdir()}
        assert len(done) == matched
        return done

    return match


def test_a_map_that_is_added_is_matched_with_each_of_the_others_alone(matching):
    others = [f"map{k}" for k in range(COUNT)]
    assert matching(others) == set(itertools.combinations(others, 2))
    assert matching([*others, "new"]) == {(name, "new") for name in others}
    assert matching([*others, "new"]) == set()


def test_maps_that_are_left_out_are_forgotten_by_nobody(matching):
    matching(["a", "b", "c"])
    assert matching(["a", "c"]) == set()
    assert matching(["a", "d", "c"]) == {("a", "d"), ("d", "c")}


def test_a_pair_whose_workers_die_is_an_error_of_one_line(tmp_path, monkeypatch):
    def dies(one, other, config, cache):
        import os
        import signal

        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(pair_tasks, "match_files", dies)
    maps = {k: (tmp_path / name, name) for k, name in enumerate("ab")}
    with pytest.raises(FleetError, match=r"a and .*b: ") as error:
        match_all(maps, tmp_path / "pairs", Config(), Workers(), Bars())
    assert "\n" not in str(error.value)


def test_a_match_is_read_as_it_was_written(tmp_path):
    loop = PairLoop(3, 4, np.array([1.0, 2.0, 0.5]), np.diag([1e-4, 2e-4, 1e-5]), 0.9, 0.8, 2.0)
    match = PairMatch(PairReason.ACCEPTED, np.array([1.0, 2.0, 0.5]), (loop,))
    path = tmp_path / "pair.json"
    path.write_text(json_text(match))
    read = read_json_or_none(path, PairMatch)
    assert read.is_accepted
    assert np.array_equal(read.loops[0].cov, loop.cov)
    assert read_json_or_none(tmp_path / "none.json", PairMatch) is None


def test_a_match_is_of_two_maps_in_their_order_and_of_the_configuration(tmp_path):
    other = Config.model_validate({"loops": {"min_score": 0.5}})
    files = {
        pair_file(tmp_path, "a", "b", Config()),
        pair_file(tmp_path, "b", "a", Config()),
        pair_file(tmp_path, "a", "c", Config()),
        pair_file(tmp_path, "a", "b", other),
    }
    assert len(files) == 4
    assert pair_file(tmp_path, "a", "b", Config()) in files
