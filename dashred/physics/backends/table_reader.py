"""Compiled interpolation in a table whose values may change later.

Numba takes arrays of the enclosing scope for constants and copies them. The address of an array is
a constant, too, and leads to its present values.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.numpy_support import carray
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _typed_pointer(typing_context: Any, address: Any) -> Any:
    """Return the types and the code of :data:`_pointer`, an address as a pointer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.uintp), generate


_pointer: Any = intrinsic(_typed_pointer)


def table_reader(table: Array) -> Callable[[float, int], float]:
    """Return ``at(t, row)``: a row of the table at a time, for compiled code.

    Args:
        table: times in the first row, increasing, and values in the others, contiguous. It has to
            live as long as the function is called, and must not move.
    """
    address, shape = table.ctypes.data, table.shape

    @numba.njit(error_model="numpy")
    def at(t: float, row: int) -> float:
        now = carray(_pointer(address), shape, np.float64)
        value: float = np.interp(t, now[0], now[row])
        return value

    found: Callable[[float, int], float] = at
    return found
