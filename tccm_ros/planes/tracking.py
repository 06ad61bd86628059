"""Tracking of planes from tilt cycle to tilt cycle.

A plane matches a track if normals and offsets agree and the outlines overlap; of several, those
with the largest intersection over union match. The map's frame is the odometry frame, so that the
robot's motion has no effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from tccm_ros.arrays import Bool
from tccm_ros.config import Config
from tccm_ros.outlines.overlap import overlaps
from tccm_ros.planes import PlaneFit, PlaneFits
from tccm_ros.records import PlaneRecord


@dataclass
class _Track:
    record: PlaneRecord
    missed: int = 0


class PlaneTracker:
    """Assigns persistent ids to planes.

    Parameters
    ----------
    config
        Group `planes`: `track_distance`, `track_angle`, `track_cycles`.
    """

    def __init__(self, config: Config) -> None:
        self._config = config.planes
        self._tracks: list[_Track] = []
        self._next_id = 0

    def reset(self) -> None:
        """Remove all tracks; later ids continue."""
        self._tracks.clear()

    def update(self, fits: PlaneFits) -> list[PlaneRecord]:
        """Match the planes of one tilt cycle with the tracks; return their records.

        Parameters
        ----------
        fits
            Planes of this tilt cycle's map.

        Returns
        -------
        list[PlaneRecord]
            One per fit with an outline, in their order. A plane that is not found is not in the
            list; it keeps its id for `planes.track_cycles` cycles, as it may only be occluded.
        """
        shown = [fit for fit in fits if len(fit.boundary)]
        matched = self._match(shown)
        records = []
        for fit, track in zip(shown, matched, strict=True):
            if track is None:
                track = _Track(plane_record(fit, self._next_id))
                self._next_id += 1
                self._tracks.append(track)
            else:
                track.record = plane_record(fit, track.record.id)
            track.missed = -1
            records.append(track.record)
        for track in self._tracks:
            track.missed += 1
        self._tracks = [t for t in self._tracks if t.missed <= self._config.track_cycles]
        return records

    def _match(self, fits: list[PlaneFit]) -> list[_Track | None]:
        if not fits or not self._tracks:
            return [None] * len(fits)
        pairs = np.argwhere(self._may_match(fits))
        score = np.zeros((len(fits), len(self._tracks)))
        score[pairs[:, 0], pairs[:, 1]] = overlaps(
            [f.boundary for f in fits],
            np.array([f.normal for f in fits]),
            [t.record.boundary for t in self._tracks],
            pairs,
        )
        rows, columns = linear_sum_assignment(-score)
        result: list[_Track | None] = [None] * len(fits)
        for row, column in zip(rows, columns, strict=True):
            if score[row, column] > 0.0:
                result[row] = self._tracks[column]
        return result

    def _may_match(self, fits: list[PlaneFit]) -> Bool:
        """Return which pairs of fits and tracks are coplanar, bool (fits, tracks)."""
        known = [track.record for track in self._tracks]
        n, m = np.array([f.normal for f in fits]), np.array([k.normal for k in known])
        step = np.array([f.centroid for f in fits]) @ m.T - [k.offset for k in known]
        back = n @ np.array([k.centroid for k in known]).T - np.array([[f.offset] for f in fits])
        distance = np.minimum(np.abs(step), np.abs(back))
        parallel = n @ m.T >= math.cos(self._config.track_angle)
        return np.asarray(parallel & (distance <= self._config.track_distance))


def plane_record(fit: PlaneFit, identity: int) -> PlaneRecord:
    """Return the record of a plane, with its outline."""
    return PlaneRecord(
        id=identity,
        kind=fit.kind,
        normal=fit.normal,
        offset=fit.offset,
        covariance=fit.covariance,
        support=fit.support,
        area=fit.area,
        quality=fit.quality,
        boundary=fit.boundary,
        holes=fit.holes,
        rms=fit.rms,
        centroid=fit.centroid,
    )
