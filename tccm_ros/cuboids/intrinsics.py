"""Intrinsics that numba lacks: the lowest set bit, and pointers."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from tccm_ros.kernels import kernel


def _cttz(typing_context: Any, word: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), build


_trailing_zeros: Any = intrinsic(_cttz)
"""Compiles to a single processor instruction."""


@kernel
def lowest_bit(word: Any) -> Any:
    """Return the index of the lowest set bit of a uint64 that is not zero."""
    return _trailing_zeros(word)


def _inttoptr(typing_context: Any, address: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())

    return types.voidptr(types.int64), build


pointer_to: Any = intrinsic(_inttoptr)
"""In a kernel: the pointer of an address, int64, for `numba.carray`, which does not check it."""
