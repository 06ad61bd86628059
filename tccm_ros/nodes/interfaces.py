"""The types of tccm_interfaces, where that package can be imported."""

from __future__ import annotations

from importlib import import_module
from typing import Any

MISSING = (
    "tccm_interfaces is not installed: no typed messages, events and questions; build it "
    "(interfaces/README.md) and source the workspace"
)
"""What /diagnostics says without it."""


def has_interfaces() -> bool:
    """Return whether the package can be imported."""
    try:
        import_module("tccm_interfaces.msg")
        import_module("tccm_interfaces.srv")
    except ImportError:
        return False
    return True


def service_class(name: str) -> Any:
    """Return the class of a service such as ``FindSurfaces``."""
    return getattr(import_module("tccm_interfaces.srv"), name)
