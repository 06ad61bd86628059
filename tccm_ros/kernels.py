"""The decorator of kernels: functions that numba compiles, and that are kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast, overload

from numba import njit
from numba.core.dispatcher import Dispatcher

from tccm_ros.kernel_cache import KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])


@overload
def kernel(function: Function) -> Function: ...


@overload
def kernel(**options: Any) -> Callable[[Function], Function]: ...


def kernel(function: Function | None = None, **options: Any) -> Any:
    """Compile a function for the types it is called with, and keep it on disk.

    It runs without Python's global lock. With the environment variable `NUMBA_DISABLE_JIT` it stays
    a Python function.

    Parameters
    ----------
    function
        Of numbers and arrays.
    options
        Of `numba.njit`: ``inline``, ``error_model``.
    """
    if function is None:
        return lambda undecorated: kernel(undecorated, **options)
    compiled = njit(nogil=True, **options)(function)
    if isinstance(compiled, Dispatcher):
        # As its `enable_caching` does, with numba's own cache.
        vars(compiled)["_cache"] = KernelCache(compiled.py_func)
    return cast(Function, compiled)
