"""Compare surfaces with ground truth: found surfaces and false ones.

A true surface is found if a surface of the map overlaps its outline (intersection over union of the
footprints) at its height. Each is matched once, the best overlaps first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Float64
from tccm_ros.results.folder_reader import read_json
from tccm_ros.results.models import (
    SurfaceEntry,
    SurfacesFile,
    TruthFile,
    TruthSurface,
    plan_polygon,
)
from tccm_ros.results.numbers import plain

MIN_OVERLAP = 0.5
MAX_HEIGHT_ERROR = 0.02
"""Minimum intersection over union and maximum height error (m) of a found surface. Chosen."""

FALSE_AREA = 0.1
"""Minimum area of a false surface, m2. Chosen."""

MIN_COVERED = 0.5
"""Minimum fraction of a surface on a true one of its height, for it not to be false. Chosen."""


@dataclass(frozen=True, slots=True)
class SurfaceMatch:
    """A true surface, and the surface of the map matched to it, if any.

    Attributes
    ----------
    label, height, area
        Label, height (m) and area (m2) of the truth.
    found
        Id in the map; None without a match.
    overlap
        Intersection over union of the footprints.
    height_error
        Height error of the map, m; NaN without a match.
    """

    label: str
    height: float
    area: float
    found: int | None
    overlap: float
    height_error: float

    @property
    def is_found(self) -> bool:
        """Whether overlap and height are within the limits."""
        return self.overlap >= MIN_OVERLAP and abs(self.height_error) <= MAX_HEIGHT_ERROR


@dataclass(frozen=True, slots=True)
class SurfaceScore:
    """Matches of all true surfaces, and the ids of false surfaces.

    Attributes
    ----------
    matches
        Matches, in the order of the truth.
    false
        Ids of surfaces of at least `FALSE_AREA` that are on no true surface.
    """

    matches: tuple[SurfaceMatch, ...]
    false: tuple[int, ...]

    @property
    def found(self) -> int:
        """Number of true surfaces found."""
        return sum(match.is_found for match in self.matches)

    def to_json(self) -> dict[str, Any]:
        """Return the score as plain data."""
        content = {"found": self.found, "of": len(self.matches)}
        return plain(content | {"surfaces": self.matches, "false": self.false})

    def text(self) -> str:
        """Return the score as a Markdown table."""
        lines = [
            f"{self.found} of {len(self.matches)} surfaces found, {len(self.false)} false",
            "",
            "| true surface | height, m | area, m2 | overlap | height error, mm | found |",
            "|---|---|---|---|---|---|",
        ]
        for m in self.matches:
            error = "" if np.isnan(m.height_error) else f"{1e3 * m.height_error:+.1f}"
            lines.append(
                f"| {m.label} | {m.height:.3f} | {m.area:.3f} | {m.overlap:.2f} | {error} | "
                f"{'yes' if m.is_found else 'no'} |"
            )
        return "\n".join(lines)


def score_surfaces(found: Path | str, truth: Path | str) -> SurfaceScore:
    """Compare a surfaces.json with a truth.json, without the floors.

    Raises
    ------
    MapError
        If a file cannot be read or has another format.
    """
    known = read_json(Path(truth), TruthFile)
    mapped = [_Footprint.of(s) for s in read_json(Path(found), SurfacesFile).surfaces]
    mapped = [m for m in mapped if m.surface.label != "floor"]
    true = [_Footprint.of(s) for s in known.surfaces if s.label != "floor"]
    overlap = np.array([[_overlap(t, m) for m in mapped] for t in true])
    overlap = overlap.reshape(len(true), len(mapped))
    pairs = _best_first(overlap)
    matches = []
    for i, (surface, _) in enumerate(true):
        head = (surface.label, surface.height, surface.area)
        if i not in pairs:
            matches.append(SurfaceMatch(*head, None, 0.0, float("nan")))
            continue
        match = mapped[pairs[i]].surface
        error = match.height - surface.height
        matches.append(SurfaceMatch(*head, match.id, float(overlap[i, pairs[i]]), error))
    # Small or hidden true surfaces do not count as missed, and surfaces on them are not false.
    covered = [*true, *map(_Footprint.of, known.others)]
    false = tuple(
        m.surface.id
        for j, m in enumerate(mapped)
        if m.surface.area >= FALSE_AREA and j not in pairs.values() and not _is_on(m, covered)
    )
    return SurfaceScore(tuple(matches), false)


class _Footprint(NamedTuple):
    """A surface with its outline from above."""

    surface: SurfaceEntry | TruthSurface
    polygon: shapely.Geometry

    @classmethod
    def of(cls, surface: SurfaceEntry | TruthSurface) -> _Footprint:
        return cls(surface, plan_polygon(surface))


def _overlap(true: _Footprint, found: _Footprint) -> float:
    """Return intersection over union; 0 if the heights differ much."""
    if abs(found.surface.height - true.surface.height) > 2 * MAX_HEIGHT_ERROR:
        return 0.0
    common = true.polygon.intersection(found.polygon).area
    return float(common / max(true.polygon.union(found.polygon).area, 1e-12))


def _best_first(overlap: Float64) -> dict[int, int]:
    pairs: dict[int, int] = {}
    order = np.argsort(-overlap, axis=None, kind="stable")
    for i, j in zip(*np.unravel_index(order, overlap.shape)):
        if overlap[i, j] > 0 and int(i) not in pairs and int(j) not in pairs.values():
            pairs[int(i)] = int(j)
    return pairs


def _is_on(found: _Footprint, true: Sequence[_Footprint]) -> bool:
    return any(
        abs(found.surface.height - t.surface.height) <= MAX_HEIGHT_ERROR
        and found.polygon.intersection(t.polygon).area > MIN_COVERED * found.polygon.area
        for t in true
    )
