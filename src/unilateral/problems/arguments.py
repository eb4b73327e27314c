"""What Python users give in place of the fields of a problem file, as these fields; refused if it is none."""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np

from unilateral.arrays import Array, read_floats
from unilateral.errors import InputError, quote_input
from unilateral.geometry.polygon import Polygon

PAIRS_NEEDED = "it has to be a list of pairs (x, y), anticlockwise, such as [(0, 0), (1, 0), (0, 1)]"


def as_vertices(polygon: object, where: str) -> Array:
    """The vertices of a polygon, or those that a user gives, (n, 2).

    The shape is (n, 2).
    """
    if isinstance(polygon, Polygon):
        return polygon.vertices
    found = read_floats(polygon, where, PAIRS_NEEDED)
    if found.ndim != 2 or found.shape[1] != 2:
        turned = "; transpose it" if found.ndim == 2 and len(found) == 2 else ""
        what = f"has the shape {found.shape}" if found.ndim else f"is {quote_input(repr(polygon))}"
        raise InputError(f"{where}: it {what}; {PAIRS_NEEDED}{turned}")
    if len(found) < 3:
        raise InputError(f"{where}: it has {len(found)} vertices; a polygon has at least three")
    wrong = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if wrong.size:
        raise InputError(f"{where}[{wrong[0]}]: it is {tuple(found[wrong[0]].tolist())}; it has to be finite")
    return found


def as_file_number(value: Any, where: str) -> Any:
    """A number of any library as one of a file, exactly; anything else as it is. It may not be masked."""
    if isinstance(value, Fraction | Decimal):
        return str(value)
    if not callable(value) and hasattr(value, "__array__"):
        array = np.asarray(value)
        if array.ndim == 0 and array.dtype.kind in "iuf":
            read_floats(value, where)
            value = array.item()
    if isinstance(value, complex) or (isinstance(value, float) and not math.isfinite(value)):
        raise InputError(f"{where}: it is {value}; it has to be a finite number, or a formula")
    if hasattr(value, "free_symbols"):
        raise InputError(
            f"{where}: it is {quote_input(repr(value))}; write it as a text, as str({value}) does"
        )
    return value


def as_side_numbers(values: object, n: int, where: str) -> list[int]:
    """The numbers of some of n sides; None is none."""
    try:
        if not isinstance(values, Iterable | None) or isinstance(values, str):
            raise TypeError
        found = [as_side_number(each, n, where) for each in ([] if values is None else values)]
    except TypeError:
        raise InputError(
            f"{where}: it is {quote_input(repr(values))}; it has to be a list of sides, such as [0, 2]"
        ) from None
    twice = [each for each, times in Counter(found).items() if times > 1]
    if twice:
        raise InputError(f"{where}: side {twice[0]} is given twice; give it once")
    return found


def as_side_number(value: Any, n: int, where: str) -> int:
    """The number of one of n sides."""
    found = -1
    kind = "; a side is a whole number"
    with suppress(TypeError):
        found, kind = (found, kind) if isinstance(value, bool) else (operator.index(value), "")
    if not 0 <= found < n:
        raise InputError(
            f"{where}: the polygon has the sides 0 to {n - 1}, not {quote_input(repr(value))}{kind}"
        )
    return found


def check_flags(**flags: object) -> None:
    """Raises InputError, with its name, for a flag that is neither True nor False."""
    for name, given in flags.items():
        if not isinstance(given, bool | np.bool_):
            raise InputError(f"{name} is {quote_input(repr(given))}; it has to be True or False")
