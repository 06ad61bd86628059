"""Availability of tccm_interfaces in this version, and its service classes."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from tccm_ros.bags.typestore import DEFINITIONS, TypestoreMessages

MISSING = (
    "tccm_interfaces is not installed: no typed messages, events and questions; build it "
    "(interfaces/README.md) and source the workspace"
)
"""Message on /diagnostics without the package."""

OLD = (
    "tccm_interfaces is of another version ({name} has other fields): no typed messages, events "
    "and questions; build it again (interfaces/README.md) and source the workspace"
)


def missing_interfaces() -> str:
    """Return why the package cannot be used, as a sentence; empty if it can."""
    try:
        installed = import_module("tccm_interfaces.msg")
        import_module("tccm_interfaces.srv")
    except ImportError:
        return MISSING
    return _difference(installed)


@cache
def _difference(installed: Any) -> str:
    """Return a sentence with the first message that has other fields; empty if there is none."""
    types = TypestoreMessages()
    for path in sorted(DEFINITIONS.glob("*.msg")):
        kind = getattr(installed, path.stem, None)
        expected = types.field_names(f"tccm_interfaces/msg/{path.stem}")
        if kind is None or list(kind.get_fields_and_field_types()) != expected:
            return OLD.format(name=path.stem)
    return ""


def has_interfaces() -> bool:
    """Return whether the package can be used."""
    return not missing_interfaces()


def service_class(name: str) -> Any:
    """Return the class of a service such as ``FindSurfaces``."""
    return getattr(import_module("tccm_interfaces.srv"), name)
