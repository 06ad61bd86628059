"""Declaration of a parameter with unit, range and meaning, and the list of declared parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo


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
        Value where none is set.
    meaning
        One line for the YAML file, the node's descriptor and the reference.
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
    """Base of all groups: unknown keys are errors, assignments are checked, numbers are finite.

    The attributes of a group are parameters; `param` gives unit, range and meaning of each.
    """

    model_config = ConfigDict(extra="forbid", validate_assignment=True, allow_inf_nan=False)


class Parameter(NamedTuple):
    """One parameter as the YAML file, the nodes and the reference show it.

    Attributes
    ----------
    name
        ``group.key``.
    default, type
        Value where none is set, and the annotation.
    unit, meaning, read_only
        As of `param`.
    minimum, maximum
        Limits; None: no limit.
    excludes_minimum
        Whether values must be greater than `minimum`.
    """

    name: str
    default: Any
    type: Any
    unit: str
    minimum: float | None
    maximum: float | None
    excludes_minimum: bool
    meaning: str
    read_only: bool


def parameters_of(group: type[Group], prefix: str = "") -> Iterator[Parameter]:
    """Yield the parameters of a group in the order of declaration, named ``group.key``."""
    for key, field in group.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Group):
            yield from parameters_of(annotation, f"{prefix}{key}.")
        else:
            yield _parameter(f"{prefix}{key}", field)


def _parameter(name: str, field: FieldInfo) -> Parameter:
    limits = {"ge": None, "gt": None, "le": None}
    for constraint in field.metadata:
        for key in limits:
            limits[key] = getattr(constraint, key, limits[key])
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    excludes_minimum = limits["gt"] is not None
    return Parameter(
        name,
        field.default,
        field.annotation,
        str(extra["unit"]),
        limits["gt" if excludes_minimum else "ge"],
        limits["le"],
        excludes_minimum,
        field.description or "",
        bool(extra["read_only"]),
    )
