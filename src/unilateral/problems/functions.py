"""Functions of the user, called at points, and what is wrong with what they return."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from unilateral.arrays import Array, read_nodal_values
from unilateral.errors import InputError

Function = Callable[[Array, Array], Array]
"""A function that takes arrays x, y of one shape, and returns that shape or one number."""
RETURN_NEEDED = "it has to return a real number for each point"


def check_arguments(function: Function, where: str) -> None:
    """Raises InputError for a function that cannot be called with x and y."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # of functions that are not written in Python
        return
    try:
        signature.bind(0.0, 0.0)
    except TypeError:
        raise InputError(
            f"{where}: the function takes the arguments {signature}; it has to take two, x and y, such as "
            "lambda x, y: x - y; of a function u of points write lambda x, y: u((x, y))"
        ) from None


def evaluate_function(function: Function, points: Array, where: str) -> Array:
    """The values of a user's function at points, (n,); InputError where it fails or is no finite number."""
    x = np.array(points[..., 0])
    y = np.array(points[..., 1])  # which a function may overwrite
    try:
        with np.errstate(all="ignore"):
            returned = function(x, y)
    except InputError:
        raise
    except Exception as error:  # whatever a function of one's own may raise
        raise InputError(f"{where}: {_explain_failure(function, points.reshape(-1, 2)[0], error)}") from error
    numbers = _as_values_at_points(returned, points.shape[:-1], where)
    if not np.isfinite(numbers).all():
        index = np.unravel_index(np.argmin(np.isfinite(numbers)), numbers.shape)
        x, y = points[index]
        raise InputError(f"{where}: the function is {numbers[index]} at ({x:.6g}, {y:.6g})")
    return numbers


def _explain_failure(function: Function, point: Array, error: Exception) -> str:
    """Why a function does not take arrays, and what to write; it may take one point at a time."""
    try:
        with np.errstate(all="ignore"):
            float(function(*point.tolist()))
    except Exception:  # as before
        return (
            f"the function failed ({type(error).__name__}: {error}); it has to take two arrays x and y and "
            "return numbers of their shape, such as lambda x, y: np.where(x > 1/2, 1.0, 0.0)"
        )
    return (
        f"the function takes one point at a time, and no arrays ({type(error).__name__}: {error}); write it "
        "with NumPy's functions, such as np.sin and np.where, or give np.vectorize(function, otypes=[float])"
    )


def _as_values_at_points(values: object, shape: tuple[int, ...], where: str) -> Array:
    """The numbers that a function returned, in the shape of the points; one number is that of all points."""
    numbers = read_nodal_values(values, f"{where}, value of the function", RETURN_NEEDED)
    if numbers.size != 1 and numbers.shape != shape:
        raise InputError(
            f"{where}: the function returns an array of the shape {numbers.shape} for x and y of the shape "
            f"{shape}; {RETURN_NEEDED}"
        )
    return np.full(shape, numbers.item()) if numbers.size == 1 else numbers.copy()
