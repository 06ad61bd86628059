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
from tccm_ros.slam.walls.association import (
    WallAssociation,
    WallTable,
    keyframes_of,
    min_confirmations,
)
from tccm_ros.slam.walls.lines import Lines

NO_WALL, REJECTED = -1, -2
"""States of a group of lines: not enough keyframes yet, and not planar."""


class GrowingWalls:
    """The walls of a batch, extended by new observations.

    Parameters
    ----------
    table
        Result of the batch.
    poses, lines
        float64 (K, 3), poses of the batch's keyframes, and their lines.
    config
        Group ``walls``.

    Attributes
    ----------
    table
        Walls and their observations; new walls come last.
    """

    def __init__(
        self, table: WallTable, poses: Float64, lines: Sequence[Lines], config: Config
    ) -> None:
        self.table = table
        self._config = config
        self._association = WallAssociation(config)
        self._association.add(0, poses, lines)
        # The wall of each group: that of most of its lines in the batch.
        group, wall = self._association.wall, table.wall
        is_confirmed = self._is_confirmed(len(lines))
        self._walls = np.where(is_confirmed, REJECTED, NO_WALL)
        known, walls = (group >= 0) & (wall >= 0), max(len(table), 1)
        pairs, votes = np.unique(group[known] * walls + wall[known], return_counts=True)
        pairs = pairs[np.lexsort([-pairs, votes])]
        self._walls[pairs // walls] = pairs % walls  # the last value counts

    def add(self, poses: Float64, lines: Sequence[Lines], first: int) -> Int64:
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
        of new keyframes, and earlier lines of new walls
        """
        self._association.add(first, poses[first:], lines[first:])
        group, before = self._association.wall, len(self.table.wall)
        new = len(self._association) - len(self._walls)
        self._walls = np.append(self._walls, np.full(new, NO_WALL))
        is_confirmed = self._is_confirmed(len(lines))
        confirmed = np.flatnonzero((self._walls == NO_WALL) & is_confirmed)
        self._walls[confirmed] = len(self.table) + np.arange(len(confirmed))
        wall = np.append(self.table.wall, np.full(len(group) - before, -1))
        fresh = (group >= 0) & np.isin(group, confirmed)
        fresh[before:] = group[before:] >= 0
        wall[fresh] = np.maximum(self._walls[group[fresh]], -1)
        self.table = self._pooled(wall)
        return np.flatnonzero(fresh & (wall >= 0))

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

    def _is_confirmed(self, keyframes: int) -> Bool:
        """Return whether enough of all keyframes observed each group, bool (G,)."""
        groups = self._association
        seen = keyframes_of(groups.wall, groups.keyframe, len(groups))
        return seen >= min_confirmations(self._config, keyframes)

    def _pooled(self, wall: Int64) -> WallTable:
        """Return the walls with updated lines; of several groups of a wall, use the largest."""
        groups, last = self._association.table(), self.table
        new = max(int(self._walls.max(initial=-1)) + 1 - len(last), 0)
        sizes = np.bincount(groups.wall[groups.wall >= 0], minlength=len(groups))
        order = np.argsort(sizes, kind="stable")
        order = order[self._walls[order] >= 0]
        w = self._walls[order]
        phi, rho = np.append(last.phi, np.zeros(new)), np.append(last.rho, np.zeros(new))
        extent = np.concatenate([last.extent, np.zeros((new, 2))])
        roughness = np.append(last.roughness, np.zeros(new))
        phi[w], rho[w], extent[w] = groups.phi[order], groups.rho[order], groups.extent[order]
        np.maximum.at(roughness, w, groups.roughness[order])
        # The next batch finds out whether a new wall is a piece of another.
        whole = np.append(last.whole, last.whole.max(initial=-1) + 1 + np.arange(new))
        return WallTable(groups.keyframe, groups.line, wall, phi, rho, extent, roughness, whole)
