"""A cluster that cannot be used is an error of one line."""

import pytest

from tccm_ros.errors import FleetError
from tccm_ros.fleet import cluster
from tccm_ros.fleet.cluster import Workers, connected


def test_a_scheduler_that_does_not_answer_is_an_error(monkeypatch):
    monkeypatch.setattr(cluster, "START_TIMEOUT_S", 1.0)
    absent = connected(Workers(scheduler="tcp://127.0.0.1:9"))
    with pytest.raises(FleetError, match=r"tcp://127\.0\.0\.1:9: no scheduler answers"), absent:
        pass


def test_a_memory_limit_that_is_no_size_is_an_error():
    wrong = connected(Workers(memory="much"))
    with pytest.raises(FleetError, match="memory limit 'much'"), wrong:
        pass
