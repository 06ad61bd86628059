"""Fuzzing: a few fixed examples in every test run, and campaigns with new examples.

TCCM_FUZZ_MINUTES=10 pytest -s test/fuzz        (new examples, 10 minutes in each test)
"""

import functools
import os
import time

from hypothesis import HealthCheck, settings

MINUTES = float(os.environ.get("TCCM_FUZZ_MINUTES", "0"))
FEW, ROUND = 25, 200
"""Numbers of examples in every test run, and in each round of a campaign."""


def fuzzed(test):
    """Run a property test with a few examples, or in rounds until its time is up."""
    once = settings(
        max_examples=ROUND if MINUTES else FEW,
        deadline=None,
        derandomize=not MINUTES,
        database=None,
        suppress_health_check=[
            HealthCheck.too_slow,
            HealthCheck.data_too_large,
            HealthCheck.function_scoped_fixture,
        ],
    )(test)
    return _in_rounds(once) if MINUTES else once


def _in_rounds(once):
    @functools.wraps(once)
    def campaign(*args, **kwargs):
        end, rounds = time.monotonic() + 60.0 * MINUTES, 0
        while time.monotonic() < end:
            once(*args, **kwargs)
            rounds += 1
        print(f"\n{once.__name__}: {rounds * ROUND} examples", flush=True)

    return campaign
