"""Live objects as plain arrays, and back: what a processor is in the middle of, whole.

A snapshot holds everything that is reached from an object of this package: no field has to be
named, so none can be forgotten. It is data, not code: a table in JSON, and the numbers of all
arrays in one array for each type. What it may make are objects of this package's rooms that hold
state, and nothing is called while it does. Objects that two others share are shared afterwards.

A class whose fields are not its state (they are of another library, or can be made anew) has
``freeze_state() -> Any`` and ``thaw_state(state)``.
"""

from __future__ import annotations

import hashlib
import importlib
import json
from collections import Counter, deque
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from sys import intern
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import BaseModel

from tccm_ros.config import Config
from tccm_ros.errors import MapError, TccmError

__all__ = ["Arrays", "fields_of", "freeze", "set_fields", "software", "thaw"]

Arrays = dict[str, NDArray[Any]]

ROOMS = frozenset(
    {"errors", "kinematics", "mapping", "records", "slam", "stamps", "surfaces", "sync"}
)
"""Rooms whose objects hold state."""

UNDER_THEM = frozenset({"config", "geometry", "scan", "scan_kernels", "snapshot"})
"""Rooms that those work with."""

TABLE = "table"
"""Name of the array with the JSON text."""

SEQUENCES: Mapping[str, type] = {"tuple": tuple, "list": list, "set": set, "frozenset": frozenset}
MAPPINGS: Mapping[str, type] = {"dict": dict, "counter": Counter}


@cache
def software() -> str:
    """Return a name of this software: other sources may keep other state under the same names."""
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        if path.relative_to(package).parts[0].removesuffix(".py") in ROOMS | UNDER_THEM:
            digest.update(path.read_bytes())
    return digest.hexdigest()


def freeze(root: Any, config: Config) -> Arrays:
    """Return an object, and all that it reaches, as named arrays.

    Parameters
    ----------
    root
        An object of this package, or containers, numbers and arrays.
    config
        Is not written: parts of it are named by their place in it.

    Returns
    -------
    dict of arrays
        One for each type of number, and the text `TABLE`. The same state gives the same bytes.

    Raises
    ------
    TypeError
        For what has no form: an object of another library, or a function.
    """
    frost = _Frost(config)
    top = frost.name(root)
    text = json.dumps({"root": top, "table": frost.table}, separators=(",", ":"))
    arrays = {name: np.concatenate(parts) for name, parts in sorted(frost.pools.items())}
    return {TABLE: np.frombuffer(text.encode(), np.uint8), **arrays}


def thaw(arrays: Mapping[str, NDArray[Any]], config: Config) -> Any:
    """Return the object of `freeze`.

    Parameters
    ----------
    arrays
        Of `freeze`, by the same `software`.
    config
        Equal to that of `freeze`.

    Raises
    ------
    MapError
        For arrays that are not of `freeze`, or damaged.
    """
    try:
        content = json.loads(np.asarray(arrays[TABLE], np.uint8).tobytes())
        return _Thaw(content["table"], arrays, config).value(content["root"])
    except (
        AttributeError,
        ImportError,
        LookupError,
        TypeError,
        ValueError,
        RecursionError,
        shapely.errors.GEOSException,
    ) as error:
        raise MapError(f"saved state is damaged: {type(error).__name__}: {error}") from None


