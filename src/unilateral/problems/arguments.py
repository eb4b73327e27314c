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

from unilateral.arrays import Array, floats
from unilateral.errors import InputError, shown
from unilateral.geometry.polygon import Polygon

PAIRS = "it has to be a list of pairs (x, y), anticlockwise, such as [(0, 0), (1, 0), (0, 1)]"


def vertices(polygon: object, where: str) -> Array:
    """(n, 2) the vertices of a polygon, or those that are given."""
    if isinstance(polygon, Polygon):
        return polygon.vertices
    found = floats(polygon, where, PAIRS)
    if found.ndim != 2 or found.shape[1] != 2:
        turned = "; transpose it" if found.ndim == 2 and len(found) == 2 else ""
        what = f"has the shape {found.shape}" if found.ndim else f"is {shown(repr(polygon))}"
        raise InputError(f"{where}: it {what}; {PAIRS}{turned}")
    if len(found) < 3:
        raise InputError(f"{where}: it has {len(found)} vertices; a polygon has at least three")
    wrong = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if wrong.size:
        raise InputError(f"{where}[{wrong[0]}]: it is {tuple(found[wrong[0]].tolist())}; it has to be finite")
    return found


def number(given: Any, where: str) -> Any:
    """A number of any library as one of a file, exactly; anything else as it is. It may not be masked."""
    if isinstance(given, Fraction | Decimal):
        return str(given)
    if not callable(given) and hasattr(given, "__array__"):
        array = np.asarray(given)
        if array.ndim == 0 and array.dtype.kind in "iuf":
            floats(given, where)
            given = array.item()
    if isinstance(given, complex) or (isinstance(given, float) and not math.isfinite(given)):
        raise InputError(f"{where}: it is {given}; it has to be a finite number, or a formula")
    if hasattr(given, "free_symbols"):
        raise InputError(f"{where}: it is {shown(repr(given))}; write it as a text, as str({given}) does")
    return given


def sides(given: object, n: int, where: str) -> list[int]:
    """The numbers of some of n sides; None is none."""
    try:
        if not isinstance(given, Iterable | None) or isinstance(given, str):
            raise TypeError
        found = [side(each, n, where) for each in ([] if given is None else given)]
    except TypeError:
        raise InputError(
            f"{where}: it is {shown(repr(given))}; it has to be a list of sides, such as [0, 2]"
        ) from None
    twice = [each for each, times in Counter(found).items() if times > 1]
    if twice:
        raise InputError(f"{where}: side {twice[0]} is given twice; give it once")
    return found


def side(given: Any, n: int, where: str) -> int:
    """The number of one of n sides."""
    found = -1
    kind = "; a side is a whole number"
    with suppress(TypeError):
        found, kind = (found, kind) if isinstance(given, bool) else (operator.index(given), "")
    if not 0 <= found < n:
        raise InputError(f"{where}: the polygon has the sides 0 to {n - 1}, not {shown(repr(given))}{kind}")
    return found


def check_flags(**flags: object) -> None:
    """Raises InputError, with its name, for a flag that is neither True nor False."""
    for name, given in flags.items():
        if not isinstance(given, bool | np.bool_):
            raise InputError(f"{name} is {shown(repr(given))}; it has to be True or False")
