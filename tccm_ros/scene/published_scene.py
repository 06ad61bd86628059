"""The published planning scene: the newest solution except hidden and attached objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from tccm_ros.errors import MessageError
from tccm_ros.scene.planning_shapes import OBJECT_PREFIX, Box, Mesh

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


class ObjectState(IntEnum):
    """States of an object, numbered as in tccm_interfaces/SetSceneObject."""

    SHOWN = 0
    LEFT_OUT = 1
    ATTACHED = 2


class HeldObject(NamedTuple):
    """An object on a link of the robot.

    Attributes
    ----------
    name
        Name of the collision object.
    link
        The link that holds it.
    touch_links
        Further links that may touch it.
    shape
        Its shape in map when it was attached; None: detach.
    """

    name: str
    link: str
    touch_links: tuple[str, ...] = ()
    shape: Box | Mesh | None = None


class SceneChanges(NamedTuple):
    """Changes for the listeners: of the scene, and of the objects that the robot holds."""

    diff: SceneDiff
    held: tuple[HeldObject, ...] = ()

    def __bool__(self) -> bool:
        return any(self.diff) or bool(self.held)


class PublishedScene:
    """Shapes of the newest solution, with objects that are hidden or held by the robot."""

    def __init__(self) -> None:
        self._known: Shapes = {}
        self._published: Shapes = {}
        self._left_out: set[str] = set()
        self._held: dict[str, HeldObject] = {}
        self._put_down: dict[str, Box | Mesh] = {}

    @property
    def shapes(self) -> dict[str, Box | Mesh]:
        """Shapes of the world: those of the solution that are neither left out nor held.

        An object that was put down after the solution is one of them.
        """
        hidden = self._left_out | self._held.keys()
        world = {**self._known, **self._put_down}
        return {name: shape for name, shape in world.items() if name not in hidden}

    def update(self, known: Shapes) -> SceneChanges:
        """Return the changes by the shapes of a new solution."""
        self._known, self._put_down = known, {}
        return self._changes()

    def repeat(self) -> SceneChanges:
        """Return everything, for listeners that know nothing."""
        self._published = {}
        return self._changes(*self._held.values())

    def set_state(
        self, identity: int, state: int, link: str = "", touch_links: tuple[str, ...] = ()
    ) -> SceneChanges:
        """Show, leave out or attach an object; return the changes.

        Parameters
        ----------
        identity
            Id of the object.
        state
            One of `ObjectState`.
        link, touch_links
            The link that holds an attached object, and further links that may touch it.

        Raises
        ------
        MessageError
            If the object or the state is unknown, or the link is missing.
        """
        name = f"{OBJECT_PREFIX}{identity}"
        before = self._held.get(name)
        shape = self._put_down.get(name) or self._known.get(name)
        shape = shape if before is None else before.shape
        if state not in list(ObjectState):
            raise MessageError(f"state is {state}, expected SHOWN, LEFT_OUT or ATTACHED")
        if shape is None and not (name in self._left_out and state == ObjectState.SHOWN):
            raise MessageError(f"there is no object {identity}; ~/find_objects has them")
        if state == ObjectState.ATTACHED and not link:
            raise MessageError("link_name is empty: name the link that holds the object")
        self._left_out.discard(name)
        held = []
        if before is not None and shape is not None:
            held.append(HeldObject(name, before.link))
            self._put_down[name] = shape
            self._published = {**self._published, name: shape}  # MoveIt puts it into the world
            del self._held[name]
        if state == ObjectState.LEFT_OUT:
            self._left_out.add(name)
        elif state == ObjectState.ATTACHED:
            self._held[name] = HeldObject(name, link, touch_links, shape)
            held.append(self._held[name])
            # MoveIt takes it out of the world
            self._published = {other: s for other, s in self._published.items() if other != name}
        return self._changes(*held)

    def _changes(self, *held: HeldObject) -> SceneChanges:
        diff = scene_diff(self._published, self.shapes)
        self._published = after_diff(self._published, diff)
        return SceneChanges(diff, held)


def scene_diff(before: Shapes, after: Shapes) -> SceneDiff:
    """Return the changes between two scenes that exceed `MIN_CHANGE`.

    Parameters
    ----------
    before
        Shapes as the listeners know them, `after_diff`; so that small changes do not add up.
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


def after_diff(before: Shapes, diff: SceneDiff) -> Shapes:
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