class _Frost:
    """Writes objects into a table, each once; a reference is a list of one number."""

    def __init__(self, config: Config) -> None:
        self.table: list[Any] = []
        self.pools: dict[str, list[NDArray[Any]]] = {}
        self._lengths: Counter[str] = Counter()
        self._rows: dict[int, int] = {}
        self._alive: list[Any] = []
        self._config = config
        self._groups = {id(getattr(config, name)): name for name in type(config).model_fields}
        self._groups[id(config)] = ""

    def name(self, x: Any) -> Any:
        """Return what stands for a value: itself, if JSON has it, or a reference."""
        if x is None or type(x) in (bool, int, float, str):
            return x
        if id(x) not in self._rows:
            row = self._rows[id(x)] = len(self.table)
            self._alive.append(x)  # an id is a name only as long as its object lives
            self.table.append(None)
            self.table[row] = self._entry(x)
        return [self._rows[id(x)]]

    def _entry(self, x: Any) -> list[Any]:
        kind = type(x).__name__
        if isinstance(x, np.ndarray):
            return self._array(x)
        if isinstance(x, np.generic):
            return ["number", self._array(np.array(x))]
        if type(x) in (tuple, list):
            return [kind.lower(), [self.name(item) for item in x]]
        if type(x) in (set, frozenset):
            return [kind.lower(), [self.name(item) for item in sorted(x)]]
        if type(x) in (dict, Counter):
            return [kind.lower(), [[self.name(k), self.name(v)] for k, v in x.items()]]
        if type(x) is deque:
            return ["deque", [self.name(item) for item in x], x.maxlen]
        if isinstance(x, shapely.Geometry):
            return ["geometry", self._array(np.frombuffer(shapely.to_wkb(x), np.uint8))]
        if isinstance(x, BaseModel):
            return ["config", self._group(x)]
        if callable(x) and hasattr(x, "__self__"):
            return ["method", self.name(x.__self__), x.__name__]
        return self._object(x)

    def _object(self, x: Any) -> list[Any]:
        kind = type(x)
        home = f"{kind.__module__}.{kind.__qualname__}"
        if _room(kind.__module__) not in ROOMS or _class(kind.__module__, kind.__name__) != kind:
            raise TypeError(f"a snapshot has no form of {home}")
        if isinstance(x, tuple):
            return ["named", kind.__module__, kind.__name__, [self.name(item) for item in x]]
        if isinstance(x, TccmError):
            return ["error", kind.__module__, kind.__name__, [self.name(item) for item in x.args]]
        if hasattr(x, "freeze_state"):
            return ["own", kind.__module__, kind.__name__, self.name(x.freeze_state())]
        fields = [[name, self.name(value)] for name, value in fields_of(x).items()]
        return ["object", kind.__module__, kind.__name__, fields]

    def _array(self, x: NDArray[Any]) -> list[Any]:
        if x.dtype.kind not in "biuf":
            raise TypeError(f"a snapshot has no form of an array of {x.dtype}")
        by_columns = x.ndim > 1 and x.flags.f_contiguous and not x.flags.c_contiguous
        pool = x.dtype.str.lstrip("<|=")
        self.pools.setdefault(pool, []).append(x.ravel(order=_order(x.dtype, by_columns)))
        start = self._lengths[pool]
        self._lengths[pool] += x.size
        return ["array", pool, start, list(x.shape), by_columns, bool(x.flags.writeable)]

    def _group(self, x: BaseModel) -> str:
        if id(x) in self._groups:
            return self._groups[id(x)]
        for name in type(self._config).model_fields:
            if getattr(self._config, name) == x:
                return name
        raise TypeError(f"a snapshot has no form of {type(x).__name__}: it is not in the config")


