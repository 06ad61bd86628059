"""Reading of a configuration from a YAML file and ``--set`` options, with all checks."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from tccm_ros.config import Config, parameters
from tccm_ros.errors import ConfigError, one_line, suggest

REMOVED = {
    "map.retain_points": "points of the window are not kept any more",
    "sensors.laser_sigma": "it had no effect: noise is estimated from the points of planes",
    "sensors.cloud_sigma": "it had no effect: noise is estimated from the points of planes",
}
"""Parameters of release 0.1 that are gone, with the reason; release 0.2 ignores them and warns."""

LOG = logging.getLogger(__name__)


def read_config(path: Path | str | None = None, settings: Sequence[str] = ()) -> Config:
    """Read a configuration.

    Parameters
    ----------
    path
        A YAML file, nested by group or in ROS form (``/**: ros__parameters: ...``).
    settings
        ``group.key=value`` strings, which win over the file; values are YAML.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a bad value; the message names the most
        similar key.
    """
    tree: dict[str, Any] = Config().model_dump()
    where = "configuration"
    if path is not None:
        where = str(path)
        _merge(tree, _read_yaml(Path(path)), where)
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"'{setting}' is not a setting; write group.key=value")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            raise ConfigError(f"{key.strip()}: '{text}' is not a YAML value") from None
        _merge(tree, _nested(key.strip(), value), f"--set {setting}")
    return validated(tree, where)


def validated(tree: Mapping[str, Any], where: str) -> Config:
    """Check a tree of values and return it as a configuration, or raise ConfigError."""
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{where}: {key}: {first['msg'].lower()}, found {first['input']!r}"
        ) from None


def _read_yaml(path: Path) -> Mapping[str, Any]:
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({one_line(error)})") from None
    except (yaml.YAMLError, RecursionError):
        raise ConfigError(f"{path}: not a YAML file") from None
    if tree is None:
        return {}
    if not isinstance(tree, Mapping):
        raise ConfigError(f"{path}: a mapping of groups is expected, found {type(tree).__name__}")
    for value in tree.values():
        if isinstance(value, Mapping) and isinstance(value.get("ros__parameters"), Mapping):
            return value["ros__parameters"]
    return tree


def _nested(dotted: str, value: Any) -> dict[str, Any]:
    for part in reversed(dotted.split(".")):
        value = {part: value}
    return value


def _first_leaf(value: Any) -> str:
    """Return the dotted rest of the first key below an unknown group."""
    if not isinstance(value, Mapping) or not value:
        return ""
    key = next(iter(value))
    return f".{key}" + _first_leaf(value[key])


def _merge(tree: dict[str, Any], changes: Mapping[str, Any], where: str, prefix: str = "") -> None:
    for key, value in changes.items():
        if isinstance(key, str) and key not in tree and "." in key and not prefix:
            _merge(tree, _nested(key, value), where)
        elif (removed := f"{prefix}{key}") in REMOVED:
            LOG.warning("%s: %s is ignored: %s", where, removed, REMOVED[removed])
        elif key not in tree:
            known = [p.name for p in parameters()]
            name = f"{prefix}{key}" + _first_leaf(value)
            raise ConfigError(f"{where}: unknown key '{name}'" + suggest(name, known))
        elif isinstance(tree[key], dict) and isinstance(value, Mapping):
            _merge(tree[key], value, where, f"{prefix}{key}.")
        elif isinstance(tree[key], dict):
            raise ConfigError(f"{where}: {prefix}{key} is a group, found {value!r}")
        else:
            tree[key] = value
