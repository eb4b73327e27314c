"""Refuses f, g, u and q that are not finite or too large or small, and those that do not fit at a vertex."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from fractions import Fraction
from functools import partial

import numpy as np

from unilateral.errors import InputError, quote_input
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import Expression, find_fractional_powers, multiply_powers
from unilateral.geometry.polygon import Polygon
from unilateral.problems.formula_range import (
    GRID_POINTS_PER_AXIS,
    may_be_0,
    range_in_polygon,
    range_on_side,
    sample_points,
)
from unilateral.problems.nodal import NodalTrace
from unilateral.problems.problem import Problem, as_formula
from unilateral.problems.reading import read_formula, read_source

MIN_DATA_SIZE = 1e-140
MAX_DATA_SIZE = 1e140
"""The limits of |f|, |g| and |q|, so that squares of data are normal numbers.

They hold for the product of g with k^{1/2}, too, and for those of f and q with k^{-1/2}. For the squares of
errors see `residual_norm.underflow_allowance`; where a sum of squares overflows, a bound is infinite.
"""
AREA_ROOT_POWER = 2
"""Data are multiplied by this power of the root of the area, if that is above 1."""


def check_data(problem: Problem, name: str) -> None:
    """Raises InputError unless f, g, u and q are finite, of allowed size, and fit together at each vertex.

    A g that jumps at a vertex is the trace of no u in H^1.
    """
    check_radicands(problem, name)
    _check_data_sizes(problem, name)
    obstacle = problem.enclosed_obstacle
    # Both values at a vertex are known up to their remainders, and users round
    for vertex in constrained_vertices(problem):
        allowed = obstacle.rounded_jumps[vertex] + obstacle.end_remainders[:, vertex].sum()
        end, start = obstacle.ends[:, vertex].tolist()
        _check_fit_at_vertex(problem, name, vertex, end, start, allowed)


def _check_data_sizes(problem: Problem, name: str) -> None:
    """Raises InputError unless |f|, |g| and |q| are finite, and neither too large nor too small to square."""
    # Energies are k |g|^2 and |f|^2 / k, |q|^2 / k: their squares have to be normal numbers
    root = math.sqrt(as_float(problem.k))
    value_limits = data_limits(problem.polygon, root)
    flux_limits = data_limits(problem.polygon, 1 / root)
    may_vanish = partial(_may_vanish_on_side, problem)
    label = problem.polygon.label_side
    f_size = max(map(abs, problem.range_of_f))
    where = f"{name}, field f"
    _check_size(f_size, flux_limits, problem, where, "in the polygon", partial(_may_have_no_source, problem))

    obstacle_sides = [side for side in range(problem.polygon.n_sides) if side not in problem.free_sides]
    sizes = {side: max(map(abs, problem.enclosed_obstacle.range(side))) for side in obstacle_sides}
    largest = max(sizes.values(), default=0.0)
    for side, size in sizes.items():
        where = _boundary_field(problem, name, side)
        # only the largest g is to be above the least size
        is_0 = partial(may_vanish, side, problem.g[side]) if size == largest else lambda: True
        _check_size(size, value_limits, problem, where, f"on side {label(side)}", is_0)

    for side in problem.flux_sides:
        q_size = max(map(abs, problem.enclosed_flux.range(side)))
        is_0 = partial(may_vanish, side, problem.q[side])
        _check_size(q_size, flux_limits, problem, f"{name}, field q", f"on side {label(side)}", is_0)


def check_radicands(problem: Problem, name: str) -> None:
    """Raises InputError unless every root in f, g, u and q is taken of what is above 0 in its place.

    Guaranteed ranges of the roots decide that.
    """
    for root in _data_roots(problem.f):
        if not np.isfinite(range_in_polygon(problem.polygon, root)).all():
            raise InputError(
                f"{name}, field f: {_explain_root(root, 'in the polygon', partial(read_source, mesh=None))}"
            )
    label = problem.polygon.label_side
    for side in range(problem.polygon.n_sides):
        free = side in problem.free_sides
        field = "q" if free else "u" if side in problem.clamped_sides else "g"
        data = problem.q if free else problem.g
        for root in _data_roots(data[side]) if data else ():
            if not np.isfinite(range_on_side(problem.polygon, root, side)).all():
                # no hint for g and u: they have to be Lipschitz, and pos(a, 1/2) is not
                read = partial(read_formula, field=field) if free else None
                raise InputError(
                    f"{name}, field {field}: {_explain_root(root, f'on side {label(side)}', read)}"
                )


def _data_roots(data: object) -> list[Expression]:
    """The powers in a formula whose exponents are no whole numbers, as expressions; none of other data."""
    powers = find_fractional_powers(data) if isinstance(data, Expression) else []
    return [multiply_powers(1, [power]) for power in powers]


def _explain_root(root: Expression, place: str, read: Callable[..., object] | None) -> str:
    """The condition that a root needs, and the positive part to write in its place, for a message."""
    ((base, k),) = root.factors[1]
    radicand = multiply_powers(1, [(base, Fraction(1))])
    needs = f"{quote_input(root)} needs {quote_input(radicand)} > 0 {place}"
    instead = f"pos({radicand}, {k})"
    with suppress(InputError):
        if read:
            read(instead, where="")
            return f"{needs}; write {instead}, which is 0 elsewhere"
    return needs if read else f"{needs}; a root is not Lipschitz where it is 0"


def constrained_vertices(problem: Problem) -> list[int]:
    """The vertices between two sides that are not free."""
    n = problem.polygon.n_sides
    free = {*problem.free_sides}
    return [vertex for vertex in range(n) if not {vertex, (vertex - 1) % n} & free]


def _boundary_field(problem: Problem, name: str, side: int) -> str:
    """The field that says what g or u is on a side."""
    return f"{name}, field {'u' if side in problem.clamped_sides else 'g'}"


def _check_fit_at_vertex(
    problem: Problem, name: str, vertex: int, value_before: float, value_after: float, allowed: float
) -> None:
    """Raises InputError unless what is given on the two sides at a vertex fits together there.

    It is `value_before` on the side before the vertex and `value_after` on the next one. Both are g or both
    u, and alike; or u is at least g. They may be off by `allowed`.
    """
    before = (vertex - 1) % problem.polygon.n_sides
    clamped = problem.clamped_sides
    if (before in clamped) != (vertex in clamped):
        values = {before: value_before, vertex: value_after}
        _check_above_obstacle(problem, name, vertex, values, allowed)
    elif abs(value_after - value_before) > allowed:
        text_before, text_after = _distinct_texts(value_before, value_after)
        label = problem.polygon.label_side
        jump = f"from {text_before} on side {label(before)} to {text_after} on side {label(vertex)}"
        where = _boundary_field(problem, name, vertex)
        raise InputError(f"{where}: it jumps at vertex {vertex}, {jump}; it has to be continuous")


def _check_above_obstacle(
    problem: Problem, name: str, vertex: int, values: Mapping[int, float], allowed: float
) -> None:
    """Raises InputError if the u of a clamped side is below the g of the other one at their common vertex.

    `values` has both numbers by the sides' numbers; u may be too small by `allowed`.
    """
    (u_side,) = values.keys() & {*problem.clamped_sides}
    (g_side,) = values.keys() - {u_side}
    u = values[u_side]
    g = values[g_side]
    if u < g - allowed:
        x, y = problem.polygon.vertices[vertex]
        below, above = _distinct_texts(u, g)
        label = problem.polygon.label_side
        raise InputError(
            f"{name}, field u: at vertex {vertex}, ({x:.6g}, {y:.6g}), u is {below} on side {label(u_side)}, "
            f"which is clamped, but g is {above} on side {label(g_side)}; u >= g has to hold there"
        )


def _distinct_texts(a: float, b: float) -> tuple[str, str]:
    """Two different numbers with as many digits, at least 6, as tell them apart."""
    texts = ((f"{a:.{digits}g}", f"{b:.{digits}g}") for digits in range(6, 18))
    return next(pair for pair in texts if pair[0] != pair[1])


def _may_have_no_source(problem: Problem) -> bool:
    """Whether f may be 0, for all that is known of it."""
    if isinstance(problem.f, np.ndarray):
        return not problem.f.any()
    return may_be_0(as_formula(problem.f), sample_points(problem.polygon))


def _may_vanish_on_side(problem: Problem, side: int, data: object) -> bool:
    """Whether the g or q that is given on a side may be 0 there, for all that is known of it."""
    if isinstance(data, NodalTrace):
        return not data.values.any()
    s = np.linspace(0, problem.polygon.lengths[side], GRID_POINTS_PER_AXIS)
    return may_be_0(as_formula(data), problem.polygon.at(np.full(GRID_POINTS_PER_AXIS, side), s))


def data_limits(polygon: Polygon, factor: float) -> tuple[float, float]:
    """The least and the largest size of data on a polygon, which are multiplied by the `factor`, too."""
    length = math.sqrt(polygon.area)
    smallest = MIN_DATA_SIZE / min(length, 1.0) / min(1.0, factor)
    largest = MAX_DATA_SIZE / max(length, 1.0) ** AREA_ROOT_POWER / max(1.0, factor)
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

    `where` names the field, and `place` says in words where in the polygon. A root of what interval
    arithmetic makes of 0 is not much smaller than MIN_DATA_SIZE, so `is_0` tells whether the data may be 0.
    """
    if not np.isfinite(size):
        raise InputError(f"{where}: it is not finite {place}, or no bound can be found")
    smallest, largest = allowed
    if size > largest or (size < smallest and not is_0()):
        area = problem.polygon.area
        area_text = f" on a polygon with the area {area:.3g}" if area != 1 else ""
        raise InputError(
            f"{where}: it is as large as {size:.3g} {place}, and squares of errors{area_text} leave the "
            f"range of double precision; scale the data to a size between {smallest:.3g} and {largest:.3g}"
        )
