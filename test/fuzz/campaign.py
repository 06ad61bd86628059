"""Fuzzing: a few examples in every test run, always the same; a campaign by one command.

TCCM_FUZZ=3000 pytest test/fuzz        (so many new examples for each test)
"""

import os

from hypothesis import HealthCheck, settings

fuzzed = settings(
    max_examples=int(os.environ.get("TCCM_FUZZ", "25")),
    deadline=None,
    derandomize="TCCM_FUZZ" not in os.environ,
    database=None,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.function_scoped_fixture,
    ],
)
