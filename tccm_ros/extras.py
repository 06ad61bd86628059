"""Optional parts of the package: what each extra installs."""

from __future__ import annotations

from importlib.util import find_spec

from tccm_ros.errors import MissingExtraError


def check_extra(extra: str, *modules: str) -> None:
    """Check that the modules of an extra can be imported.

    Parameters
    ----------
    extra
        Its name in setup.py.
    modules
        Top-level names.

    Raises
    ------
    MissingExtraError
        Where one cannot; the message says how to install it.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"{', '.join(missing)} not installed; "
            f"install the extra: pip install 'tccm_ros[{extra}]'"
        )
