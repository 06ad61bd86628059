"""A worker thread that owns a processor, so that a long step never blocks the intake."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.nodes.qos import SENSOR_DEPTH

Result = TypeVar("Result")

BACKLOG = 10 * SENSOR_DEPTH
"""Queue length above which scans are dropped. Chosen: 10 s of a laser, joints and odometry."""

CEILING = 10 * BACKLOG
"""Queue length above which everything is dropped. Chosen: it bounds the memory."""


class _Job(NamedTuple):
    """A job, and whether it was offered, in which case it may be skipped when time is up."""

    run: Callable[[], None]
    is_offered: bool = False


def promise(job: Callable[[], Any], node: Node) -> tuple[Future, Callable[[], None]]:
    """Return a future for a service callback of a node, and the function that resolves it."""
    executor = node.executor
    future: Future = Future(executor=executor)

    def run() -> None:
        try:
            future.set_result(job())
        except Exception as error:
            future.set_exception(error)
        # Resolving a future does not wake the executor: the answer would wait for the next timer.
        if executor is not None:
            executor.wake()

    return future, run


class Worker:
    """Runs jobs one after another in a daemon thread.

    Parameters
    ----------
    name
        Name of the thread.
    on_error
        Called in the thread with the exception of a job; the worker continues.

    Attributes
    ----------
    skipped
        Number of offered jobs that were skipped because time was up.
    """

    def __init__(self, name: str, on_error: Callable[[Exception], None]):
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._on_error = on_error
        self._is_hurried = False
        self.skipped = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def backlog(self) -> int:
        """Number of queued jobs."""
        return self._jobs.qsize()

    def post(self, job: Callable[[], None]) -> None:
        """Queue a job that is never dropped; such jobs are rare."""
        self._jobs.put(_Job(job))

    def offer(self, job: Callable[[], None], *, is_droppable: bool = False) -> bool:
        """Queue a job, or return False if the queue is full; droppable jobs have a lower limit."""
        if self._jobs.qsize() >= (BACKLOG if is_droppable else CEILING):
            return False
        self._jobs.put(_Job(job, is_offered=True))
        return True

    def call(self, job: Callable[[], Result], node: Node) -> Future:
        """Queue a job and return a future of its result, for a service callback of a node."""
        future, run = promise(job, node)
        self._jobs.put(_Job(run))
        return future

    def wait(self, job: Callable[[], Any], is_over: Callable[[], bool] = lambda: False) -> None:
        """Run a job after the queued ones and return when it is done; not from the thread itself.

        Parameters
        ----------
        job
            The job.
        is_over
            Returns whether time is up; from then on, offered jobs are skipped.
        """
        done = threading.Event()

        def run() -> None:
            try:
                job()
            finally:
                done.set()

        self._jobs.put(_Job(run))
        while not done.wait(0.1) and self._thread.is_alive():
            self._is_hurried = self._is_hurried or is_over()

    def close(self) -> None:
        """Finish the queued jobs and end the thread."""
        self._jobs.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            if self._is_hurried and job.is_offered:
                self.skipped += 1
                continue
            try:
                job.run()
            except Exception as error:
                self._on_error(error)
