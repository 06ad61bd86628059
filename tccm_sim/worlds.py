"""The simulated worlds by name."""

from __future__ import annotations

from tccm_ros.errors import ConfigError, suggest
from tccm_sim.changing import changing
from tccm_sim.flat import flat, rgbd_kitchen
from tccm_sim.little_geometry import (
    corridor,
    front,
    glass_corridor,
    lift,
    pole,
    round_hall,
    single_wall,
    turning,
)
from tccm_sim.office import office_signs
from tccm_sim.options import Options
from tccm_sim.ring import ring
from tccm_sim.rooms import load, moved, room, upside_down
from tccm_sim.tabletop import arm, gripper, shelf, situation, walkthrough
from tccm_sim.world import Builder, World

WORLDS: dict[str, tuple[Builder, str]] = {
    "flat": (flat, "a kitchen and a living room; the robot stops in places to scan"),
    "rgbd_kitchen": (rgbd_kitchen, "the flat's kitchen, seen by a depth camera on a head"),
    "office_signs": (office_signs, "ten offices on a corridor, with door signs; option alike"),
    "ring": (ring, "a ring of corridors, 100 m around, with 12 mrad/m of heading drift"),
    "room": (room, "floor, ceiling and walls to calibrate in; options clutter, ramp, people"),
    "moved": (moved, "a room seen twice; a table moves, a stool goes, a crate comes in between"),
    "changing": (changing, "two rooms visited in turn; tables are moved, lowered, carried over"),
    "upside_down": (upside_down, "a laser that hangs upside down, and other topic and frame names"),
    "situation_a": (situation("a"), "a table, 1.2 m x 0.8 m"),
    "situation_b": (situation("b"), "the front of a shelf"),
    "situation_c": (situation("c"), "A turned, with boxes on it and an arm that moves over it"),
    "situation_d": (situation("d"), "B turned, with an open drawer and knobs"),
    "shelf": (shelf, "a shelf with an open drawer, scanned while waist and neck move"),
    "arm": (arm, "A, and an arm of seven joints that moves over the table"),
    "gripper": (gripper, "A, and a gripper that moves up and down in view of the tilting laser"),
    "walkthrough": (walkthrough, "A with a person who walks past and objects that come and go"),
    "front": (front, "standing 1 m before a single flat front; option translation"),
    "corridor": (corridor, "25 m along a plain corridor whose ends are out of sight"),
    "single_wall": (single_wall, "12 m along a single wall"),
    "pole": (pole, "standing in the open with one pole in range"),
    "round_hall": (round_hall, "a round hall: turning, and driving across"),
    "glass_corridor": (glass_corridor, "25 m between panes of glass, seen at right angles alone"),
    "lift": (lift, "into a lift, and out of it on another floor"),
    "turning": (turning, "turning on the spot in a plain corridor"),
    "load": (load, "20 s of 1,081 beams at 40 Hz, while driving"),
}
"""Builder and description of each world."""


def build_world(name: str, options: Options | None = None) -> World:
    """Return a world.

    Raises
    ------
    ConfigError
        If there is no world of that name.
    """
    if name not in WORLDS:
        raise ConfigError(f"no world '{name}'{suggest(name, WORLDS)}")
    return WORLDS[name][0](options or Options())
