"""Ceilings over a board: undersides of other boards, and undersides of no mapped surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Bool, Float64
from tccm_ros.racks.compartment import FaceState
from tccm_ros.racks.faces import lower_end
from tccm_ros.records import HITS_CUBE
from tccm_ros.tabletop.free_places import polygon_parts

MIN_HEIGHT = 0.10
"""Minimum height of a compartment, m; chosen: the height of a hand."""

MAX_HEIGHT = 1.0
"""Maximum height of a compartment, m. Chosen: objects are put into a higher space from above."""

MIN_EXTENT = 0.2
"""Minimum side length of a compartment, m; chosen: boards of shelves are deeper, the tops of
objects on them are not."""

MIN_FILLED = 0.8
"""Minimum fraction of their bounding rectangle, and of an edge, that boards fill; chosen: an L
fills less."""

MAX_BOARD = 0.04
"""Maximum thickness of a board, m, assumed for an underside that was not measured. Chosen: boards
of shelves are 16 to 40 mm thick."""

EDGE = 0.05
"""Maximum distance of hits on the front of a board from its edge, m; chosen: the error of an edge
is 2 cm, and the rest is a cube of hits."""

INNER = 0.08
"""Hits further than this from the sides and the back do not belong to them, m; chosen."""

FLAT = 0.02
"""Maximum vertical extent of a hit on an underside, m; chosen: noise on 4 cm."""

MIN_COVERED = 0.2
"""Minimum fraction of the area of an underside that its hits cover; chosen: there are gaps between
scan lines."""

LEVELS = 4
"""Levels of height in `FLAT`, at which undersides are looked for."""

MIN_FRONT_CELLS = 3
"""Minimum number of hit cubes along the front of a board; chosen: fewer may be mixed pixels."""


GRID = 1e-4
"""Grid of outlines that nearly coincide, m: a numerical tolerance."""


@dataclass(frozen=True, slots=True, eq=False)
class Ceiling:
    """The ceiling over a part of a board, in the frame of the board.

    Attributes
    ----------
    low, high
        float64 (2,), corners of the part, x and y, m.
    height
        Height of the underside over the board, m.
    state
        Whether the underside was measured.
    above
        Index of the board above; -1 where the underside belongs to no surface. Where it was not
        measured either, hits on an edge may be those of a board's front.
    """

    low: Float64
    high: Float64
    height: float
    state: FaceState
    above: int


@dataclass(frozen=True, slots=True, eq=False)
class BoardAbove:
    """A board above another one, in the frame of the lower one.

    Attributes
    ----------
    outline
        Seen from above, m.
    top
        Height of its top, m.
    index
        Index of the board.
    """

    outline: Polygon
    top: float
    index: int


def ceilings(
    outline: shapely.Geometry,
    boards: Sequence[BoardAbove],
    ends: Float64,
    half: Float64,
    origins: Float64,
) -> Iterator[Ceiling]:
    """Yield the ceilings over the rectangular parts of a board, the lowest first.

    Parameters
    ----------
    outline
        Outline of the board in its frame, seen from above, m.
    boards
        Boards above it.
    ends, half
        float64 (M, 3) and (M,), middles of hits in the frame of the board, and half their heights.
    origins
        float64 (M, 3), position of the sensor that measured each hit, in the frame of the board.
    """
    is_from_below = origins[:, 2] < ends[:, 2]
    left = outline
    for board in sorted(boards, key=lambda b: (b.top, b.index)):
        part = _widest(left.intersection(board.outline))
        if _is_rectangular(part):
            height, state = _lower_side(part, board, ends, half, origins)
            low, high = np.reshape(part.bounds, (2, 2))
            if MIN_HEIGHT <= height <= MAX_HEIGHT:
                yield Ceiling(low, high, height, state, board.index)
        if not part.is_empty:
            left = left.difference(board.outline)
    rest = _widest(left)
    if _is_rectangular(rest):
        yield from _unnamed(rest, ends, half, is_from_below)


def _widest(area: shapely.Geometry) -> shapely.Geometry:
    """Return the largest polygon of an area after an opening by `MIN_EXTENT`; empty without one."""
    area = MultiPolygon(polygon_parts(area))
    opened = area.buffer(-0.5 * MIN_EXTENT, join_style="mitre")
    largest = max(polygon_parts(opened), key=lambda part: part.area, default=Polygon())
    whole = largest.buffer(0.5 * MIN_EXTENT, join_style="mitre")
    return shapely.intersection(whole, area, grid_size=GRID)


def _is_rectangular(area: shapely.Geometry) -> bool:
    """Return whether an area fills its bounds; those of a corner of a board are no faces."""
    return bool(area.area > MIN_FILLED * area.envelope.area)


def _lower_side(
    part: shapely.Geometry, board: BoardAbove, ends: Float64, half: Float64, origins: Float64
) -> tuple[float, FaceState]:
    """Return height, m, and state of the underside of a board over a part of the lower one.

    It is measured by hits from below, else by the lower end of its widest front, else unknown.
    Beams pass below a front, which distinguishes it from a side or a back.
    """
    (low, high), top = np.reshape(part.bounds, (2, 2)), board.top
    is_from_below = origins[:, 2] < ends[:, 2]
    inner = ((ends[:, :2] > low + INNER) & (ends[:, :2] < high - INNER)).all(axis=1)
    z = ends[:, 2]
    below = (z < top - FLAT / 4.0) & (z > top - 2.0 * MAX_BOARD)
    seen = z[inner & below & is_from_below & (half <= 0.5 * FLAT)]
    if len(seen) >= MIN_FRONT_CELLS**2:
        return float(np.median(seen)), FaceState.MEASURED
    fronts = []
    for axis, edges in product(range(2), (low, high)):
        middle, half_width = (0.5 * (low + high))[1 - axis], 0.5 * (high - low)[1 - axis] - INNER
        shift = edges[axis], middle, 0.0
        a, b = (p[:, [axis, 1 - axis, 2]] - shift for p in (origins, ends))
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = a[:, 2] - a[:, 0] * (b[:, 2] - a[:, 2]) / (b[:, 0] - a[:, 0])
        on = below & (np.abs(b[:, 0]) <= EDGE) & (np.abs(b[:, 1]) < half_width) & (crossing < top)
        width = len(np.unique(np.floor(b[on, 1] / HITS_CUBE)))
        if width < MIN_FRONT_CELLS:
            continue
        offset = float(np.median(b[on, 0]))
        height = lower_end(on, b, a, half, offset, half_width, top - MAX_BOARD)
        if height is not None:
            fronts.append((width, height))
    if fronts:
        return max(fronts)[1], FaceState.MEASURED
    return top - MAX_BOARD, FaceState.UNKNOWN


def _unnamed(
    part: shapely.Geometry, ends: Float64, half: Float64, is_from_below: Bool
) -> Iterator[Ceiling]:
    """Yield the lowest underside over a part of a board that belongs to no surface of the map.

    Hits within `EDGE` of the sides and the back are theirs: an underside whose other hits come near
    an edge of the part ends there. If hits on an edge may be the front of a board, another one is
    at `MAX_HEIGHT` and unknown.
    """
    low, high = np.reshape(part.bounds, (2, 2))
    z = ends[:, 2]
    flat = is_from_below & (half <= 0.5 * FLAT) & (z > MIN_HEIGHT) & (z < MAX_HEIGHT)
    inner = ((ends[:, :2] > low + EDGE) & (ends[:, :2] < high - EDGE)).all(axis=1) & flat
    cells = np.floor((ends[inner, :2] - low) / HITS_CUBE).astype(np.int64)
    levels = np.floor((z[inner] - MIN_HEIGHT) * (LEVELS / FLAT)).astype(np.int64)
    count = round(LEVELS * (MAX_HEIGHT - MIN_HEIGHT) / FLAT)
    nx, ny = np.ceil((high - low) / HITS_CUBE)
    is_hit = np.zeros((count + LEVELS, int(nx), int(ny)), np.bool_)
    is_hit[levels, cells[:, 0], cells[:, 1]] = True
    covered = np.array([is_hit[k : k + LEVELS].any(axis=0).sum() for k in range(count)])
    for k in np.flatnonzero(covered >= MIN_COVERED * (MIN_EXTENT / HITS_CUBE) ** 2).tolist():
        first = k + int(covered[k:][: LEVELS + 1].argmax())
        on = (levels >= first) & (levels < first + LEVELS)
        at = ends[inner, :2][on]
        begin, end = at.min(axis=0), at.max(axis=0)
        if covered[first] < MIN_COVERED * (end - begin + HITS_CUBE).prod() / HITS_CUBE**2:
            continue
        begin = np.where(begin - low <= EDGE + HITS_CUBE, low, begin)
        end = np.where(high - end <= EDGE + HITS_CUBE, high, end)
        if (end - begin).min() >= MIN_EXTENT:
            height = float(np.median(z[inner][on]))
            yield Ceiling(begin, end, height, FaceState.MEASURED, -1)
            break
    if _may_have_front(low, high, ends[(z > 0.0) & (z < MAX_HEIGHT)]):
        yield Ceiling(low, high, MAX_HEIGHT, FaceState.UNKNOWN, -1)


def _may_have_front(low: Float64, high: Float64, ends: Float64) -> bool:
    """Return whether hits at one height, with none below them, fill an edge."""
    outer = ends[((ends[:, :2] > low - EDGE) & (ends[:, :2] < high + EDGE)).all(axis=1)]
    for axis in range(2):
        length = (high - low)[1 - axis]
        for edge in (low[axis], high[axis]):
            on = outer[np.abs(outer[:, axis] - edge) <= EDGE]
            along = np.floor((on[:, 1 - axis] - low[1 - axis] + EDGE) / HITS_CUBE).astype(np.int64)
            is_hit = np.zeros(
                (int(MAX_HEIGHT / HITS_CUBE) + 1, int((length + 2 * EDGE) / HITS_CUBE) + 1)
            )
            is_hit[np.floor(on[:, 2] / HITS_CUBE).astype(np.int64), along] = 1.0
            lowest = np.diff(is_hit, axis=0) > 0.0
            if lowest.sum(axis=1).max() * HITS_CUBE > MIN_FILLED * length:
                return True
    return False
