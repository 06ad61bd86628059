"""Disk cache of compiled kernels, with keys that change with all of their inputs.

numba's own cache only checks whether the file of a kernel has changed. The functions that a kernel
calls are compiled into it, so after a change of such a function in another file the old code would
silently be used. Here the key is a hash of the bytecode of the kernel and of all kernels that it
calls, of the constants that they use, of the argument types, and of the versions of numba, NumPy
and the processor. So a changed kernel is never found in the cache, regardless of file times.
Comments do not change the key.

The folder is the user's (`$XDG_CACHE_HOME/tccm_ros`), or `$NUMBA_CACHE_DIR/tccm_ros`, so that it
works for a read-only installation, and processes and checkouts use it together.
"""

from __future__ import annotations

import enum
import hashlib
import os
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite.binding import parse_bitcode
from numba.core import compiler
from numba.core.caching import _Cache
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

OPTIONS = ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX")
"""numba settings (environment variables `NUMBA_...`) that change the generated code."""

KEPT = 24
"""Number of files kept per kernel, the newest. Chosen: some argument types and versions."""


class KernelCache(_Cache):
    """Cache of the overloads of one kernel.

    Parameters
    ----------
    function
        Python function of the kernel.
    """

    def __init__(self, function: FunctionType) -> None:
        self._function = function
        self._is_enabled = True
        self._key = ""

    @property
    def cache_path(self) -> str:
        """Return the folder of all kernels."""
        return str(cache_folder())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for some argument types; None if it is not cached."""
        target_context.refresh()
        self._key = self._key_of(sig, target_context.codegen())
        if not self._is_enabled:
            return None
        with suppress(OSError, EOFError, pickle.UnpicklingError, AttributeError, ImportError):
            payload = pickle.loads(self._path(self._key).read_bytes())
            loaded = compiler.CompileResult._rebuild(target_context, *payload)
            _release_module(loaded.library, payload[0])
            return loaded
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a kernel that was compiled after `load_overload` did not find it."""
        is_relocatable = not (data.lifted or data.library.has_dynamic_globals)
        # A constant may have been replaced meanwhile, and it is unknown which one was compiled.
        if self._is_enabled and is_relocatable and self._key == self._key_of(sig, data.codegen):
            with suppress(OSError):
                _write(self._path(self._key), dumps(data._reduce()))
                self._remove_old()

    def enable(self) -> None:
        """Enable the cache."""
        self._is_enabled = True

    def disable(self) -> None:
        """Disable the cache."""
        self._is_enabled = False

    def flush(self) -> None:
        """Remove the cached files of this kernel."""
        for path in self._files():
            path.unlink(missing_ok=True)

    @property
    def _name(self) -> str:
        return f"{self._function.__module__}.{self._function.__qualname__}".replace("<locals>", "_")

    def _path(self, key: str) -> Path:
        return cache_folder() / f"{self._name}.{key}.nbc"

    def _key_of(self, sig: Any, codegen: Any) -> str:
        versions = (numba.__version__, np.__version__, codegen.magic_tuple())
        options = [str(getattr(numba.config, name, None)) for name in OPTIONS]
        content = f"{source_digest(self._function)} {sig} {versions} {options}"
        return hashlib.sha256(content.encode()).hexdigest()[:32]

    def _files(self) -> list[Path]:
        found = cache_folder().glob(f"{self._name}.{'[0-9a-f]' * 32}.nbc")
        return sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)

    def _remove_old(self) -> None:
        for path in self._files()[KEPT:]:
            path.unlink(missing_ok=True)


@cache
def cache_folder() -> Path:
    """Return the folder of the compiled kernels, creating it if needed.

    If the user's folder is not writable, it is one in the temporary folder. Files in it are run as
    code, so only a folder owned by this user is accepted.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    root = os.environ.get("NUMBA_CACHE_DIR") or home
    shared = Path(tempfile.gettempdir()) / f"tccm_ros_{os.getuid()}"
    for folder in (Path(root) / "tccm_ros", shared):
        with suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if folder.stat().st_uid == os.getuid() and os.access(folder, os.W_OK):
                return folder
    return Path(tempfile.mkdtemp(prefix="tccm_ros_"))


def _release_module(library: Any, serialized: tuple[str, str, Any]) -> None:
    """Free the LLVM module of a loaded kernel; it is parsed again if another kernel links to it.

    The machine code is separate. The modules of all kernels would take 26 MB of tccm_node.
    """
    _, kind, content = serialized
    if kind == "object":
        _, bitcode = content
        library._shared_module.close()
        linked = {"_shared_module": None, "_get_module_for_linking": lambda: parse_bitcode(bitcode)}
        vars(library).update(linked)


def source_digest(function: FunctionType) -> str:
    """Return a hash of the bytecode of a kernel and of everything compiled into it.

    Parameters
    ----------
    function
        The Python function of a kernel.

    Returns
    -------
    str
        Equal for equal code and constants in any file, process or checkout.
    """
    waiting, reached = [function], dict[int, FunctionType]()
    total = hashlib.sha256()
    while waiting:
        current = waiting.pop()
        if id(current) in reached:
            continue
        reached[id(current)] = current
        total.update(repr([_code(current.__code__), current.__defaults__]).encode())
        for name, value in _globals(current):
            if isinstance(value, Dispatcher):
                waiting.append(value.py_func)
                total.update(f"{name} calls {value.targetoptions}".encode())
            else:
                total.update(f"{name} is {_constant(value)}".encode())
    return total.hexdigest()


def _code(code: CodeType) -> tuple[Any, ...]:
    """Return the content of a function's code, without file name, line numbers and docstring."""
    constants = [
        _code(c) if isinstance(c, CodeType) else (type(c).__name__, c)
        for i, c in enumerate(code.co_consts)
        if not (i == 0 and isinstance(c, str))  # the docstring
    ]
    return code.co_name, code.co_code, code.co_names, code.co_varnames, constants


def _globals(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the module-level names and values that a function may use."""
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        codes += [c for c in code.co_consts if isinstance(c, CodeType)]
        for name in code.co_names:
            if name in function.__globals__:
                yield name, function.__globals__[name]
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
        yield name, cell.cell_contents


def _constant(value: Any) -> str:
    """Return a text that identifies a constant compiled into a kernel."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.descr} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, (bool, int, float, complex, str, np.generic, np.dtype)):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, tuple):
        return f"{type(value).__name__} {[_constant(item) for item in value]}"
    if isinstance(value, enum.EnumMeta):
        members: dict[str, enum.Enum] = dict(value.__members__)
        return f"{value.__name__} {[(n, _constant(m.value)) for n, m in members.items()]}"
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value))}"


def _write(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    number, name = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(content)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
