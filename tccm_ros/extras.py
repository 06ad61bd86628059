"""Checks of the optional dependencies (extras) of the package."""

from __future__ import annotations

from importlib.util import find_spec

from tccm_ros.errors import MissingExtraError

FLEET = ("distributed", "duckdb", "fsspec", "pyarrow")
"""Modules of the extra `fleet` that its commands import."""


def check_extra(extra: str, *modules: str) -> None:
    """Check that the modules of an extra can be imported.

    Parameters
    ----------
    extra
        Name of the extra in setup.py.
    modules
        Top-level module names.

    Raises
    ------
    MissingExtraError
        If one cannot be imported; the message says how to install the extra.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"{', '.join(missing)} not installed; "
            f"install the extra: pip install 'tccm_ros[{extra}]'"
        )
