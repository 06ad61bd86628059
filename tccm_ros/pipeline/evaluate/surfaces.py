"""Surfaces against truth: which true surfaces were found, and which found ones are false.

A true surface is found if a surface of the map overlaps its outline (intersection over union of
the footprints) and has its height. Each is matched once, the best overlaps first.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.errors import LogError, one_line

__all__ = ["SurfaceMatch", "SurfaceScore", "score_surfaces"]

MIN_OVERLAP = 0.5
MAX_HEIGHT_ERROR = 0.02
"""A surface is found from this overlap on and within this error of height, m."""

FALSE_AREA = 0.1
"""A surface of at least this area, m2, that is nowhere in the truth is false."""


@dataclass(frozen=True, slots=True)
class SurfaceMatch:
    """One true surface and the surface of the map that was matched to it, if any.

    Attributes
    ----------
    label, height, area
        Of the truth, m and m2.
    found
        Id in the map, or None.
    overlap
        Intersection over union of the footprints.
    height_error
        Of the map, m; NaN where nothing was matched.
    """

    label: str
    height: float
    area: float
    found: int | None
    overlap: float
    height_error: float

    @property
    def is_found(self) -> bool:
        """Whether overlap and height are good enough."""
        return self.overlap >= MIN_OVERLAP and abs(self.height_error) <= MAX_HEIGHT_ERROR


@dataclass(frozen=True, slots=True)
class SurfaceScore:
    """All true surfaces, and the ids of the false ones.

    Attributes
    ----------
    matches
        In the order of the truth.
    false
        Ids of surfaces of `FALSE_AREA` or more that lie on no true surface.
    """

    matches: tuple[SurfaceMatch, ...]
    false: tuple[int, ...]

    @property
    def found(self) -> int:
        """How many true surfaces were found."""
        return sum(match.is_found for match in self.matches)

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        rows = [
            {
                "label": m.label,
                "height": m.height,
                "area": m.area,
                "found": m.found,
                "overlap": round(m.overlap, 4),
                "height_error": None if np.isnan(m.height_error) else round(m.height_error, 6),
            }
            for m in self.matches
        ]
        return {"found": self.found, "of": len(rows), "surfaces": rows, "false": list(self.false)}

    def text(self) -> str:
        """Return a Markdown table."""
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
    """Compare a surfaces.json with a truth.json of the same keys; floors are left out.

    Raises
    ------
    LogError
        If a file cannot be read or is not of that form.
    """
    map_surfaces = [s for s in _surfaces(Path(found)) if s["label"] != "floor"]
    true_surfaces = [s for s in _surfaces(Path(truth)) if s["label"] != "floor"]
    overlap = np.array([[_overlap(t, m) for m in map_surfaces] for t in true_surfaces])
    overlap = overlap.reshape(len(true_surfaces), len(map_surfaces))
    pairs = _best_first(overlap)
    matches = tuple(_match(t, map_surfaces, overlap, i, pairs) for i, t in enumerate(true_surfaces))
    covered = _all_outlines(true_surfaces, Path(truth))
    false = tuple(
        m["id"]
        for j, m in enumerate(map_surfaces)
        if m["area"] >= FALSE_AREA and j not in pairs.values() and not _is_on(m, covered)
    )
    return SurfaceScore(matches, false)


def _surfaces(path: Path, key: str = "surfaces") -> list[dict[str, Any]]:
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        entries = tree.get(key, [])
        return [entry | {"polygon": _polygon(entry)} for entry in entries]
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise LogError(f"{path}: not a surfaces file ({one_line(error)})") from None


def _polygon(entry: dict[str, Any]) -> Polygon:
    rings = [[point[:2] for point in ring] for ring in entry.get("holes", [])]
    return shapely.make_valid(Polygon([point[:2] for point in entry["boundary"]], rings))


def _overlap(true: dict[str, Any], found: dict[str, Any]) -> float:
    """Return intersection over union; 0 where the height is another one altogether."""
    if abs(found["height"] - true["height"]) > 2 * MAX_HEIGHT_ERROR:
        return 0.0
    common = true["polygon"].intersection(found["polygon"]).area
    return float(common / max(true["polygon"].union(found["polygon"]).area, 1e-12))


def _best_first(overlap: np.ndarray) -> dict[int, int]:
    pairs: dict[int, int] = {}
    order = np.argsort(-overlap, axis=None, kind="stable")
    for i, j in zip(*np.unravel_index(order, overlap.shape)):
        if overlap[i, j] > 0 and int(i) not in pairs and int(j) not in pairs.values():
            pairs[int(i)] = int(j)
    return pairs


def _match(
    true: dict[str, Any],
    found: list[dict[str, Any]],
    overlap: np.ndarray,
    index: int,
    pairs: dict[int, int],
) -> SurfaceMatch:
    j = pairs.get(index)
    head = (true["label"], true["height"], true["area"])
    if j is None:
        return SurfaceMatch(*head, None, 0.0, float("nan"))
    error = found[j]["height"] - true["height"]
    return SurfaceMatch(*head, found[j]["id"], float(overlap[index, j]), error)


def _all_outlines(true: list[dict[str, Any]], truth: Path) -> list[dict[str, Any]]:
    """Return all true level outlines, also those too small or too hidden to count as missed."""
    return true + _surfaces(truth, "others")


def _is_on(found: dict[str, Any], true: list[dict[str, Any]]) -> bool:
    return any(
        abs(found["height"] - t["height"]) <= MAX_HEIGHT_ERROR
        and found["polygon"].intersection(t["polygon"]).area > 0.5 * found["polygon"].area
        for t in true
    )
