"""Decorator of kernels: functions compiled by numba and cached on disk."""

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
    """Compile a function for the types of its arguments, and cache it on disk.

    It runs without the global interpreter lock. If the environment variable `NUMBA_DISABLE_JIT` is
    set, it remains a Python function.

    Parameters
    ----------
    function
        Function of numbers and arrays.
    options
        Options of `numba.njit`: ``inline``, ``error_model``.
    """
    if function is None:
        return lambda undecorated: kernel(undecorated, **options)
    compiled = njit(nogil=True, **options)(function)
    if isinstance(compiled, Dispatcher):
        # As numba's `enable_caching` does with its own cache.
        vars(compiled)["_cache"] = KernelCache(compiled.py_func)
    return cast(Function, compiled)
