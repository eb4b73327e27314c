"""Guaranteed ranges of formulas by interval arithmetic, sharpened by subdivision.

Every operation's interval is widened by some units in the last place, so that rounding loses nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import numpy as np
import sympy
from numpy.typing import NDArray

from unilateral.expression import compile_numpy, pos, positive_power

Array = NDArray[np.float64]
Interval = tuple[Array, Array]
Boxes = NDArray[np.float64]
Part = Callable[[Boxes], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
ULPS = 8
SHARP = 1e-3
"""A bound that misses a value of the function by less than this share of the range is sharp enough."""
SAME = 1e-9
"""So is one that misses it by less than this share of the value."""
MOST_BOXES = 20_000
MOST_LEVELS = 40


def lower_bound(
    formula: sympy.Expr, symbols: tuple[sympy.Symbol, ...], box: Array, part: Part | None = None
) -> float:
    """A lower bound of the formula on the box (d, 2) of its variables' limits; -inf where none is found.

    Or on a part of the box: which of the boxes (k, d, 2) meet it, and which have their centre in it. Boxes
    whose own bound is low are halved every way until the bound is SHARP or there are more than MOST_BOXES.
    """
    evaluate = compile_numpy([formula], symbols)
    boxes, left_out, spread = np.asarray(box, dtype=float)[None], np.inf, np.inf
    lower = np.array([-np.inf])
    for _ in range(MOST_LEVELS):
        if part is not None:
            meets, inside = part(boxes)
            boxes, inside = boxes[meets], inside[meets]
        if len(boxes) == 0:
            return left_out
        lower, upper = enclose(formula, dict(zip(symbols, np.moveaxis(boxes, 1, 0), strict=True)))
        with np.errstate(all="ignore"):
            values = evaluate(*boxes.mean(axis=2).T)[0]
        reached = float(np.fmin.reduce(values if part is None else values[inside], initial=np.inf))
        spread = spread if np.isfinite(spread) else float(upper.max() - lower.min())
        goal = reached
        if np.isfinite(reached):
            goal -= (SHARP * spread if np.isfinite(spread) else 0.0) + SAME * abs(reached)
        low = ~(lower >= goal)
        left_out = min(left_out, float(np.min(lower[~low], initial=np.inf)))
        boxes, lower = _halved(boxes[low]), lower[low]
        if len(lower) == 0 or len(boxes) > MOST_BOXES:
            break
    return min(left_out, float(np.min(lower, initial=np.inf)))


def enclose(formula: sympy.Expr, limits: dict[sympy.Symbol, Array]) -> Interval:
    """Lower and upper bounds (k,) of a formula of the grammar on k boxes, each variable's limits (k, 2)."""
    size = len(next(iter(limits.values())))
    with np.errstate(all="ignore"):
        lower, upper = _enclose(formula, limits)
    return np.broadcast_to(lower, size), np.broadcast_to(upper, size)


def _enclose(e: sympy.Expr, limits: dict[sympy.Symbol, Array]) -> Interval:
    if e in limits:
        return limits[e][:, 0], limits[e][:, 1]
    if e.is_number:
        value = np.array([float(e)])
        return _outward(value, value)
    if e.func is pos:
        lower, upper = _enclose(e.args[0], limits)
        k = float(e.args[1])
        return _outward(positive_power(lower, k), positive_power(upper, k))
    parts = [_enclose(arg, limits) for arg in e.args]
    if e.is_Add:
        return reduce(lambda a, b: _outward(a[0] + b[0], a[1] + b[1]), parts)
    if e.is_Mul:
        return reduce(_product, parts)
    if e.is_Pow and e.exp.is_Integer:
        return _power(parts[0], int(e.exp))
    if e.func in MONOTONE:
        return _outward(*map(MONOTONE[e.func], parts[0]))
    return OTHERS[e.func](*parts[0])


def _outward(lower: Array, upper: Array) -> Interval:
    lower, upper = lower - ULPS * np.spacing(np.abs(lower)), upper + ULPS * np.spacing(np.abs(upper))
    return np.where(np.isnan(lower), -np.inf, lower), np.where(np.isnan(upper), np.inf, upper)


def _product(a: Interval, b: Interval) -> Interval:
    found = [x * y for x in a for y in b]
    return _outward(reduce(np.minimum, found), reduce(np.maximum, found))


def _power(base: Interval, n: int) -> Interval:
    lower, upper = base
    inside = (lower <= 0) & (upper >= 0)
    ends = lower ** abs(n), upper ** abs(n)
    low, high = np.minimum(*ends), np.maximum(*ends)
    if n % 2 == 0:
        low = np.where(inside, 0.0, low)
    low, high = _outward(low, high)
    if n > 0:
        return low, high
    low, high = _outward(1 / high, 1 / low)
    return np.where(inside, -np.inf, low), np.where(inside, np.inf, high)


def _sin(lower: Array, upper: Array) -> Interval:
    return _cos(*_outward(lower - np.pi / 2, upper - np.pi / 2))


def _cos(lower: Array, upper: Array) -> Interval:
    """Its extrema are at the multiples of pi; a tiny widening decides for an extremum in doubt."""
    low, high = np.minimum(np.cos(lower), np.cos(upper)), np.maximum(np.cos(lower), np.cos(upper))
    slack = 1e-12 * (1 + np.abs(lower) + np.abs(upper))

    def holds(phase: float) -> NDArray[np.bool_]:
        first = np.ceil((lower - slack - phase) / (2 * np.pi))
        return ~(first * 2 * np.pi + phase > upper + slack)

    low, high = _outward(low, high)
    return np.where(holds(np.pi), -1.0, low - slack), np.where(holds(0.0), 1.0, high + slack)


def _cosh(lower: Array, upper: Array) -> Interval:
    inside = (lower <= 0) & (upper >= 0)
    low, high = np.minimum(np.cosh(lower), np.cosh(upper)), np.maximum(np.cosh(lower), np.cosh(upper))
    return _outward(np.where(inside, 1.0, low), high)


def _halved(boxes: Boxes) -> Boxes:
    """The 2^d equal parts of each box."""
    for axis in range(boxes.shape[1]):
        middle = boxes[:, axis].mean(axis=1)
        left, right = boxes.copy(), boxes.copy()
        left[:, axis, 1], right[:, axis, 0] = middle, middle
        boxes = np.concatenate([left, right])
    return boxes


MONOTONE = {sympy.exp: np.exp, sympy.sinh: np.sinh, sympy.tanh: np.tanh}
OTHERS = {sympy.sin: _sin, sympy.cos: _cos, sympy.cosh: _cosh}
