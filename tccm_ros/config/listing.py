"""All parameters in a list, for the YAML file, the nodes and the README."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tccm_ros.config.declaring import Group
from tccm_ros.config.whole import Config

__all__ = ["Parameter", "parameters"]


class Parameter(NamedTuple):
    """One parameter as the YAML file, the nodes and the README show it."""

    name: str
    default: Any
    type: Any
    unit: str
    minimum: float | None
    maximum: float | None
    meaning: str
    read_only: bool


def parameters(group: type[BaseModel] = Config, prefix: str = "") -> Iterator[Parameter]:
    """Yield every parameter in the order of declaration, named ``group.key``."""
    for key, field in group.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, Group):
            yield from parameters(annotation, f"{prefix}{key}.")
        else:
            yield _parameter(f"{prefix}{key}", field)


def _parameter(name: str, field: FieldInfo) -> Parameter:
    limits = {"ge": None, "gt": None, "le": None}
    for constraint in field.metadata:
        for key in limits:
            limits[key] = getattr(constraint, key, limits[key])
    extra = field.json_schema_extra
    assert isinstance(extra, dict)
    minimum = limits["ge"] if limits["ge"] is not None else limits["gt"]
    return Parameter(
        name,
        field.default,
        field.annotation,
        str(extra["unit"]),
        minimum,
        limits["le"],
        field.description or "",
        bool(extra["read_only"]),
    )
