"""Changes of the shapes of a planning scene, for listeners that know an earlier one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.surfaces.planning_shapes import Box, Mesh

MIN_CHANGE = 0.002
"""Maximum change of a shape that is not reported, m. Chosen: a fifth of the error of a shape."""

Shapes = Mapping[str, Box | Mesh]
"""Shapes in map by the name of the collision object."""


class SceneDiff(NamedTuple):
    """Changes of a planning scene.

    Attributes
    ----------
    add
        Shapes that are new or have another form, by name.
    move
        Boxes of known size at their new poses, by name.
    remove
        Names of shapes that have left.
    """

    add: dict[str, Box | Mesh]
    move: dict[str, Box]
    remove: tuple[str, ...]


def scene_diff(before: Shapes, after: Shapes) -> SceneDiff:
    """Return the changes between two scenes that exceed `MIN_CHANGE`.

    Parameters
    ----------
    before
        Shapes as the listeners know them, `told`; so that small changes do not add up.
    after
        Shapes of the newest solution.
    """
    diff = SceneDiff({}, {}, tuple(sorted(before.keys() - after.keys())))
    for name, shape in after.items():
        known = before.get(name)
        if known is None or not _have_one_form(known, shape):
            diff.add[name] = shape
        elif isinstance(shape, Box) and isinstance(known, Box) and _is_displaced(known, shape):
            diff.move[name] = replace(known, T_map_box=shape.T_map_box)
    return diff


def told(before: Shapes, diff: SceneDiff) -> Shapes:
    """Return the shapes that listeners know after a diff."""
    kept = {name: shape for name, shape in before.items() if name not in diff.remove}
    return kept | diff.add | diff.move


def _have_one_form(a: Box | Mesh, b: Box | Mesh) -> bool:
    """Return whether two boxes have one size, or two meshes the same vertices."""
    if isinstance(a, Box) and isinstance(b, Box):
        return a.is_round == b.is_round and bool((np.abs(a.size - b.size) <= MIN_CHANGE).all())
    return (
        isinstance(a, Mesh)
        and isinstance(b, Mesh)
        and a.vertices.shape == b.vertices.shape
        and np.array_equal(a.triangles, b.triangles)
        and bool((np.abs(a.vertices - b.vertices) <= MIN_CHANGE).all())
    )


def _is_displaced(a: Box, b: Box) -> bool:
    """Return whether the corners of a box of one size are displaced by more than `MIN_CHANGE`."""
    moved = b.T_map_box - a.T_map_box
    turned = np.abs(moved[:3, :3]) @ (0.5 * b.size)
    return bool((np.abs(moved[:3, 3]) + turned > MIN_CHANGE).any())
