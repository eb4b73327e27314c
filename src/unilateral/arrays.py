"""Types of arrays, whose shapes docstrings give; checks of arrays that users give; blocks of long arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unilateral.errors import InputError, shown

Array = NDArray[np.float64]
Index = NDArray[np.signedinteger[Any]]
Int32 = NDArray[np.int32]
Int16 = NDArray[np.int16]
Mask = NDArray[np.bool_]

BLOCK = 1 << 13
"""Long arrays are worked on this many rows at a time, whose numbers fit into a processor's cache."""
PLAIN_ARRAYS = (np.ndarray, np.memmap, np.ma.MaskedArray)
"""Classes whose numbers are what they stand for. Those of others, such as lengths with units, may not be."""
LARGEST_INDEX = 2**53
"""Integers up to this one are exact in double precision."""
LARGEST_VALUE = 1e100
"""Values that are given at nodes or on cells are below this, so that squares of errors do not overflow."""
NUMBERS = "it has to be an array of real numbers"
"""What is wanted of an array, as messages say it."""


def read_only(array: Array) -> Array:
    """The array, which cannot be written into any more."""
    array.setflags(write=False)
    return array


def blocks(count: int, size: int = 0) -> Iterator[slice]:
    """Slices of so many rows, by default BLOCK at a time."""
    for begin in range(0, count, size or BLOCK):
        yield slice(begin, min(begin + (size or BLOCK), count))


def floats(given: object, where: str, wanted: str = NUMBERS) -> Array:
    """Copy in double precision of the numbers that a user gives: an array of any library, a list, a number.

    Every array from outside passes here, because NumPy would read some of them as other numbers without a
    word. Raises InputError, which begins with `where`, for masked numbers, for a series or table whose labels
    are not 0, 1, 2, … in order, and for subclasses such as np.matrix; and, with what is `wanted` at its end,
    for all that holds no real numbers: complex ones, Booleans, texts, times, objects.
    """
    with np.errstate(over="ignore"):  # of numbers with more bits: infinite, which is for the caller to judge
        return _real(given, where, wanted).astype(np.float64)


def nodal_values(given: object, where: str, wanted: str = NUMBERS) -> Array:
    """Copy of what a user gives as values of a function, as by `floats`. Arrays of integers are refused.

    Into such an array NumPy writes 0.5 as 0, and nothing of that can be seen afterwards. One number is taken.
    """
    array = _real(given, where, wanted)
    if array.dtype.kind in "iu" and array.ndim:
        raise InputError(
            f"{where}: the values are integers ({array.dtype}), and NumPy cuts 0.5 to 0 when it is written "
            "into an array of integers; give floating-point numbers, as np.full(n, 0.0) and "
            "np.vectorize(function, otypes=[float]) do"
        )
    return floats(given, where, wanted)


def indices(given: object, where: str, wanted: str = "they have to be whole numbers") -> Index:
    """Copy of the numbers of nodes that a user gives, as by `floats`; they must be whole."""
    numbers = floats(given, where, wanted)
    if not np.all((np.abs(numbers) <= LARGEST_INDEX) & (numbers == np.round(numbers))):
        raise InputError(f"{where}: {wanted}")
    return numbers.astype(np.intp)


def _real(given: Any, where: str, wanted: str) -> NDArray[Any]:
    """The array of the real numbers that are given. Raises InputError as `floats`."""
    _check_mask_and_labels(given, where)
    try:
        array = np.asanyarray(given)  # keeps the mask that an __array__ method may return
        _check_mask_and_labels(array, where)
        if array.dtype == object and not hasattr(given, "__array__"):
            array = _exact_numbers(array)  # such as fractions
    except InputError:
        raise
    except Exception:  # whatever another library's __array__ may raise
        raise _no_numbers(given, where, wanted) from None
    if type(array) not in PLAIN_ARRAYS:
        raise InputError(
            f"{where}: a {type(array).__name__} may stand for other numbers than it holds; give a plain "
            "array of NumPy, such as np.asarray(values)"
        )
    if array.dtype.kind not in "iuf":
        raise _no_numbers(given, where, wanted)
    return np.asarray(array)


def _no_numbers(given: Any, where: str, wanted: str) -> InputError:
    what = (
        f"it holds values of the type {given.dtype}"
        if hasattr(given, "dtype")
        else f"it is {shown(repr(given))}"
    )
    return InputError(f"{where}: {what}; {wanted}")


def _exact_numbers(array: NDArray[Any]) -> Array:
    """Numbers of Python that NumPy has no type for. Raises TypeError for all that is no real number."""
    for each in array.ravel():
        if isinstance(each, str | bytes | bool | complex) or not hasattr(type(each), "__float__"):
            raise TypeError
    return array.astype(np.float64)


def _check_mask_and_labels(given: Any, where: str) -> None:
    """Raises InputError if numbers are masked, or labels in another order; within lists, too."""
    if isinstance(given, list | tuple):
        for each in given:
            _check_mask_and_labels(each, where)
        return
    if isinstance(given, np.ma.MaskedArray):
        masked = np.flatnonzero(np.ma.getmaskarray(given))
        if masked.size:
            raise InputError(
                f"{where}: {masked.size} of {given.size} numbers are masked, the first at the place "
                f"{masked[0]}; give an array without masked numbers, such as array.filled(0.0) if these are 0"
            )
    for labels in _labels(given):
        if labels not in ([*range(len(labels))], [*"xyz"][: len(labels)]):
            raise InputError(
                f"{where}: the labels of the {type(given).__name__} begin with "
                f"{shown(', '.join(map(str, labels[:4])))}; they have to be 0, 1, 2, … in order, or give "
                "its .to_numpy() if its rows are in the right order"
            )


def _labels(given: Any) -> Iterator[list[Any]]:
    """The labels along each axis of what pandas or xarray made."""
    if hasattr(given, "index") and hasattr(given, "iloc"):  # pandas
        yield from (axis.tolist() for axis in given.axes)
    elif hasattr(given, "coords") and hasattr(given, "dims"):  # xarray
        yield from (given.coords[name].values.tolist() for name in given.dims if name in given.coords)
