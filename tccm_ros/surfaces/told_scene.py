"""The planning scene as its listeners know it: the newest solution, less what is taken."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from tccm_ros.errors import MessageError
from tccm_ros.surfaces.planning_shapes import ITEM_PREFIX, Box, Mesh
from tccm_ros.surfaces.scene_diff import SceneDiff, Shapes, scene_diff, told


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
        Its shape in map when it was taken; None to put it down.
    """

    name: str
    link: str
    touch_links: tuple[str, ...] = ()
    shape: Box | Mesh | None = None


class Changes(NamedTuple):
    """Changes for the listeners: around the robot, and of what it holds."""

    diff: SceneDiff
    held: tuple[HeldObject, ...] = ()

    def __bool__(self) -> bool:
        return any(self.diff) or bool(self.held)


class ToldScene:
    """Shapes of the newest solution, with objects that are left out or held by the robot."""

    def __init__(self) -> None:
        self._known: Shapes = {}
        self._told: Shapes = {}
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

    def update(self, known: Shapes) -> Changes:
        """Return the changes by the shapes of a new solution."""
        self._known, self._put_down = known, {}
        return self._changes()

    def repeat(self) -> Changes:
        """Return everything, for listeners that know nothing."""
        self._told = {}
        return self._changes(*self._held.values())

    def set_state(
        self, identity: int, state: int, link: str = "", touch_links: tuple[str, ...] = ()
    ) -> Changes:
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
        name = f"{ITEM_PREFIX}{identity}"
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
            self._told = {**self._told, name: shape}  # MoveIt puts it into the world
            del self._held[name]
        if state == ObjectState.LEFT_OUT:
            self._left_out.add(name)
        elif state == ObjectState.ATTACHED:
            self._held[name] = HeldObject(name, link, touch_links, shape)
            held.append(self._held[name])
            # MoveIt takes it out of the world
            self._told = {other: s for other, s in self._told.items() if other != name}
        return self._changes(*held)

    def _changes(self, *held: HeldObject) -> Changes:
        diff = scene_diff(self._told, self.shapes)
        self._told = told(self._told, diff)
        return Changes(diff, held)
