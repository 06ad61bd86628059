"""The libraries of the extra ``fleet``, which nothing else needs."""

from __future__ import annotations

from importlib.util import find_spec

from tccm_ros.errors import FleetError

LIBRARIES = ("distributed", "duckdb", "fsspec", "pyarrow")


def check_installed() -> None:
    """Check that the libraries of the extra are there.

    Raises
    ------
    FleetError
        Where one is not; the message says how to install them.
    """
    missing = [name for name in LIBRARIES if find_spec(name) is None]
    if missing:
        raise FleetError(
            f"{', '.join(missing)} not installed; install the extra: pip install 'tccm_ros[fleet]'"
        )
