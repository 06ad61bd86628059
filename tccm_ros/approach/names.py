"""Named spots on surfaces, in a file that users and programs edit: `named_poses.yaml`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tccm_ros.atomic import write_output
from tccm_ros.errors import ConfigError, suggest

NAME = re.compile(r"[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*")
"""Letters, digits, dots, dashes and underscores, in parts between slashes."""

KEYS = ("ids", "labels", "near_sign", "text", "spot", "side")

MAX_SPOT_M = 10.0
"""Largest x or y of a spot in the frame of its surface, m. Chosen: no table is longer."""


@dataclass(frozen=True, slots=True)
class NamedSpot:
    """A spot on the surface that meets some conditions.

    Attributes
    ----------
    ids, labels, near_sign, text
        Conditions of a surface, as in SurfaceFilter; one at least is set.
    spot
        x and y in the surface's own frame (Surface.pose), m; None: its middle.
    side
        Direction from the surface's middle to the side at which the base stands, in that frame,
        rad; None: any.
    """

    ids: tuple[int, ...] = ()
    labels: tuple[str, ...] = ()
    near_sign: str = ""
    text: str = ""
    spot: tuple[float, float] | None = None
    side: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of the file: the values that are set."""
        found: dict[str, Any] = {}
        for key in KEYS:
            value = getattr(self, key)
            if value not in ((), "", None):
                found[key] = list(value) if isinstance(value, tuple) else value
        return found


def read_names(path: Path) -> dict[str, NamedSpot]:
    """Return the names of a file; none where there is no file.

    Raises
    ------
    ConfigError
        For a file that cannot be read, and for an entry that makes no sense.
    """
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        raise ConfigError(f"{path.name} cannot be read as YAML") from None
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        raise ConfigError(f"{path.name} has no names; expected `kitchen/counter: {{ids: [3]}}`")
    return {str(name): spot_of(str(name), entry) for name, entry in tree.items()}


def check_name(name: str) -> None:
    """Check the characters of a name.

    Raises
    ------
    ConfigError
        For others than letters, digits, dots, dashes and underscores, between single slashes.
    """
    if not NAME.fullmatch(name):
        raise ConfigError(f"{name!r} is no name; expected letters, digits, . - _ and single /")


def spot_of(name: str, entry: Any) -> NamedSpot:
    """Return the spot of an entry of the file.

    Raises
    ------
    ConfigError
        For an entry that makes no sense; the message names the key.
    """
    check_name(name)
    if not isinstance(entry, Mapping) or not entry:
        raise ConfigError(f"{name}: expected a surface, as {{ids: [3]}} or {{labels: [table]}}")
    unknown = [key for key in entry if key not in KEYS]
    if unknown:
        raise ConfigError(f"{name}: no key {str(unknown[0])!r}{suggest(str(unknown[0]), KEYS)}")
    spot, side = entry.get("spot"), entry.get("side")
    try:
        made = NamedSpot(
            tuple(map(_identity, entry.get("ids", ()))),
            tuple(map(_text, entry.get("labels", ()))),
            _text(entry.get("near_sign", "")),
            _text(entry.get("text", "")),
            None if spot is None else _place(spot),
            None if side is None else _number(side, 2.0 * math.pi),
        )
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{name}: {error}") from None
    if not (made.ids or made.labels or made.near_sign or made.text):
        raise ConfigError(f"{name}: no surface is selected; set ids, labels, near_sign or text")
    return made


def write_names(path: Path, names: Mapping[str, NamedSpot]) -> None:
    """Write the file atomically, ordered by name.

    Raises
    ------
    OutputError
        If it cannot be written; the previous file is still there.
    """
    tree = {name: names[name].as_dict() for name in sorted(names)}
    write_output(path, yaml.safe_dump(tree, default_flow_style=None, sort_keys=False))


def _identity(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**31:
        raise ValueError(f"ids has {value!r}; expected ids of surfaces")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{value!r} is not a string")
    return value


def _number(value: Any, limit: float) -> float:
    number = float(value)
    if not abs(number) <= limit:
        raise ValueError(f"{value!r} is no number of at most {limit:.3g}")
    return number


def _place(value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError(f"spot is {value!r}; expected [x, y] in the surface's frame, m")
    return _number(value[0], MAX_SPOT_M), _number(value[1], MAX_SPOT_M)
