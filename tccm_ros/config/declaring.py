"""How a parameter is declared: once, with unit, range and meaning."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["Group", "param"]


def param(
    default: Any,
    meaning: str,
    *,
    unit: str = "",
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    read_only: bool = False,
) -> Any:
    """Declare one parameter.

    Parameters
    ----------
    default
        Value when nothing is set.
    meaning
        One line for the YAML file, the node's descriptor and the README.
    unit
        SI unit, or empty for a pure number or a name.
    ge, gt, le
        Limits, in `unit`.
    read_only
        Whether a running node refuses to change it (frames, sizes and structure).
    """
    return Field(
        default,
        description=meaning,
        ge=ge,
        gt=gt,
        le=le,
        json_schema_extra={"unit": unit, "read_only": read_only},
    )


class Group(BaseModel):
    """Base of all groups: unknown keys are errors, assignments are checked, numbers are finite."""

    model_config = ConfigDict(extra="forbid", validate_assignment=True, allow_inf_nan=False)
