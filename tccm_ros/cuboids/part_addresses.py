"""Memory addresses of the part maps in the window, for kernels that read them in place.

Part maps are created one by one and are immutable. A table of their addresses avoids copying all of
them into one array in every tilt cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Int64
from tccm_ros.cuboids.part_map import PartMap


class PartAddresses:
    """Addresses of the moments and bounds of the part maps in a window."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[PartMap, tuple[int, int], tuple[NDArray[Any], ...]]] = {}

    def table(self, parts: Sequence[PartMap]) -> Int64:
        """Return the addresses of the moments and bounds of each cycle's part map.

        Parameters
        ----------
        parts
            Part maps, oldest first.

        Returns
        -------
        int64 (K, 2), a row per cycle from the oldest part map on, 0 for a missing one. Valid until
        the next call, while this object exists.
        """
        known = self._known
        self._known = {
            p.cycle: known[p.cycle] if p.cycle in known and known[p.cycle][0] is p else _locate(p)
            for p in parts
        }
        first = parts[0].cycle if parts else 0
        table = np.zeros((parts[-1].cycle - first + 1 if parts else 1, 2), np.int64)
        for cycle, (_, addresses, _) in self._known.items():
            table[cycle - first] = addresses
        return table


def _locate(part: PartMap) -> tuple[PartMap, tuple[int, int], tuple[NDArray[Any], ...]]:
    rows = (
        np.ascontiguousarray(part.moments, np.int64),
        np.ascontiguousarray(part.bounds, np.int32),
    )
    moments, bounds = (int(array.__array_interface__["data"][0]) for array in rows)
    return part, (moments, bounds), rows
