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
from unilateral.errors import InputError, quote_input, suggest_name
from unilateral.geometry.polygon import Polygon

PAIRS_NEEDED = "it has to be a list of pairs (x, y), anticlockwise, such as [(0, 0), (1, 0), (0, 1)]"


def as_vertices(polygon: object, where: str) -> Array:
    """The vertices of a polygon, or those that a user gives, (n, 2)."""
    if isinstance(polygon, Polygon):
        return polygon.vertices
    vertices = read_floats(polygon, where, PAIRS_NEEDED)
    if vertices.ndim != 2 or vertices.shape[1] != 2:
        turned = "; transpose it" if vertices.ndim == 2 and len(vertices) == 2 else ""
        fault = f"has the shape {vertices.shape}" if vertices.ndim else f"is {quote_input(repr(polygon))}"
        raise InputError(f"{where}: it {fault}; {PAIRS_NEEDED}{turned}")
    if len(vertices) < 3:
        raise InputError(f"{where}: it has {len(vertices)} vertices; a polygon has at least three")
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{where}[{wrong[0]}]: it is {tuple(vertices[wrong[0]].tolist())}; it has to be finite"
        )
    return vertices


def as_file_number(value: Any, where: str) -> Any:
    """A number of any library as one of a file, exactly; anything else as it is. It may not be masked."""
    if isinstance(value, Fraction | Decimal):
        return str(value)
    if not callable(value) and hasattr(value, "__array__"):
        array = np.asarray(value)
        if array.ndim == 0 and array.dtype.kind in "iuf":
            read_floats(value, where)  # called for its error
            value = array.item()
    if isinstance(value, complex) or (isinstance(value, float) and not math.isfinite(value)):
        raise InputError(f"{where}: it is {value}; it has to be a finite number, or a formula")
    if hasattr(value, "free_symbols"):
        raise InputError(
            f"{where}: it is {quote_input(repr(value))}; write it as a text, as str({value}) does"
        )
    return value


def as_side_numbers(values: object, polygon: Polygon, where: str) -> list[int]:
    """The numbers of some sides of a polygon, which are given by numbers or names; None is none."""
    try:
        if not isinstance(values, Iterable | None) or isinstance(values, str):
            raise TypeError
        sides = [*expand_sides([(side, None) for side in ([] if values is None else values)], polygon, where)]
    except TypeError:
        raise InputError(
            f"{where}: it is {quote_input(repr(values))}; it has to be a list of sides, such as [0, 2]"
        ) from None
    return sides


def expand_sides(entries: Iterable[tuple[object, Any]], polygon: Polygon, where: str) -> dict[int, Any]:
    """The entries by the numbers of sides, from pairs of a number, or a name of several sides, and an entry.

    Raises InputError for a side that does not exist or is given twice.
    """
    pairs = []
    for key, entry in entries:
        named = polygon.side_names.get(key) if isinstance(key, str) else None
        pairs += [(side, entry) for side in named or [as_side_number(key, polygon, where)]]
    check_distinct_sides([side for side, _ in pairs], where)
    return dict(pairs)


def check_distinct_sides(sides: Iterable[object], where: str) -> None:
    """Raises InputError for a side that is given twice."""
    twice = [side for side, times in Counter(sides).items() if times > 1]
    if twice:
        raise InputError(f"{where}: side {twice[0]} is given twice; give it once")


def as_side_number(value: Any, polygon: Polygon, where: str) -> int:
    """The number of a side of a polygon, which is given by its number or by a name of one side.

    Raises InputError for a value that is neither; True and False are no numbers.
    """
    n = polygon.n_sides
    names = polygon.side_names
    if isinstance(value, str) and len(names.get(value, ())) == 1:
        value = names[value][0]
    side = -1
    hint = "; a side is a whole number, or a name of side_names"
    with suppress(TypeError):
        if not isinstance(value, bool):  # which Python takes for 0 or 1
            side = operator.index(value)
            hint = ""
    if not 0 <= side < n:
        known = f"0 to {n - 1}" + f" and the names {', '.join(names)}" * bool(names)
        near = suggest_name(value, names) if isinstance(value, str) else ""
        raise InputError(
            f"{where}: the polygon has the sides {known}, not {quote_input(repr(value))}{near or hint}"
        )
    return side


def check_flags(**flags: object) -> None:
    """Raises InputError, with its name, for a flag that is neither True nor False."""
    for name, value in flags.items():
        if not isinstance(value, bool | np.bool_):
            raise InputError(f"{name} is {quote_input(repr(value))}; it has to be True or False")
