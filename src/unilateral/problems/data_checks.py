"""Refuses f, g, u and q that are not finite or too large or small, and those that do not fit at a vertex."""

from __future__ import annotations

import math

import numpy as np

from unilateral.errors import InputError
from unilateral.problems.problem import Problem
from unilateral.problems.sampled import Sampled, values

SMALLEST, LARGEST = 1e-140, 1e140
"""The limits of |f|, |g| and |q|, so that squares of data are normal numbers.

For the squares of errors see `flux_residuals.underflow`.
"""
POWER = 2
"""Data are multiplied by this power of the root of the area in units of (k/c)^{1/2}, if that is above 1."""
ALMOST_ZERO = 1e-320
"""Interval arithmetic makes at most this of 0, in the user's units."""
ROUND_OFF = 1e-12
JUMP = 2.0**-26
"""A jump up to this part of the largest |g| at a vertex may come from rounding.

This allows for functions that keep half of the digits.
"""


def check(problem: Problem, name: str) -> None:
    """Raises InputError unless f, g, u and q are finite and fit together at each vertex, see `_check_vertex`.

    A g that jumps at a vertex is the trace of no u in H^1. The sizes of f, g and q are looked at in the units
    in which the problem is solved.
    """
    units, obstacle = problem.units, problem.enclosed_obstacle
    of_f, unit = max(map(abs, problem.range_of_f)), math.sqrt(problem.polygon.area) / units.length
    _check_size(of_f, units.load, unit, f"{name}, field f", "in the polygon")
    held = [side for side in range(problem.polygon.n_sides) if side not in problem.free_sides]
    sizes = {side: max(map(abs, obstacle.range(side))) for side in held}
    largest = max(sizes.values(), default=0.0)
    for side, size in sizes.items():
        where, least = _field(problem, name, side), size == largest
        _check_size(size, units.value, unit, where, f"on side {side}", least)
    for side in problem.flux_sides:
        of_q = max(map(abs, problem.enclosed_flux.range(side)))
        _check_size(of_q, units.flux, unit, f"{name}, field q", f"on side {side}")
    for vertex in _between(problem):
        end, start, doubt = obstacle.at_vertex(vertex)
        _check_vertex(problem, name, vertex, end, start, ROUND_OFF * largest + doubt)


def check_vertices(of: Sampled) -> None:
    """Raises InputError where g or u jumps at a vertex, or u < g: then no u in H^1 has that trace."""
    n, v = of.polygon.n_sides, of.polygon.vertices
    ends = {i: trace.values[[0, -1]] for i, trace in of.nodal.g.items()}
    for i in {*range(n)} - {*of.free_sides, *ends}:
        ends[i] = values(of.g[i], v[[i, (i + 1) % n]], of.place("g", i))
    largest = max((float(np.abs(each).max()) for each in ends.values()), default=0.0)
    for vertex in _between(of):
        _check_vertex(of, of.name, vertex, ends[(vertex - 1) % n][1], ends[vertex][0], JUMP * largest)


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
            jump = f"from {end:.6g} on side {before} to {start:.6g} on side {vertex}"
            where = _field(of, name, vertex)
            raise InputError(f"{where}: it jumps at vertex {vertex}, {jump}; it has to be continuous")
        return
    last, first = (before, end), (vertex, start)
    (of_u, u), (of_g, g) = (last, first) if before in clamped else (first, last)
    if u < g - allowed:
        x, y = of.polygon.vertices[vertex]
        raise InputError(
            f"{name}, field u: at vertex {vertex}, ({x:.6g}, {y:.6g}), u is {u:.6g} on side {of_u}, which is "
            f"clamped, but g is {g:.6g} on side {of_g}; u >= g has to hold there"
        )


def _check_size(given: float, one: float, unit: float, where: str, place: str, least: bool = True) -> None:
    """Raises InputError if |f|, |g| or |q|, `given`, is too large or too small.

    `one` is what is 1 in (1.1)-(1.2), where `unit` is the root of the polygon's area.
    """
    size = given / one
    if not np.isfinite(size):
        raise InputError(f"{where}: it is not finite {place}, or no bound can be found")
    smallest, largest = SMALLEST / min(unit, 1.0), LARGEST / max(unit, 1.0) ** POWER
    if size > largest or (given > ALMOST_ZERO and size < smallest and least):
        of_polygon = f" on a polygon with the area {unit**2:.3g}" if unit != 1 else ""
        raise InputError(
            f"{where}: it is as large as {size:.3g} {place}, and squares of errors{of_polygon} leave the "
            f"range of double precision; scale the data to a size between {smallest:.3g} and {largest:.3g}"
        )
