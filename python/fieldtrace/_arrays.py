"""What users give, made into arrays that the library reads in place; what cannot be is a TypeError or a ValueError."""

from __future__ import annotations

import operator
import os
from typing import Any, Sequence, SupportsIndex, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

Path = Union[str, "os.PathLike[str]"]
Shape = tuple[int, ...]

NO_INSTANCE = 0xFFFFFFFF


def _described(dtype: np.dtype[Any], shape: Sequence[int]) -> str:
    return f"an array of {dtype} and shape {tuple(shape)}"


def _asarray(name: str, value: ArrayLike, expected: str) -> NDArray[Any]:
    try:
        return np.asarray(value)
    except ValueError as error:  # ragged lists
        raise ValueError(f"{name}: expected {expected}; {error}") from None


def _in_place(array: NDArray[Any]) -> NDArray[Any]:
    """The array, or a packed copy where the library cannot read it: `array` has 1 or 2 dimensions."""
    size = array.itemsize
    row = size if array.ndim == 1 else array.shape[1] * size
    fits = array.flags.aligned and (array.ndim == 1 or array.strides[1] == size or array.shape[1] == 1)
    if array.shape[0] > 1:
        fits = fits and array.strides[0] >= row and array.strides[0] % size == 0
    return array if fits else array.copy(order="C")


def _as_float32(name: str, value: ArrayLike, expected: str) -> NDArray[np.float32]:
    array = _asarray(name, value, expected)
    if array.size == 0 and array.ndim > 0 and array.dtype == np.float64:
        array = array.astype(np.float32)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: expected {expected}, got {_described(array.dtype, array.shape)}")
    if array.dtype != np.float32 or not array.dtype.isnative:
        with np.errstate(over="ignore"):  # the library names numbers that are not finite
            array = array.astype(np.float32)
    return array


def rows(name: str, value: ArrayLike, parts: int = 3) -> NDArray[np.float32]:
    """Float32 of shape (..., parts), uncopied where it was that."""
    expected = f"numbers of shape (..., {parts})"
    array = _as_float32(name, value, expected)
    if array.ndim < 1 or array.shape[-1] != parts:
        raise ValueError(f"{name}: expected {expected}, got {_described(array.dtype, array.shape)}")
    return array


def common_shape(**arrays: NDArray[Any]) -> Shape:
    """The shape, without the last axis, that rows broadcast to."""
    shapes = {name: array.shape[:-1] for name, array in arrays.items()}
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        given = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"shapes do not go together: {given}") from None


def flat_rows(array: NDArray[np.float32], shape: Shape) -> NDArray[np.float32]:
    """Rows of an array of rows() as (n, parts), broadcast to `shape`."""
    parts = array.shape[-1]
    if array.shape[:-1] != shape:
        array = np.broadcast_to(array, (*shape, parts))
    return _in_place(array.reshape(-1, parts))


def flat_floats(name: str, value: Union[ArrayLike, None], shape: Shape) -> Union[NDArray[np.float32], None]:
    """Float32 of shape (n,), broadcast to `shape`. None stays None."""
    if value is None:
        return None
    expected = f"None, a number, or numbers of shape {shape}"
    return _flat(name, _as_float32(name, value, expected), shape, expected)


def flat_instances(name: str, value: Union[ArrayLike, None], shape: Shape) -> Union[NDArray[np.uint32], None]:
    """Uint32 of shape (n,), broadcast to `shape`. None stays None."""
    if value is None:
        return None
    expected = f"None, an integer, or integers of shape {shape}"
    return _flat(name, uint32(name, _asarray(name, value, expected), expected), shape, expected)


def _flat(name: str, array: NDArray[Any], shape: Shape, expected: str) -> NDArray[Any]:
    if array.shape != shape:
        try:
            array = np.broadcast_to(array, shape)
        except ValueError:
            raise ValueError(f"{name}: expected {expected}, got {_described(array.dtype, array.shape)}") from None
    return _in_place(array.reshape(-1))


def uint32(name: str, array: NDArray[Any], expected: str) -> NDArray[np.uint32]:
    if array.size == 0 and array.dtype == np.float64:  # an empty list
        return array.astype(np.uint32)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name}: expected {expected}, got {_described(array.dtype, array.shape)}")
    if array.dtype == np.uint32 and array.dtype.isnative:
        return array
    if array.size and (array.min() < 0 or array.max() > NO_INSTANCE):
        raise ValueError(f"{name}: expected {expected} within [0, {NO_INSTANCE}]")
    return array.astype(np.uint32)


def triangles(value: ArrayLike) -> NDArray[np.uint32]:
    expected = "integers of shape (n, 3)"
    array = uint32("triangles", _asarray("triangles", value, expected), expected)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"triangles: expected {expected}, got {_described(array.dtype, array.shape)}")
    return _in_place(array)


def positions(value: ArrayLike) -> NDArray[np.float32]:
    array = rows("positions", value)
    if array.ndim != 2:
        raise ValueError(f"positions: expected numbers of shape (n, 3), got {_described(array.dtype, array.shape)}")
    return _in_place(array)


def triple(name: str, value: ArrayLike) -> list[float]:
    """Three numbers; one for RGB stands for all."""
    array = _as_float32(name, value, "3 numbers")
    if array.shape != (3,):
        raise ValueError(f"{name}: expected 3 numbers, got {_described(array.dtype, array.shape)}")
    return [float(x) for x in array]


def rgb(name: str, value: ArrayLike) -> list[float]:
    array = _as_float32(name, value, "a number, or 3 for red, green and blue")
    if array.shape not in ((), (3,)):
        raise ValueError(f"{name}: expected a number, or 3 for red, green and blue, got shape {array.shape}")
    return [float(x) for x in np.broadcast_to(array, (3,))]


def transform(value: ArrayLike) -> list[float]:
    """The columns x, y, z and translation of a matrix (3, 4), or (4, 4) whose last row is 0 0 0 1."""
    matrix = _as_float32("transform", value, "numbers of shape (3, 4) or (4, 4)")
    if matrix.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"transform: expected numbers of shape (3, 4) or (4, 4), got shape {matrix.shape}")
    if matrix.shape == (4, 4) and not np.array_equal(matrix[3], (0, 0, 0, 1)):
        raise ValueError("transform: the last row of an affine matrix is 0 0 0 1")
    return [float(x) for x in matrix[:3].T.reshape(-1)]


def number(name: str, value: SupportsIndex) -> int:
    """An integer of 32 bits without sign."""
    try:
        integer = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None
    if not 0 <= integer <= 0xFFFFFFFF:
        raise ValueError(f"{name}: expected an integer within [0, {0xFFFFFFFF}], got {integer}")
    return integer


def path(value: Path) -> bytes:
    encoded = os.fsencode(value)
    if b"\0" in encoded:
        raise ValueError("path: embedded null byte")
    return encoded