class _Thaw:
    """Makes the objects of a table; what can hold itself is there before it is filled."""

    def __init__(self, table: list[Any], arrays: Mapping[str, NDArray[Any]], config: Config):
        self._table = table
        self._arrays = arrays
        self._config = config
        self._made: dict[int, Any] = {}
        self._makers: Mapping[str, Callable[..., Any]] = {
            "array": self._array,
            "number": lambda row, entry: self._array(row, *entry[1:])[()],
            "geometry": lambda row, entry: shapely.from_wkb(self._array(row, *entry[1:]).tobytes()),
            "config": lambda row, group: getattr(config, group) if group else config,
            "method": lambda row, owner, name: getattr(self.value(owner), name),
            "deque": self._deque,
            "named": self._named,
            "error": self._error,
            "own": self._own,
            "object": self._object,
            **{kind: partial(self._sequence, make) for kind, make in SEQUENCES.items()},
            **{kind: partial(self._mapping, make) for kind, make in MAPPINGS.items()},
        }

    def value(self, name: Any) -> Any:
        """Return what a name of `_Frost.name` stands for."""
        if not isinstance(name, list):
            return name
        (row,) = name
        if row not in self._made:
            kind, *rest = self._table[row]
            self._made[row] = self._makers[kind](row, *rest)
        return self._made[row]

    def _sequence(self, kind: type, row: int, names: list[Any]) -> Any:
        if kind is list:
            made: list[Any] = []
            self._made[row] = made
            made.extend(self.value(name) for name in names)
            return made
        return kind(self.value(name) for name in names)

    def _mapping(self, kind: type, row: int, names: list[Any]) -> Any:
        self._made[row] = made = kind()
        for key, value in names:
            made[self.value(key)] = self.value(value)
        return made

    def _deque(self, row: int, names: list[Any], longest: int | None) -> Any:
        made: deque[Any] = deque(maxlen=longest)
        self._made[row] = made
        made.extend(self.value(name) for name in names)
        return made

    def _named(self, row: int, module: str, name: str, names: list[Any]) -> Any:
        return tuple.__new__(_class(module, name), [self.value(item) for item in names])

    def _error(self, row: int, module: str, name: str, names: list[Any]) -> Any:
        kind = _class(module, name)
        return kind.__new__(kind, *(self.value(item) for item in names))

    def _own(self, row: int, module: str, name: str, state: Any) -> Any:
        kind = _class(module, name)
        self._made[row] = made = kind.__new__(kind)
        made.thaw_state(self.value(state))
        return made

    def _object(self, row: int, module: str, name: str, fields: list[Any]) -> Any:
        kind = _class(module, name)
        self._made[row] = made = kind.__new__(kind)
        set_fields(made, {field: self.value(value) for field, value in fields})
        return made

    def _array(
        self, row: int, pool: str, start: int, shape: list[int], by_columns: bool, writeable: bool
    ) -> NDArray[Any]:
        end = start + int(np.prod(shape, dtype=np.int64))
        if not 0 <= start <= end <= len(self._arrays[pool]):
            raise ValueError(f"numbers {start} to {end} of {len(self._arrays[pool])}")
        numbers = self._arrays[pool][start:end]
        array = numbers.reshape(shape, order=_order(numbers.dtype, by_columns))
        array = array.copy(order="F" if by_columns else "C")
        array.flags.writeable = writeable
        return array


def _order(dtype: np.dtype[Any], by_columns: bool) -> Literal["C", "F"]:
    """Return in which order the numbers of an array are kept, whatever their order in memory.

    Integers always by columns: these have like numbers, and become small in a file.
    """
    return "F" if by_columns or dtype.kind != "f" else "C"


def fields_of(x: Any, *left_out: str) -> dict[str, Any]:
    """Return an object's fields by name, whether it has slots or not, but those left out."""
    names = [n for kind in type(x).__mro__ for n in getattr(kind, "__slots__", ())]
    fields = {n: getattr(x, n) for n in names if not n.startswith("__") and hasattr(x, n)}
    fields.update(getattr(x, "__dict__", {}))
    return {name: value for name, value in fields.items() if name not in left_out}


def set_fields(x: Any, fields: Mapping[str, Any]) -> None:
    """Set an object's fields, frozen or not."""
    for name, value in fields.items():
        object.__setattr__(x, intern(name), value)  # Python keeps names: each only once


def _room(module: str) -> str:
    package, _, rest = module.partition(".")
    return rest.partition(".")[0] if package == "tccm_ros" else ""


def _class(module: str, name: str) -> Any:
    """Return a class of a room that holds state.

    Raises
    ------
    ValueError
        For anything else.
    """
    if _room(module) not in ROOMS:
        raise ValueError(f"'{module}' holds no state")
    kind = getattr(importlib.import_module(module), name)
    if not isinstance(kind, type) or kind.__module__ != module:
        raise ValueError(f"'{module}.{name}' is no class of that module")
    return kind
