"""Optional stages after the map, such as rooms and pictures, whose failure is counted.

If the environment variable `TCCM_STRICT` is set, as in tests and benchmarks, a failure raises.
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
    """Runs optional stages and counts their failures.

    Attributes
    ----------
    failed
        Number of failures by stage and error: ``rooms: GEOSException: ...``.
    """

    def __init__(self) -> None:
        self.failed: Counter[str] = Counter()

    def run(self, name: str, stage: Callable[[], Result]) -> Result | None:
        """Return the result of a stage; None if it fails.

        Parameters
        ----------
        name
            Name of the stage, for users.
        stage
            The function to run.
        """
        try:
            return stage()
        except Exception as error:
            if os.environ.get(STRICT):
                raise
            self.failed[f"{name}: {type(error).__name__}: {one_line(error)}"] += 1
            return None
