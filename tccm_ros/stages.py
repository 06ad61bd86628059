"""Stages that hang on the map, such as rooms and pictures: one that fails is left out and counted.

Where the environment variable `TCCM_STRICT` is set, as in tests and benchmarks, it raises instead.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

from tccm_ros.errors import one_line

STRICT = "TCCM_STRICT"

Result = TypeVar("Result")


class OptionalStages:
    """Runs the stages that hang on a map.

    Attributes
    ----------
    failed
        How often a stage failed, by its name and the error: ``rooms: GEOSException: ...``.
    """

    def __init__(self) -> None:
        self.failed: Counter[str] = Counter()

    def run(self, name: str, stage: Callable[[], Result]) -> Result | None:
        """Return what a stage returns; None where it fails.

        Parameters
        ----------
        name
            Of the stage, for users.
        stage
            Does it.
        """
        try:
            return stage()
        except Exception as error:
            if os.environ.get(STRICT):
                raise
            self.failed[f"{name}: {type(error).__name__}: {one_line(error)}"] += 1
            return None
