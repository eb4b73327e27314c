"""Types of arrays, whose shapes docstrings give; checks of arrays that users give; blocks of long arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unilateral.errors import InputError, quote_input

Array = NDArray[np.float64]
Index = NDArray[np.signedinteger[Any]]
Int32 = NDArray[np.int32]
Int16 = NDArray[np.int16]
Mask = NDArray[np.bool_]

ROWS_PER_BLOCK = 1 << 13
"""Long arrays are worked on this many rows at a time, whose numbers fit into a processor's cache."""
PLAIN_ARRAY_CLASSES = (np.ndarray, np.memmap, np.ma.MaskedArray)
"""Classes whose numbers are what they stand for. Those of others, such as lengths with units, may not be."""
MAX_EXACT_INTEGER = 2**53
"""Integers up to this one are exact in double precision."""
MAX_INPUT_VALUE = 1e100
"""Values that are given at nodes or on cells are below this, so that squares of errors do not overflow."""
ARRAY_REQUIREMENT = "it has to be an array of real numbers"
"""The requirement for arrays in messages."""


def make_read_only(array: Array) -> Array:
    """The array itself, which cannot be written into any more."""
    array.setflags(write=False)
    return array


def row_blocks(n_rows: int, rows_per_block: int = 0) -> Iterator[slice]:
    """Slices that together are all rows, each of so many, by default of ROWS_PER_BLOCK."""
    step = rows_per_block or ROWS_PER_BLOCK
    for begin in range(0, n_rows, step):
        yield slice(begin, min(begin + step, n_rows))


def as_slice(rows: Index) -> Index | slice:
    """The numbers of rows (k,) as a slice if each is the one before and 1, for these rows need no copy."""
    is_consecutive = len(rows) > 0 and rows[-1] - rows[0] == len(rows) - 1 and np.all(np.diff(rows) == 1)
    return slice(int(rows[0]), int(rows[-1]) + 1) if is_consecutive else rows


def read_floats(values: object, where: str, requirement: str = ARRAY_REQUIREMENT) -> Array:
    """Copy in double precision of the numbers that a user gives: an array of any library, a list, a number.

    Every array from outside passes here, because NumPy would read some of them as other numbers without a
    word. Raises InputError, which begins with `where`, for masked numbers, for a series or table whose labels
    are not 0, 1, 2, … in order, and for subclasses such as np.matrix; and, with what is `requirement` at its
    end, for all that holds no real numbers: complex ones, Booleans, texts, times, objects.
    """
    with np.errstate(over="ignore"):  # of numbers with more bits: infinite, which is for the caller to judge
        return _read_real_numbers(values, where, requirement).astype(np.float64)


def read_nodal_values(values: object, where: str, requirement: str = ARRAY_REQUIREMENT) -> Array:
    """Copy of what a user gives as values of a function, as by `read_floats`. Arrays of integers are refused.

    Into such an array NumPy writes 0.5 as 0, and nothing of that can be seen afterwards. One number is taken.
    """
    array = _read_real_numbers(values, where, requirement)
    if array.dtype.kind in "iu" and array.ndim:
        raise InputError(
            f"{where}: the values are integers ({array.dtype}), and NumPy cuts 0.5 to 0 when it is written "
            "into an array of integers; give floating-point numbers, as np.full(n, 0.0) and "
            "np.vectorize(function, otypes=[float]) do"
        )
    return read_floats(values, where, requirement)


def read_indices(values: object, where: str, requirement: str = "they have to be whole numbers") -> Index:
    """Copy of the numbers of nodes that a user gives, as by `read_floats`; they must be whole."""
    numbers = read_floats(values, where, requirement)
    if not np.all((np.abs(numbers) <= MAX_EXACT_INTEGER) & (numbers == np.round(numbers))):
        raise InputError(f"{where}: {requirement}")
    return numbers.astype(np.intp)


def _read_real_numbers(values: Any, where: str, requirement: str) -> NDArray[Any]:
    """The array of the real numbers that are given. Raises InputError as `read_floats`."""
    _check_mask_and_labels(values, where)
    try:
        array = np.asanyarray(values)  # keeps the mask that an __array__ method may return
        _check_mask_and_labels(array, where)
        if array.dtype == object and not hasattr(values, "__array__"):
            array = _convert_python_numbers(array)  # such as fractions
    except InputError:
        raise
    except Exception:  # whatever another library's __array__ may raise
        raise _not_numeric_error(values, where, requirement) from None
    if type(array) not in PLAIN_ARRAY_CLASSES:
        raise InputError(
            f"{where}: a {type(array).__name__} may stand for other numbers than it holds; give a plain "
            "array of NumPy, such as np.asarray(values)"
        )
    if array.dtype.kind not in "iuf":
        raise _not_numeric_error(values, where, requirement)
    return np.asarray(array)


def _not_numeric_error(values: Any, where: str, requirement: str) -> InputError:
    if hasattr(values, "dtype"):
        description = f"it holds values of the type {values.dtype}"
    else:
        description = f"it is {quote_input(repr(values))}"
    return InputError(f"{where}: {description}; {requirement}")


def _convert_python_numbers(array: NDArray[Any]) -> Array:
    """Numbers of Python that NumPy has no type for. Raises TypeError for all that is no real number."""
    for number in array.ravel():
        if isinstance(number, str | bytes | bool | complex) or not hasattr(type(number), "__float__"):
            raise TypeError
    return array.astype(np.float64)


def _check_mask_and_labels(values: Any, where: str) -> None:
    """Raises InputError if numbers are masked, or labels in another order; within lists, too."""
    if isinstance(values, list | tuple):
        for item in values:
            _check_mask_and_labels(item, where)
        return
    if isinstance(values, np.ma.MaskedArray):
        masked = np.flatnonzero(np.ma.getmaskarray(values))
        if masked.size:
            raise InputError(
                f"{where}: {masked.size} of {values.size} numbers are masked, the first at the place "
                f"{masked[0]}; give an array without masked numbers, such as array.filled(0.0) if these are 0"
            )
    for labels in _axis_labels(values):
        if labels not in ([*range(len(labels))], [*"xyz"][: len(labels)]):
            raise InputError(
                f"{where}: the labels of the {type(values).__name__} begin with "
                f"{quote_input(', '.join(map(str, labels[:4])))}; they have to be 0, 1, 2, … in order, or "
                "give its .to_numpy() if its rows are in the right order"
            )


def _axis_labels(values: Any) -> Iterator[list[Any]]:
    """The labels along each axis of what pandas or xarray made."""
    if hasattr(values, "index") and hasattr(values, "iloc"):  # pandas
        yield from (axis.tolist() for axis in values.axes)
    elif hasattr(values, "coords") and hasattr(values, "dims"):  # xarray
        yield from (values.coords[name].values.tolist() for name in values.dims if name in values.coords)
