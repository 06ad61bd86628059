"""A worker runs jobs in order, survives errors, and drops only what may be dropped."""

import threading

from tccm_ros.nodes.process import worker as module
from tccm_ros.nodes.process.worker import Worker


def test_jobs_run_in_order_and_errors_are_reported():
    errors, done = [], []
    worker = Worker("probe", errors.append)
    worker.post(lambda: done.append(1))
    worker.post(lambda: 1 / 0)
    worker.post(lambda: done.append(2))
    worker.close()
    assert done == [1, 2]
    assert [type(error) for error in errors] == [ZeroDivisionError]


def test_full_queue_drops_only_droppable_items(monkeypatch):
    monkeypatch.setattr(module, "BACKLOG", 3)
    gate, done = threading.Event(), []
    worker = Worker("probe", lambda error: None)
    worker.post(gate.wait)
    kept = [worker.offer(lambda: done.append("scan"), is_droppable=True) for _ in range(9)]
    assert worker.offer(lambda: done.append("joint"))
    gate.set()
    worker.close()
    assert done == ["scan"] * sum(kept) + ["joint"]
    assert 2 <= sum(kept) <= 4


def test_wait_returns_when_the_job_is_done():
    worker, done = Worker("probe", lambda error: None), []
    worker.wait(lambda: done.append(1))
    assert done == [1]
    worker.close()
