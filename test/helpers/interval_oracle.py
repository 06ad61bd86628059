"""A brute-force TCCM on Python integers: intervals as sets of unit steps, moments as plain sums.

It uses no code of the package. Heights are in ticks; a cuboid (bottom, top) covers the unit steps
bottom .. top - 1. The code is slow and easy to verify.
"""

from collections import defaultdict
from fractions import Fraction

MOMENTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def part_cuboids(points, cell, depth):
    """Return {(ix, iy): [(bottom, top, moments)]} of integer points (x, y, z) in ticks."""
    cells = defaultdict(list)
    for x, y, z in points:
        cells[x // cell, y // cell].append((x % cell, y % cell, z))
    return {key: _components(inside, depth) for key, inside in cells.items()}


def _components(points, depth):
    """Return sets of points whose intervals touch, by pairwise merging without sorting."""
    groups = [[p] for p in points]
    joined = True
    while joined:
        joined = False
        for a in range(len(groups)):
            for b in range(a + 1, len(groups)):
                if any(abs(p[2] - q[2]) <= depth for p in groups[a] for q in groups[b]):
                    groups[a] += groups.pop(b)
                    joined = True
                    break
            if joined:
                break
    found = []
    for group in groups:
        zs = [p[2] for p in group]
        found.append((min(zs) - depth, max(zs), moments_of(group)))
    return sorted(found)


def moments_of(points):
    """Return (count, sums, sums of products) of integer points."""
    sums = [sum(p[i] for p in points) for i in range(3)]
    return (len(points), *sums, *(sum(p[i] * p[j] for p in points) for i, j in MOMENTS))


def pieces(parts):
    """Return {(ix, iy): [(bottom, top, cycle, index)]} of [(cycle, cuboids, voids)], oldest first.

    Each unit step of height belongs to the newest part that covers it, unless a newer part has a
    void there. `cuboids` is as from `part_cuboids`, `voids` {(ix, iy): [(bottom, top)]}.
    """
    owners = defaultdict(dict)
    for cycle, cuboids, voids in parts:
        for key, intervals in voids.items():
            for bottom, top in intervals:
                for step in range(bottom, top):
                    owners[key].pop(step, None)
        for key, found in cuboids.items():
            for index, (bottom, top, _) in enumerate(found):
                for step in range(bottom, top):
                    owners[key][step] = (cycle, index)
    return {key: _runs(steps) for key, steps in owners.items() if steps}


def _runs(owner_of):
    runs = []
    for step in sorted(owner_of):
        owner = owner_of[step]
        if runs and runs[-1][1] == step and runs[-1][2:] == owner:
            runs[-1] = (runs[-1][0], step + 1, *owner)
        else:
            runs.append((step, step + 1, *owner))
    return runs


def composites(pieces_of, parts):
    """Return [(ix, iy, bottom, top, exact moments, cycles)] of the pieces, sorted."""
    cuboids_by_cycle = {
        (cycle, key): found for cycle, found_in, _ in parts for key, found in found_in.items()
    }
    result = []
    for key in sorted(pieces_of):
        for bottom, top, cycle, index in pieces_of[key]:
            low, high, moments = cuboids_by_cycle[cycle, key][index]
            fraction = Fraction(top - bottom, high - low)
            weighed = [fraction * m for m in moments]
            if result and result[-1][:2] == [*key] and result[-1][3] == bottom:
                last = result[-1]
                last[3] = top
                last[4] = [a + b for a, b in zip(last[4], weighed, strict=True)]
                last[5] = sorted({*last[5], cycle})
            else:
                result.append([*key, bottom, top, weighed, [cycle]])
    return result
