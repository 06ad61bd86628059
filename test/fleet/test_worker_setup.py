import signal

from tccm_ros.fleet.cluster import Workers, connected
from tccm_ros.fleet.worker_setup import dask_setup


def handler():
    return signal.getsignal(signal.SIGINT)


def test_workers_leave_interrupts_to_the_process_that_asked():
    before = handler()
    with connected(Workers(1)) as client:
        assert client.submit(signal.getsignal, signal.SIGINT).result(timeout=60) == signal.SIG_IGN
    assert handler() is before


def test_a_process_that_is_set_up_ignores_interrupts():
    before = handler()
    try:
        dask_setup(None)
        assert handler() is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
