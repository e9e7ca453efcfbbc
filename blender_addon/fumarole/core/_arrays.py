# SPDX-License-Identifier: GPL-3.0-or-later
"""Checked conversion of Python values to what the C structs hold."""

from __future__ import annotations

import ctypes
import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import argument_error

C_TYPES = {
    np.float32: ctypes.c_float,
    np.float64: ctypes.c_double,
    np.uint32: ctypes.c_uint32,
    np.uint64: ctypes.c_uint64,
}


def floats(value: ArrayLike, what: str) -> NDArray[np.float32]:
    """`value` as a C-contiguous float32 array, without a copy when it is one. `what` names it in errors."""
    try:
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(value, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise argument_error(f"{what} is not an array of numbers: {error}") from None


def rows(value: ArrayLike, columns: int, what: str, count: int | None = None) -> NDArray[np.float32]:
    """`value` as (n, columns) float32, n = `count` when given."""
    array = floats(value, what)
    if array.ndim != 2 or array.shape[1] != columns or (count is not None and array.shape[0] != count):
        raise argument_error(f"{what} has shape {array.shape}, expected ({'n' if count is None else count}, {columns})")
    return array


def image(value: ArrayLike, channels: int, what: str) -> NDArray[np.float32]:
    """`value` as (height, width, channels) float32."""
    array = floats(value, what)
    if array.ndim != 3 or array.shape[2] != channels:
        raise argument_error(f"{what} has shape {array.shape}, expected (height, width, {channels})")
    return array


def number(value: ArrayLike, what: str) -> float:
    """`value` as one number."""
    array = np.asarray(value)
    if array.ndim != 0 or not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise argument_error(f"{what} is {value!r}, expected a number")
    return float(array)


def whole(value: Any, what: str) -> int:
    """`value` as a 32-bit integer."""
    try:
        result = operator.index(value)
    except TypeError:
        raise argument_error(f"{what} is {value!r}, expected a whole number") from None
    if not -(2**31) <= result < 2**31:
        raise argument_error(f"{what} is {result}, which is out of range")
    return result


def triple(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """`value`, a number or three of them, as an RGB triple."""
    try:
        array = np.asarray(value, dtype=np.float64)
        return np.broadcast_to(array, (3,)).copy()
    except (TypeError, ValueError):
        raise argument_error(f"{what} is {value!r}, expected a number or three") from None


def integers(value: ArrayLike, kind: type, what: str) -> NDArray[Any]:
    """`value` as a C-contiguous array of the unsigned type `kind`; negative or too large values are errors."""
    array = np.asarray(value)
    if array.size == 0:
        return np.zeros(array.shape, kind)
    if not np.issubdtype(array.dtype, np.integer):
        raise argument_error(f"{what} has type {array.dtype}, expected integers")
    if array.dtype != kind:
        lowest, highest = int(array.min()), int(array.max())
        limit = int(np.iinfo(kind).max)
        if lowest < 0 or highest > limit:
            raise argument_error(f"{what} holds {lowest if lowest < 0 else highest}, expected 0 to {limit}")
    return np.ascontiguousarray(array, dtype=kind)


def matrix(value: ArrayLike | None, what: str) -> NDArray[np.float64]:
    """`value` as a (4, 4) float64 matrix acting on columns; None is the identity."""
    try:
        array = np.eye(4) if value is None else np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise argument_error(f"{what} is not a matrix of numbers: {error}") from None
    if array.shape != (4, 4):
        raise argument_error(f"{what} has shape {array.shape}, expected (4, 4)")
    if not np.isfinite(array).all():
        raise argument_error(f"{what} holds {array[~np.isfinite(array)][0]}, expected finite numbers")
    return array


def pointer(array: NDArray[Any]) -> Any:
    """A ctypes pointer to the array's memory, which must outlive its use."""
    return array.ctypes.data_as(ctypes.POINTER(C_TYPES[array.dtype.type]))


def point(struct: ctypes.Structure, field: str, array: NDArray[Any]) -> None:
    """Sets a pointer field of `struct`. ctypes would let go of the array, so the struct keeps it as an attribute."""
    setattr(struct, field, pointer(array))
    vars(struct)[f"{field}_array"] = array
