"""Walls that are extended while driving, between two batches.

A batch assigns the lines of all keyframes. Here the lines of new keyframes are assigned to the
existing groups of lines. A group that was a wall of the batch remains that wall; one that the batch
rejected as not planar remains rejected; and one with enough keyframes by now becomes a new wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.slam.walls.association import WallAssociation, WallTable, min_confirmations
from tccm_ros.slam.walls.corners import Corner, shared_ends
from tccm_ros.slam.walls.lines import Lines

MORE_SIGHTINGS, MAX_SIGHTINGS = 1.2, 100
"""A corner is updated when its number of sightings has grown by this factor. All its sightings
together count as one (`corner_factors`): more than this number hardly move it (chosen)."""

NO_WALL, REJECTED = -1, -2
"""States of a group of lines: not enough keyframes yet, and not planar."""


class GrowingWalls:
    """The walls and corners of a batch, extended by new observations.

    Parameters
    ----------
    table, corners
        Result of the batch.
    poses, lines
        float64 (K, 3), poses of the batch's keyframes, and their lines.
    config
        Group ``walls``.

    Attributes
    ----------
    table
        Walls and their observations; new walls come last.
    corners
        Corners; new ones come last.
    """

    def __init__(
        self,
        table: WallTable,
        corners: Sequence[Corner],
        poses: Float64,
        lines: Sequence[Lines],
        config: Config,
    ) -> None:
        self.table, self.corners = table, list(corners)
        self._config = config
        self._association = WallAssociation(config)
        self._association.add(0, poses, lines)
        # For each group of lines: its wall, and the keyframes that observed it.
        self._walls: list[int] = []
        self._seen: list[set[int]] = []
        # All observations of meeting wall ends, and the indices of those that are corners.
        self._meetings = shared_ends(table, lines)
        self._numbers = {(c.a, c.b): number for number, c in enumerate(corners)}
        self._name_groups(min_confirmations(config, len(lines)))

    def _name_groups(self, confirmations: int) -> None:
        """Find the groups that are walls of the batch, by majority of their lines."""
        for g in range(len(self._association.table())):
            members = self._association.wall == g
            of_batch = self.table.wall[members]
            seen = set(self._association.keyframe[members].tolist())
            wall = REJECTED if len(seen) >= confirmations else NO_WALL
            if (of_batch >= 0).any():
                wall = int(np.bincount(of_batch[of_batch >= 0]).argmax())
            self._walls.append(wall)
            self._seen.append(seen)

    def add(self, poses: Float64, lines: Sequence[Lines], first: int) -> tuple[Int64, list[int]]:
        """Assign the lines of new keyframes.

        Parameters
        ----------
        poses, lines
            float64 (K, 3), poses of all keyframes, and their lines.
        first
            Index of the first new keyframe.

        Returns
        -------
        int64 (N,), rows of `table` with new observations of walls, in the order of keyframes: lines
        of new keyframes, and earlier lines of new walls; and the indices of new or changed corners
        """
        before, known = len(self._association.wall), len(self.table)
        self._association.add(first, poses[first:], lines[first:])
        wall = self._named(before)
        earlier = np.flatnonzero(wall[:before] >= known)
        rows = np.append(earlier, before + np.flatnonzero(wall[before:] >= 0))
        rows = rows[np.argsort(self._association.keyframe[rows], kind="stable")]
        self.table = self._pooled(wall)
        beside = np.flatnonzero(np.isin(self.table.keyframe, self.table.keyframe[rows]))
        return rows, self._add_corners(self.observations(beside), lines, first, known)

    def observations(self, rows: Int64) -> WallTable:
        """Return the table with a subset of its observations."""
        table = self.table
        return replace(
            table, keyframe=table.keyframe[rows], line=table.line[rows], wall=table.wall[rows]
        )

    def without(self, rows: Int64, is_outlier: Bool, known: int) -> Int64:
        """Remove outliers of walls older than `known`; return the indices of removed rows.

        Observations that confirmed a new wall are kept.
        """
        gone = is_outlier & (self.table.wall[rows] < known)
        wall = self.table.wall.copy()
        wall[rows[gone]] = -1
        self.table = replace(self.table, wall=wall)
        return np.flatnonzero(gone)

    def _named(self, before: int) -> Int64:
        """Return the wall of each observation; the first `before` are not new."""
        group, keyframe = self._association.wall, self._association.keyframe
        count = len(self._association.table()) - len(self._walls)
        self._walls += [NO_WALL] * count
        self._seen += [set() for _ in range(count)]
        wall = np.append(self.table.wall, np.full(len(group) - before, -1))
        confirmations = min_confirmations(self._config, int(keyframe[-1]) + 1 if len(group) else 0)
        number, new = len(self.table), group[before:]
        for g in np.unique(new[new >= 0]).tolist():
            members = before + np.flatnonzero(new == g)
            self._seen[g].update(keyframe[members].tolist())
            if self._walls[g] == NO_WALL and len(self._seen[g]) >= confirmations:
                self._walls[g], number = number, number + 1
                members = np.flatnonzero(group == g)
            if self._walls[g] >= 0:
                wall[members] = self._walls[g]
        return wall

    def _pooled(self, wall: Int64) -> WallTable:
        """Return the walls with updated lines; of several groups of a wall, use the largest."""
        groups, last = self._association.table(), self.table
        count = max(len(last), max(self._walls, default=-1) + 1)
        phi, rho, extent = np.zeros(count), np.zeros(count), np.zeros((count, 2))
        roughness = np.zeros(count)
        phi[: len(last)], rho[: len(last)], extent[: len(last)] = last.phi, last.rho, last.extent
        roughness[: len(last)] = last.roughness
        sizes = np.bincount(groups.wall[groups.wall >= 0], minlength=len(groups))
        for g in np.argsort(sizes, kind="stable").tolist():
            w = self._walls[g]
            if w >= 0:
                phi[w], rho[w], extent[w] = groups.phi[g], groups.rho[g], groups.extent[g]
                roughness[w] = max(roughness[w], groups.roughness[g])
        # The next batch finds out whether a new wall is a piece of another.
        new = last.whole.max(initial=-1) + 1 + np.arange(count - len(last))
        whole = np.append(last.whole, new)
        return WallTable(groups.keyframe, groups.line, wall, phi, rho, extent, roughness, whole)

    def _add_corners(
        self, observations: WallTable, lines: Sequence[Lines], first: int, known: int
    ) -> list[int]:
        """Add sightings by new keyframes or of new walls; return the indices of changed corners.

        Parameters
        ----------
        observations
            Observations of all walls by new keyframes and by those that observed new walls.
        lines
            Lines of all keyframes.
        first, known
            Index of the first new keyframe, and of the first new wall.
        """
        enough = min_confirmations(self._config, len(lines))
        changed = []
        for pair, sightings in sorted(shared_ends(observations, lines).items()):
            seen = self._meetings[pair]
            for keyframe, point in zip(*sightings):
                if keyframe >= first or pair[1] >= known:
                    seen[0].append(keyframe)
                    seen[1].append(point)
            used = len(self.corners[self._numbers[pair]].keyframes) if pair in self._numbers else 0
            is_due = len(seen[0]) >= (MORE_SIGHTINGS * used if used else enough)
            if is_due and used < MAX_SIGHTINGS and len(seen[0]) > used:
                number = self._numbers.setdefault(pair, len(self.corners))
                changed.append(number)
                self.corners[number : number + 1] = [Corner(*pair, [*seen[0]], [*seen[1]])]
        return changed
