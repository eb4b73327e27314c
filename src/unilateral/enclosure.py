"""Guaranteed ranges of formulas by interval arithmetic, sharpened by subdivision.

Every operation's interval is widened by some units in the last place, so that rounding loses nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, reduce

import numpy as np
import sympy
from numpy.typing import NDArray

from unilateral.expression import compile_numpy, pos, positive_power

Array = NDArray[np.float64]
Interval = tuple[Array, Array]
Boxes = NDArray[np.float64]
Tolerance = Callable[[Array], Array]
Part = Callable[[Boxes], tuple[NDArray[np.bool_], NDArray[np.bool_]]]
ULPS = 8
SHARP = 1e-3
"""A bound that misses a value of the function by less than this share of the range is sharp enough."""
SAME = 1e-9
"""So is one that misses it by less than this share of the value."""
LARGE = 1e308
MOST_BOXES = 20_000
MOST_LEVELS = 40
MOST_PIECES = 16384
MOST_HALVINGS = 30


def least_value(
    formula: sympy.Expr, symbols: tuple[sympy.Symbol, ...], box: Array, part: Part | None = None
) -> tuple[float, float]:
    """Of the formula on the box (d, 2) of its variables' limits a lower bound and the least value met.

    The bound is -inf where none is found. Or on a part of the box: which of the boxes (k, d, 2) meet it, and
    which have their centre in it. Boxes whose own bound, by interval arithmetic or by the mean value theorem,
    is low are halved every way until the bound is SHARP or there are more than MOST_BOXES.
    """
    evaluate = compile_numpy([formula], symbols)
    boxes, left_out, seen = np.asarray(box, dtype=float)[None], np.inf, (np.inf, -np.inf)
    lower = np.array([-np.inf])
    for _ in range(MOST_LEVELS):
        if part is not None:
            meets, inside = part(boxes)
            boxes, inside = boxes[meets], inside[meets]
        if len(boxes) == 0:
            return left_out, seen[0]
        lower, _ = enclose(formula, dict(zip(symbols, np.moveaxis(boxes, 1, 0), strict=True)))
        with np.errstate(all="ignore"):
            values = evaluate(*boxes.mean(axis=2).T)[0]
        values = values if part is None else values[inside]
        seen = (
            float(np.fmin.reduce(values, initial=seen[0])),
            float(np.fmax.reduce(values, initial=seen[1])),
        )
        low = ~(lower >= _sharp_enough(*seen))
        lower = np.array(lower)
        lower[low] = np.fmax(lower[low], _by_mean_value(formula, symbols, boxes[low]))
        low = ~(lower >= _sharp_enough(*seen))
        left_out = min(left_out, float(np.min(lower[~low], initial=np.inf)))
        boxes, lower = _halved(boxes[low]), lower[low]
        if len(lower) == 0 or len(boxes) > MOST_BOXES:
            break
    return min(left_out, float(np.min(lower, initial=np.inf))), seen[0]


def _sharp_enough(lowest: float, largest: float) -> float:
    """What a bound has to be at least, by the values met."""
    if not np.isfinite(lowest):
        return lowest
    spread = largest - lowest if np.isfinite(largest) else 0.0
    return lowest - SHARP * spread - SAME * abs(lowest)


@cache
def _slopes(formula: sympy.Expr, symbols: tuple[sympy.Symbol, ...]) -> list[sympy.Expr]:
    """The derivatives of a formula without jumps, else none."""
    jumps = any(power.args[1] == 0 for power in formula.atoms(pos))
    return [] if jumps else [formula.diff(symbol) for symbol in symbols]


def _by_mean_value(formula: sympy.Expr, symbols: tuple[sympy.Symbol, ...], boxes: Boxes) -> Array:
    """Lower bounds (k,) from the centres' values and the slopes: sharper where terms cancel."""
    slopes = _slopes(formula, symbols) if len(boxes) else []
    if not slopes:
        return np.full(len(boxes), -np.inf)
    centres = np.repeat(boxes.mean(axis=2)[..., None], 2, axis=2)
    found, _ = enclose(formula, dict(zip(symbols, np.moveaxis(centres, 1, 0), strict=True)))
    limits = dict(zip(symbols, np.moveaxis(boxes, 1, 0), strict=True))
    half = 0.5 * (1 + SAME) * np.diff(boxes, axis=2)[..., 0].T
    with np.errstate(all="ignore"):
        for slope, arm in zip(slopes, half, strict=True):
            found = found - arm * np.maximum(*np.abs(enclose(slope, limits)))
    return found


