"""Select consistent pairs of maps, and the components that they form.

A wrong pair would distort the map. Pairs are taken in order of the number of three-map cycles that
they close, minus those that they break, then of the number of matched keyframes. A pair that
contradicts maps already in one frame is rejected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.fleet.pair_matching import PairMatch
from tccm_ros.geometry import between2, compose2, inverse2

MAX_CYCLE_ERROR = (0.3, 0.05)
"""Maximum closure error of a consistent cycle of maps (m, rad). Chosen: a relative pose comes from
a single match, and the maps are slightly distorted."""

Pair = tuple[int, int]


@dataclass(slots=True)
class Component:
    """Maps in one frame.

    Attributes
    ----------
    p_root_map
        float64 (3,) of each map, by index; zero for the first map.
    pairs
        Accepted pairs.
    """

    p_root_map: dict[int, Float64] = field(default_factory=dict)
    pairs: list[Pair] = field(default_factory=list)


def select_pairs(
    count: int, matches: Mapping[Pair, PairMatch]
) -> tuple[list[Component], set[Pair]]:
    """Return the components, the largest first, and the pairs that contradict others.

    Parameters
    ----------
    count
        Number of maps.
    matches
        Accepted matches (i, j), i < j.
    """
    components = [Component({k: np.zeros(3)}) for k in range(count)]
    contradicting: set[Pair] = set()
    for pair in sorted(matches, key=lambda p: (-_support(p, matches), -len(matches[p].loops), p)):
        i, j = pair
        one, other = (next(c for c in components if k in c.p_root_map) for k in pair)
        p_root_j = compose2(one.p_root_map[i], matches[pair].p_one_other)
        if one is other:
            if _is_same(one.p_root_map[j], p_root_j):
                one.pairs.append(pair)
            else:
                contradicting.add(pair)
            continue
        T = compose2(p_root_j, inverse2(other.p_root_map[j]))
        one.p_root_map |= {k: compose2(T, pose) for k, pose in other.p_root_map.items()}
        one.pairs += [*other.pairs, pair]
        components = [c for c in components if c is not other]
    for component in components:
        _begin_at_first(component)
    return sorted(components, key=lambda c: (-len(c.p_root_map), min(c.p_root_map))), contradicting


def _support(pair: Pair, matches: Mapping[Pair, PairMatch]) -> int:
    """Return the number of three-map cycles that a pair closes, minus those that it breaks."""
    i, j = pair
    support = 0
    for k in {k for p in matches for k in p} - {i, j}:
        first, second = _relative(matches, i, k), _relative(matches, k, j)
        if first is not None and second is not None:
            is_closed = _is_same(matches[pair].p_one_other, compose2(first, second))
            support += 1 if is_closed else -1
    return support


def _relative(matches: Mapping[Pair, PairMatch], i: int, j: int) -> Float64 | None:
    if (i, j) in matches:
        return matches[i, j].p_one_other
    return inverse2(matches[j, i].p_one_other) if (j, i) in matches else None


def _is_same(one: Float64, other: Float64) -> bool:
    error = between2(one, other)
    return bool(
        np.hypot(error[0], error[1]) <= MAX_CYCLE_ERROR[0] and abs(error[2]) <= MAX_CYCLE_ERROR[1]
    )


def _begin_at_first(component: Component) -> None:
    """Move the frame to the first map, and sort the maps and pairs."""
    to_first = inverse2(component.p_root_map[min(component.p_root_map)])
    poses = component.p_root_map
    component.p_root_map = {k: compose2(to_first, poses[k]) for k in sorted(poses)}
    component.pairs.sort()
