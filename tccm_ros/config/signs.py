"""Parameters of door signs."""

from __future__ import annotations

from tccm_ros.config.parameter import Group, param


class Signs(Group):
    """Door signs that a camera reads."""

    enabled: bool = param(
        True, "look for door signs in the pictures of cameras (extra signs)", read_only=True
    )
    rate: float = param(
        2.0,
        "pictures that are looked at in a second of their stamps; the others are counted",
        unit="Hz",
        gt=0.0,
        le=30.0,
        read_only=True,
    )
