"""Refuses f, g, u and q that are not finite or too large or small, and those that do not fit at a vertex."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from unilateral.errors import InputError
from unilateral.formulas.expression import Expression
from unilateral.problems.formula_range import POINTS, may_be_0, some_points
from unilateral.problems.nodal import NodalTraces
from unilateral.problems.piecewise import PLACES
from unilateral.problems.problem import Problem
from unilateral.problems.sampled import Sampled

SMALLEST, LARGEST = 1e-140, 1e140
"""The limits of |f|, |g| and |q|, so that squares of data are normal numbers.

For the squares of errors see `flux_residuals.underflow`.
"""
POWER = 2
"""Data are multiplied by this power of the root of the area in units of (k/c)^{1/2}, if that is above 1."""
KEPT = 2.0**-26
"""Functions keep half of the digits: at a vertex they may differ by this part of the larger number there."""
STEP, STEPS = 1e-8, 8
"""Noise of a function near a vertex is seen at so many steps of this part of a side, beside rounded numbers.

It is no power of 2, for at steps that are multiples of what a function is rounded to no noise is seen.
"""


def check(problem: Problem, name: str) -> None:
    """Raises InputError unless f, g, u and q are finite and fit together at each vertex, see `_check_vertex`.

    A g that jumps at a vertex is the trace of no u in H^1. The sizes of f, g and q are looked at in the units
    in which the problem is solved.
    """
    units, obstacle = problem.units, problem.enclosed_obstacle
    of_f, unit = max(map(abs, problem.range_of_f)), math.sqrt(problem.polygon.area) / units.length
    _check_size(of_f, units.load, unit, f"{name}, field f", "in the polygon", lambda: _no_load(problem))
    held = [side for side in range(problem.polygon.n_sides) if side not in problem.free_sides]
    sizes = {side: max(map(abs, obstacle.range(side))) for side in held}
    largest = max(sizes.values(), default=0.0)
    for side, size in sizes.items():
        where, place = _field(problem, name, side), f"on side {side}"
        is_0 = partial(_may_be_0_on, problem, side, problem.g, problem.nodal.g)
        _check_size(size, units.value, unit, where, place, is_0 if size == largest else _always)
    for side in problem.flux_sides:
        of_q = max(map(abs, problem.enclosed_flux.range(side)))
        is_0 = partial(_may_be_0_on, problem, side, problem.q, problem.nodal.q)
        _check_size(of_q, units.flux, unit, f"{name}, field q", f"on side {side}", is_0)
    for vertex in _between(problem):
        allowed = obstacle.rounded_jumps[vertex] + obstacle.end_doubts[:, vertex].sum()
        end, start = obstacle.ends[:, vertex].tolist()
        _check_vertex(problem, name, vertex, end, start, allowed)


def check_vertices(of: Sampled) -> None:
    """Raises InputError where g or u jumps at a vertex, or u < g: then no u in H^1 has that trace."""
    n = of.polygon.n_sides
    for vertex in _between(of):
        start, doubt_of_start = _end(of, vertex, 0.0)
        end, doubt_of_end = _end(of, (vertex - 1) % n, 1.0)
        allowed = KEPT * max(abs(end), abs(start)) + doubt_of_end + doubt_of_start
        _check_vertex(of, of.name, vertex, end, start, allowed)


def _end(of: Sampled, side: int, end: float) -> tuple[float, float]:
    """g or u at the end t = 0 or 1 of a side, and how well it is known there.

    Second differences next to the vertex show the noise of the function, because all else in them is as small
    as the square of a step. To the noise comes the slope there, times the rounding of places.
    """
    polygon, steps = of.polygon, STEP * np.arange(STEPS + 1)
    length = polygon.lengths[side]
    s = length * np.abs(end - steps)
    s[0] = end * length
    near = of.obstacle(np.full(len(s), side), s)
    slope = np.abs(np.diff(near)).max() / (STEP * length)
    doubt = np.abs(np.diff(near, 2)).max() + slope * PLACES * np.spacing(polygon.perimeter)
    return float(near[0]), float(doubt)


def _between(of: Problem | Sampled) -> list[int]:
    """The vertices between two sides that are not free."""
    n, free = of.polygon.n_sides, {*of.free_sides}
    return [vertex for vertex in range(n) if not {vertex, (vertex - 1) % n} & free]


def _field(of: Problem | Sampled, name: str, side: int) -> str:
    """The field that says what g or u is on a side."""
    return f"{name}, field {'u' if side in of.clamped_sides else 'g'}"


def _check_vertex(
    of: Problem | Sampled, name: str, vertex: int, end: float, start: float, allowed: float
) -> None:
    """Raises InputError unless what is given on the two sides at a vertex fits together there.

    It is `end` on the side before the vertex and `start` on the next one. Both are g or both u, and alike; or
    u is at least g. They may be off by what is `allowed`.
    """
    before, clamped = (vertex - 1) % of.polygon.n_sides, of.clamped_sides
    if (before in clamped) == (vertex in clamped):
        if abs(start - end) > allowed:
            one, other = _apart(end, start)
            jump = f"from {one} on side {before} to {other} on side {vertex}"
            where = _field(of, name, vertex)
            raise InputError(f"{where}: it jumps at vertex {vertex}, {jump}; it has to be continuous")
        return
    last, first = (before, end), (vertex, start)
    (of_u, u), (of_g, g) = (last, first) if before in clamped else (first, last)
    if u < g - allowed:
        x, y = of.polygon.vertices[vertex]
        below, above = _apart(u, g)
        raise InputError(
            f"{name}, field u: at vertex {vertex}, ({x:.6g}, {y:.6g}), u is {below} on side {of_u}, which is "
            f"clamped, but g is {above} on side {of_g}; u >= g has to hold there"
        )


def _apart(one: float, other: float) -> tuple[str, str]:
    """Two different numbers with as many digits, at least 6, as tell them apart."""
    texts = ((f"{one:.{digits}g}", f"{other:.{digits}g}") for digits in range(6, 18))
    return next(pair for pair in texts if pair[0] != pair[1])


def _always() -> bool:
    """For a side whose g is not the largest: it may be of any size."""
    return True


def _no_load(problem: Problem) -> bool:
    """Whether f may be 0, for all that is known of it."""
    if problem.nodal.f is not None:
        return not problem.nodal.f.any()
    return may_be_0(problem.f, some_points(problem.polygon))


def _may_be_0_on(problem: Problem, side: int, formulas: tuple[Expression, ...], traces: NodalTraces) -> bool:
    """Whether g or q may be 0 on a side, for all that is known of it."""
    if side in traces:
        return not traces[side].values.any()
    s = np.linspace(0, problem.polygon.lengths[side], POINTS)
    return may_be_0(formulas[side], problem.polygon.at(np.full(POINTS, side), s))


def _check_size(
    given: float, one: float, unit: float, where: str, place: str, is_0: Callable[[], bool]
) -> None:
    """Raises InputError if |f|, |g| or |q|, `given`, is too large, or too small and not 0.

    `one` is what is 1 in (1.1)-(1.2), where `unit` is the root of the polygon's area. A root of what
    interval arithmetic makes of 0 is not much smaller than SMALLEST: whether it is 0 its size does not say.
    """
    size = given / one
    if not np.isfinite(size):
        raise InputError(f"{where}: it is not finite {place}, or no bound can be found")
    smallest, largest = SMALLEST / min(unit, 1.0), LARGEST / max(unit, 1.0) ** POWER
    if size > largest or (size < smallest and not is_0()):
        of_polygon = f" on a polygon with the area {unit**2:.3g}" if unit != 1 else ""
        raise InputError(
            f"{where}: it is as large as {size:.3g} {place}, and squares of errors{of_polygon} leave the "
            f"range of double precision; scale the data to a size between {smallest:.3g} and {largest:.3g}"
        )
