"""Refuses f, g, u and q that are not finite or too large or small, and those that do not fit at a vertex."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from functools import partial

import numpy as np

from unilateral.errors import InputError, shown
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import Expression, product, roots_in
from unilateral.geometry.polygon import Polygon
from unilateral.problems.formula_range import POINTS, may_be_0, range_in, range_on_side, some_points
from unilateral.problems.nodal import NodalTrace
from unilateral.problems.problem import Problem, as_formula
from unilateral.problems.reading import plain, read_source

SMALLEST = 1e-140
LARGEST = 1e140
"""The limits of |f|, |g| and |q|, so that squares of data are normal numbers.

They hold for the product of g with k^{1/2}, too, and for those of f and q with k^{-1/2}. For the squares of
errors see `flux_residuals.underflow`; where a sum of squares overflows, a bound is infinite.
"""
POWER = 2
"""Data are multiplied by this power of the root of the area, if that is above 1."""


def check(problem: Problem, name: str) -> None:
    """Raises InputError unless f, g, u and q are finite and fit together at each vertex, see `_check_vertex`.

    A g that jumps at a vertex is the trace of no u in H^1.
    """
    check_roots(problem, name)
    obstacle = problem.enclosed_obstacle
    root = math.sqrt(rounded(problem.k))
    of_values = limits(problem.polygon, root)
    of_fluxes = limits(problem.polygon, 1 / root)
    of_f = max(map(abs, problem.range_of_f))
    _check_size(of_f, of_fluxes, problem, f"{name}, field f", "in the polygon", lambda: _no_load(problem))
    held = [side for side in range(problem.polygon.n_sides) if side not in problem.free_sides]
    sizes = {side: max(map(abs, obstacle.range(side))) for side in held}
    largest = max(sizes.values(), default=0.0)
    for side, size in sizes.items():
        where = _field(problem, name, side)
        place = f"on side {side}"
        is_0 = partial(_may_be_0_on, problem, side, problem.g[side])
        _check_size(size, of_values, problem, where, place, is_0 if size == largest else _always)
    for side in problem.flux_sides:
        of_q = max(map(abs, problem.enclosed_flux.range(side)))
        is_0 = partial(_may_be_0_on, problem, side, problem.q[side])
        _check_size(of_q, of_fluxes, problem, f"{name}, field q", f"on side {side}", is_0)
    for vertex in vertices_between(problem):
        allowed = obstacle.rounded_jumps[vertex] + obstacle.end_doubts[:, vertex].sum()
        end, start = obstacle.ends[:, vertex].tolist()
        _check_vertex(problem, name, vertex, end, start, allowed)


def check_roots(problem: Problem, name: str) -> None:
    """Raises InputError unless every root in f, g, u and q is taken of what is above 0 in its place.

    Guaranteed ranges of the roots decide that.
    """
    for root in _roots(problem.f):
        if not np.isfinite(range_in(problem.polygon, root)).all():
            raise InputError(
                f"{name}, field f: {_needs(root, 'in the polygon', partial(read_source, mesh=None))}"
            )
    for side in range(problem.polygon.n_sides):
        free = side in problem.free_sides
        field = "q" if free else "u" if side in problem.clamped_sides else "g"
        data = problem.q if free else problem.g
        for root in _roots(data[side]) if data else ():
            if not np.isfinite(range_on_side(problem.polygon, root, side)).all():
                read = partial(plain, field=field) if free else None
                raise InputError(f"{name}, field {field}: {_needs(root, f'on side {side}', read)}")


def _roots(data: object) -> list[Expression]:
    """The powers in a formula whose exponents are no whole numbers."""
    return [product(1, [power]) for power in roots_in(data)] if isinstance(data, Expression) else []


def _needs(root: Expression, place: str, read: Callable[..., object] | None) -> str:
    """What a root needs, and the positive part that can be written in its place if it can be `read`."""
    ((base, k),) = root.factors[1]
    radicand = product(1, [(base, Fraction(1))])
    needs = f"{shown(root)} needs {shown(radicand)} > 0 {place}"
    instead = f"pos({radicand}, {k})"
    with suppress(InputError):
        if read:
            read(instead, where="")
            return f"{needs}; write {instead}, which is 0 elsewhere"
    return needs if read else f"{needs}; a root is not Lipschitz where it is 0"


def vertices_between(problem: Problem) -> list[int]:
    """The vertices between two sides that are not free."""
    n = problem.polygon.n_sides
    free = {*problem.free_sides}
    return [vertex for vertex in range(n) if not {vertex, (vertex - 1) % n} & free]


def _field(of: Problem, name: str, side: int) -> str:
    """The field that says what g or u is on a side."""
    return f"{name}, field {'u' if side in of.clamped_sides else 'g'}"


def _check_vertex(of: Problem, name: str, vertex: int, end: float, start: float, allowed: float) -> None:
    """Raises InputError unless what is given on the two sides at a vertex fits together there.

    It is `end` on the side before the vertex and `start` on the next one. Both are g or both u, and alike; or
    u is at least g. They may be off by what is `allowed`.
    """
    before = (vertex - 1) % of.polygon.n_sides
    clamped = of.clamped_sides
    if (before in clamped) == (vertex in clamped):
        if abs(start - end) > allowed:
            one, other = _apart(end, start)
            jump = f"from {one} on side {before} to {other} on side {vertex}"
            where = _field(of, name, vertex)
            raise InputError(f"{where}: it jumps at vertex {vertex}, {jump}; it has to be continuous")
        return
    last = (before, end)
    first = (vertex, start)
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
    if isinstance(problem.f, np.ndarray):
        return not problem.f.any()
    return may_be_0(as_formula(problem.f), some_points(problem.polygon))


def _may_be_0_on(problem: Problem, side: int, data: object) -> bool:
    """Whether the g or q that is given on a side may be 0 there, for all that is known of it."""
    if isinstance(data, NodalTrace):
        return not data.values.any()
    s = np.linspace(0, problem.polygon.lengths[side], POINTS)
    return may_be_0(as_formula(data), problem.polygon.at(np.full(POINTS, side), s))


def limits(polygon: Polygon, factor: float) -> tuple[float, float]:
    """The least and the largest size of data on a polygon, which are multiplied by the `factor`, too."""
    length = math.sqrt(polygon.area)
    smallest = SMALLEST / min(length, 1.0) / min(1.0, factor)
    largest = LARGEST / max(length, 1.0) ** POWER / max(1.0, factor)
    return smallest, largest


def _check_size(
    size: float,
    allowed: tuple[float, float],
    problem: Problem,
    where: str,
    place: str,
    is_0: Callable[[], bool],
) -> None:
    """Raises InputError if the size of |f|, |g| or |q| is above what is allowed, or below it and not 0.

    A root of what interval arithmetic makes of 0 is not much smaller than SMALLEST: whether it is 0 its size
    does not say.
    """
    if not np.isfinite(size):
        raise InputError(f"{where}: it is not finite {place}, or no bound can be found")
    smallest, largest = allowed
    if size > largest or (size < smallest and not is_0()):
        area = problem.polygon.area
        of_polygon = f" on a polygon with the area {area:.3g}" if area != 1 else ""
        raise InputError(
            f"{where}: it is as large as {size:.3g} {place}, and squares of errors{of_polygon} leave the "
            f"range of double precision; scale the data to a size between {smallest:.3g} and {largest:.3g}"
        )
