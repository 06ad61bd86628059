"""The integration map M_t: the last n part maps, newest over older (section III.C of the paper).

The cuboids of part maps are immutable. The map contains *pieces* of them: the intervals that newer
part maps do not cover. Any part map can thus be removed again, and a rebuild from the part maps
gives identical pieces, bit for bit.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.cuboids import Cuboids
from tccm_ros.cuboids.merging import compose_cuboids, count_composites, merge_part
from tccm_ros.cuboids.part_addresses import PartAddresses
from tccm_ros.cuboids.part_map import PartMap


class IntegrationMap:
    """The last `map.window_cycles` part maps as one map.

    Attributes
    ----------
    parts
        The part maps in the window, oldest first, unchanged.
    cell_size
        Edge of a cell, m.
    """

    def __init__(self, config: Config) -> None:
        self._window = config.map.window_cycles
        self.cell_size = config.map.cell_size
        self.parts: list[PartMap] = []
        self._addresses = PartAddresses()
        self._n = 0
        self._keys = np.zeros(0, np.int64)
        self._pieces = np.zeros((0, 4), np.int32)
        self._spare_keys = np.zeros(0, np.int64)
        self._spare_pieces = np.zeros((0, 4), np.int32)
        self._cuboids: Cuboids | None = None

    @property
    def cycles(self) -> list[int]:
        """Numbers of the cycles in the window, oldest first."""
        return [part.cycle for part in self.parts]

    @property
    def keys(self) -> Int64:
        """Cells of the pieces, int64 (P,), see `cuboids.cell_keys`."""
        return self._keys[: self._n]

    @property
    def pieces(self) -> Int32:
        """Pieces, int32 (P, 4): bottom, top, cycle, cuboid of its part map; sorted as `keys`."""
        return self._pieces[: self._n]

    def part(self, cycle: int) -> PartMap:
        """Return the part map of a cycle; KeyError if it is not in the window."""
        for part in self.parts:
            if part.cycle == cycle:
                return part
        raise KeyError(cycle)

    def add(self, part: PartMap) -> None:
        """Add the newest part map, and remove the one that leaves the window in the same pass.

        Raises
        ------
        ValueError
            If the part map is not newer than those in the window, or its cell size differs.
        """
        if self.parts and part.cycle <= self.parts[-1].cycle:
            raise ValueError(f"cycle {part.cycle} is not newer than {self.parts[-1].cycle}")
        if part.cell_size != self.cell_size:
            raise ValueError(f"cells of {part.cell_size} m in a map of {self.cell_size} m")
        others = [p for p in self.parts if p.cycle > part.cycle - self._window]
        self.parts = [*others, part.without_points()]
        self._put(self.parts[-1])

    def remove(self, cycle: int) -> PartMap:
        """Remove one part map; the pieces that it covered are restored.

        Returns
        -------
        PartMap
            The removed part map.

        Raises
        ------
        KeyError
            If the cycle is not in the window.
        """
        part = self.part(cycle)
        oldest = part is self.parts[0]
        self.parts = [p for p in self.parts if p is not part]
        if oldest and self.parts:
            self._merge(_NO_KEYS, _NO_BOUNDS, -1)
        else:
            self.rebuild()
        return part

    def rebuild(self) -> None:
        """Recompute the pieces from the part maps, oldest first."""
        self._n = 0
        self._cuboids = None
        for part in self.parts:
            self._put(part)

    def clear(self) -> None:
        """Remove all part maps."""
        self.parts = []
        self.rebuild()

    def cuboids(self) -> Cuboids:
        """Return the composite cuboids: touching pieces are joined, with their ordered cycles."""
        if self._cuboids is None:
            self._cuboids = self._compose()
        return self._cuboids

    def _put(self, part: PartMap) -> None:
        if len(part.void_keys):
            self._merge(part.void_keys, part.void_bounds, -1)
        self._merge(part.keys, part.bounds, part.cycle)

    def _merge(self, keys: Int64, bounds: Int32, cycle: int) -> None:
        room = self._n + 2 * len(keys) + 1
        if len(self._spare_keys) < room:
            self._spare_keys = np.empty(room + room // 2, np.int64)
            self._spare_pieces = np.empty((room + room // 2, 4), np.int32)
        self._n = merge_part(
            (self._keys, self._pieces), self._n, (keys, np.ascontiguousarray(bounds)), cycle,
            self.parts[0].cycle, (self._spare_keys, self._spare_pieces),
        )  # fmt: skip
        self._keys, self._spare_keys = self._spare_keys, self._keys
        self._pieces, self._spare_pieces = self._spare_pieces, self._pieces
        self._cuboids = None

    def _compose(self) -> Cuboids:
        n = self._n
        m = count_composites(self._keys, self._pieces, n)
        cells, spans = np.empty((2, m), np.int32), np.empty((2, m), np.int32)
        count, s, S = np.empty(m), np.empty((m, 3)), np.empty((m, 6))
        cycles, offsets = np.empty(n, np.int32), np.zeros(m + 1, np.int64)
        part_cuboids = self._addresses.table(self.parts), self.parts[0].cycle if n else 0
        found = cells, spans, count, s, S
        used = compose_cuboids(self._keys, self._pieces, n, part_cuboids, found, cycles, offsets)
        return Cuboids(
            self.cell_size, cells[0], cells[1], spans[0], spans[1], count, s, S,
            cycles[:used].copy(), offsets,
        )  # fmt: skip


_NO_KEYS = np.zeros(0, np.int64)
_NO_BOUNDS = np.zeros((0, 2), np.int32)