def linear_pieces(
    formula: sympy.Expr, symbol: sympy.Symbol, ends: Array, tolerance: Tolerance, idle: float = -np.inf
) -> Array:
    """`ends` (k + 1,) with more points (m,) between which the formula is linear up to the tolerance.

    That is given for pieces of the lengths (k,). Guaranteed by enclosures: with d the length, a width w of
    the formula, d / 4 times that of its first derivative, or d^2 / 8 times the largest second derivative. It
    may have kinks at the `ends` only. Where it is below `idle` it need not be linear. Raises ValueError where
    MOST_PIECES do not suffice.
    """
    derivatives, steps = _derivatives(formula, symbol)
    found = [np.asarray(ends, dtype=float)]
    boxes = np.stack([found[0][:-1], found[0][1:]], axis=1)[:, None]
    for _ in range(MOST_HALVINGS):
        limits = {symbol: boxes[:, 0], **{step: np.tile([0.0, 1.0], (len(boxes), 1)) for step in steps}}
        value, slope, curvature = (enclose(e, limits) for e in (formula, *derivatives))
        d = np.diff(boxes[:, 0])[:, 0]
        with np.errstate(all="ignore"):
            bounds = [
                value[1] - value[0],
                d / 4 * (slope[1] - slope[0]),
                d**2 / 8 * np.maximum(*np.abs(curvature)),
            ]
            boxes = _halved(boxes[~((np.fmin.reduce(bounds) <= tolerance(d)) | (value[1] < idle))])
        found.append(boxes[: len(boxes) // 2, 0, 1])
        if len(boxes) == 0:
            return np.unique(np.concatenate(found))
        if sum(map(len, found)) > MOST_PIECES:
            break
    raise ValueError(f"it varies faster than {MOST_PIECES} pieces can resolve; give a smoother one")


def _derivatives(formula: sympy.Expr, symbol: sympy.Symbol) -> tuple[list[sympy.Expr], list[sympy.Symbol]]:
    """The first and the second one off the kinks; the symbols in them stand for the steps pos(a, 0)."""
    steps: dict[sympy.Expr, sympy.Symbol] = {}
    found = [formula]
    for _ in range(2):
        found.append(_frozen(found[-1], steps).diff(symbol))
    return [_frozen(e, steps) for e in found[1:]], list(steps.values())


def _frozen(e: sympy.Expr, steps: dict[sympy.Expr, sympy.Symbol]) -> sympy.Expr:
    steps |= {power: sympy.Dummy() for power in e.atoms(pos) - set(steps) if power.args[1] == 0}
    return e.xreplace(steps)


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
        return _positive_power(_enclose(e.args[0], limits), float(e.args[1]))
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
    """Wider by the rounding; what overflows is at least LARGE."""
    lower, upper = np.minimum(lower, LARGE), np.maximum(upper, -LARGE)
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
    positive = (lower > 0) | (n % 2 == 0)  # powers that underflow keep their sign
    low, high = (
        np.where(positive, np.maximum(low, 0.0), low),
        np.where(positive, high, np.minimum(high, -0.0)),
    )
    low, high = _outward(1 / high, 1 / low)
    return np.where(inside, -np.inf, low), np.where(inside, np.inf, high)


def _positive_power(base: Interval, k: float) -> Interval:
    """For k < 0 it falls where it is not 0."""
    low, high = (positive_power(end, k) for end in base)
    if k < 0:
        low, high = np.where(base[0] > 0, high, 0.0), np.where((base[0] > 0) | (base[1] <= 0), low, np.inf)
    return _outward(low, high)


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
