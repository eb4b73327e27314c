"""Problems without a known solution: a polygon, f in it, an obstacle g or a flux q on its sides."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.exact_numbers import as_float, log2_magnitude, sign
from unilateral.formulas.expression import ONE, ZERO, Expression, Primitive, find_functions
from unilateral.formulas.formula import polynomial_coefficients
from unilateral.formulas.taylor import EPS, TaylorModel, join_models
from unilateral.formulas.taylor_enclosures import StepValues, enclose_formula
from unilateral.geometry.curves import Kink
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems.fields import as_html, as_text, problem_fields, problem_heading
from unilateral.problems.formula_range import range_in_polygon
from unilateral.problems.functions import Function
from unilateral.problems.nodal import NodalTrace, trace_breakpoints
from unilateral.problems.obstacle_and_flux import GivenFlux, Obstacle, enclose_given_flux, enclose_obstacle
from unilateral.problems.side_models import SideData, model_side_data, model_side_slopes, side_coordinates

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution

MIN_COEFFICIENT_RATIO = 1e-100
"""Coefficients that differ by this factor make a line that is nowhere near, or a circle that is too large."""

CURVE_NEEDED = "must be linear, or c - (x - a)**2 - (y - b)**2 up to a factor"
"""What the argument of a positive part in f must be, as messages say it."""


@dataclass(frozen=True, eq=False)
class SourceFunction:
    """f as a function that can be enclosed.

    Parameters
    ----------
    model
        f on the boxes of x and y, on which the steps in it have the values of its third argument, NaN for
        both 0 and 1.
    jumps
        The steps pos(a, 0) in f, and the line or circle at which each changes between 0 and 1.
    """

    model: Callable[[TaylorModel, TaylorModel, StepValues], TaylorModel]
    jumps: Mapping[Primitive, Kink]


@dataclass(frozen=True, eq=False)
class Problem:
    """-k lap u + c u = f with contact, but k du/dn = q on `free_sides`.

    `g` has an obstacle for each side, which is not used on free sides; on `clamped_sides` it is what u is
    there. `q` has a flux for each side, which is 0 on those that are not free; if `q` is empty, the flux is
    0. f is a formula in x and y, or its values at the nodes of the `mesh`; then it is linear on triangles. g
    and q are formulas, or values at nodes, between which they are linear. Functions of Python wait for a
    mesh, see `build.put_on_mesh`. A case has an `exact` solution, from which f, and g on sides with contact,
    come in place of the fields f and g. The `title` is one line that says what problem it is.
    """

    name: str
    polygon: Polygon
    f: Expression | Array | Function
    g: tuple[SideData | Function, ...]
    free_sides: tuple[int, ...]
    k: Expression = ONE
    c: Expression = ONE
    q: tuple[SideData | Function, ...] = ()
    mesh: Mesh | None = None
    title: str = ""
    clamped_sides: tuple[int, ...] = ()
    exact: ExactSolution | None = None

    def known_solution(self) -> ExactSolution:
        """The exact solution. Raises InputError for a problem that is not a case."""
        if self.exact is None:
            raise InputError(f"'{self.name}' is not a case; only the solutions of cases are known")
        return self.exact

    def __repr__(self) -> str:
        return as_text(self)

    def _repr_html_(self) -> str:
        return as_html(problem_heading(self), problem_fields(self))

    @property
    def has_functions(self) -> bool:
        """Whether a function waits for a mesh, at whose nodes it is evaluated."""
        return any(map(callable, (self.f, *self.g, *self.q)))

    @property
    def contact_sides(self) -> tuple[int, ...]:
        """The sides that carry contact: all that are neither free nor clamped."""
        return remaining_sides(self.polygon, self.free_sides, self.clamped_sides)

    @property
    def source(self) -> SourceFunction | Array:
        """f as a function that can be enclosed, or (n,) at the nodes of the mesh, if it is given by them."""
        if self.exact:
            exact = self.exact
            return SourceFunction(lambda x, y, _: exact.source_model(x, y), {})
        if isinstance(self.f, np.ndarray):
            return self.f
        f = as_formula(self.f)
        # pos(a, 0) is a step: 1 where a > 0, else 0; it jumps where a is 0
        steps = [power for power in find_functions(f, "pos") if power.args[1].rational == 0]
        return SourceFunction(
            model=lambda x, y, steps: enclose_formula(f, {"x": x, "y": y}, steps),
            jumps={step: kink for step in steps for kink in zero_curve(step.args[0])},
        )

    def obstacle_model(self, side: Index, t: TaylorModel) -> TaylorModel:
        """g, or the given u, on intervals of the sides (k,), t the arc length in side lengths."""
        if self.exact is None:
            return self._side_data_model(self.g, side, t)
        # of a case: g = u - gap, but on clamped sides the u that is declared, a formula
        is_clamped = np.isin(side, self.clamped_sides)
        contact = np.flatnonzero(~is_clamped)
        clamped = np.flatnonzero(is_clamped)
        models = []
        if contact.size:
            models.append((self.exact.obstacle_model(side[contact], t.select_boxes(contact)), contact))
        if clamped.size:
            models.append((self._side_data_model(self.g, side[clamped], t.select_boxes(clamped)), clamped))
        return join_models(models)

    @cached_property
    def enclosed_obstacle(self) -> Obstacle:
        """g on the sides with contact, and u on clamped ones, enclosed.

        If none are clamped, it is less precise below a = inf f / c: as u >= a, see `idle_sides`, u is also
        the solution for any other obstacle that is at most a where g is.
        """
        return enclose_obstacle(
            self.polygon,
            self.obstacle_model,
            free=self.free_sides,
            u_lower_bound=-math.inf if self.clamped_sides else self._lower_bound_by_source,
            breakpoints=self.exact.singular_points() if self.exact else trace_breakpoints(self.g),
            clamped=self.clamped_sides,
            slope_model=self.slope_model,
        )

    def slope_model(self, side: Index, t: TaylorModel) -> TaylorModel:
        """The derivative by t of u on clamped sides, as `obstacle_model` has u."""
        return model_side_slopes(as_side_data(self.g), self.polygon, side, t)

    def flux_model(self, side: Index, t: TaylorModel) -> TaylorModel:
        """q as `obstacle_model` has g."""
        return self._side_data_model(self.q, side, t)

    def _side_data_model(
        self, data: Sequence[SideData | Function], side: Index, t: TaylorModel
    ) -> TaylorModel:
        x, y = side_coordinates(self.polygon, side, t)
        return model_side_data(as_side_data(data), side, {"x": x, "y": y, "t": t})

    @property
    def flux_sides(self) -> tuple[int, ...]:
        """The sides on which q is not 0."""
        return tuple(side for side, flux in enumerate(self.q) if not is_zero(flux))

    @cached_property
    def enclosed_flux(self) -> GivenFlux:
        """q on free sides, enclosed."""
        return enclose_given_flux(self.polygon, self.flux_model, self.flux_sides, trace_breakpoints(self.q))

    @cached_property
    def range_of_f(self) -> tuple[float, float]:
        """Guaranteed bounds on f in Omega, infinite where none are found, as for cases."""
        if self.exact:
            return -math.inf, math.inf
        if isinstance(self.f, np.ndarray):
            return float(self.f.min()), float(self.f.max())
        return range_in_polygon(self.polygon, as_formula(self.f))

    @cached_property
    def u_lower_bound(self) -> float:
        """A guaranteed lower bound on u: inf f / c or the least u on clamped sides, see `idle_sides`.

        It is -inf where q may be below 0.
        """
        # u >= min(inf f / c, inf of u on clamped sides), proved in `idle_sides`
        zero = {i for i in self.clamped_sides if is_zero(self.g[i])}
        clamped = (0.0 if i in zero else self.enclosed_obstacle.range(i)[0] for i in self.clamped_sides)
        return min(self._lower_bound_by_source, *clamped, math.inf)

    @cached_property
    def _lower_bound_by_source(self) -> float:
        """A lower bound on u by the proof in `idle_sides`, if no side were clamped: inf f / c.

        For c = 0 it is +inf if f >= 0, as then only clamped sides bound u, else -inf. It is -inf where q may
        be below 0, for the proof needs q >= 0.
        """
        if self.enclosed_flux.lower_bound < 0:
            return -math.inf
        if self.c == ZERO:  # -0.0 is 0
            return math.copysign(math.inf, self.range_of_f[0] if self.range_of_f[0] else 1.0)
        if self.c == ONE:
            return self.range_of_f[0]
        # f / c is rounded by half a unit, and so is c
        quotient = self.range_of_f[0] / as_float(self.c)
        return quotient - 4 * EPS * abs(quotient)

    def make_idle_sides_free(self) -> Problem:
        """The problem whose sides that provably carry no contact are free."""
        return replace(self, free_sides=tuple(sorted({*self.free_sides, *self.idle_sides()})))

    def idle_sides(self) -> tuple[int, ...]:
        """The sides with contact that provably carry none: sup g < ess inf f / c = a there.

        For u >= a where q >= 0: with w = (a - u)_+, v = u + w >= g is admissible, so
        (u, w) >= (f, w)_0 + int q w >= c a int w. But (u, w) is -k ||grad w||_0^2 + c int u w, and that is
        c a int w - ||w||^2, so w = 0, whatever holds on the other sides. If u is given on some, it must be at
        least a there, for w to vanish; a is then the least of both. If c = 0, f >= 0 is enough: (u, w) is
        -k ||grad w||_0^2. Where q may be below 0 nothing is known. Where g < a <= u complementarity then
        gives lambda = 0. u_h obeys no such principle and may touch g there, so that to leave these sides out
        changes Lambda_H, and the discrete solution with it. Both bounds are guaranteed,
        by interval arithmetic; a side that they do not decide is not idle.
        """
        obstacle = self.enclosed_obstacle
        return tuple(side for side in self.contact_sides if obstacle.range(side)[1] < self.u_lower_bound)


def remaining_sides(polygon: Polygon, *excluded: Collection[int]) -> tuple[int, ...]:
    """The sides that are none of the others."""
    return tuple(side for side in range(polygon.n_sides) if not any(side in sides for sides in excluded))


def is_zero(data: SideData | Function) -> bool:
    """Whether the formula 0 is given on a side."""
    return isinstance(data, Expression) and data.rational == 0


def as_formula(data: object) -> Expression:
    """The formula that was given, in places that others do not reach."""
    assert isinstance(data, Expression)
    return data


def as_side_data(data: Sequence[SideData | Function]) -> list[SideData]:
    """The data on sides, none of which may wait for a mesh."""
    available = [entry for entry in data if isinstance(entry, Expression | NodalTrace)]
    assert len(available) == len(data)  # `build.put_on_mesh` evaluates functions first
    return available


def zero_curve(a: Expression) -> list[Kink]:
    """The line or circle on which a formula is 0; ValueError if that is neither."""
    coefficients = polynomial_coefficients(a, "xy")
    if coefficients is None:
        raise ValueError(CURVE_NEEDED)
    # Times a power of 2, so that they, and what is made of them, are finite numbers
    largest = max(map(log2_magnitude, coefficients.values()), default=0)
    coefficients = {k: c.scale(Fraction(2) ** -largest) for k, c in coefficients.items()}
    # a (x^2 + y^2) + b.(x, y) + c, or without the square a line
    slope = [coefficients.pop((1, 0), ZERO), coefficients.pop((0, 1), ZERO)]
    c = coefficients.pop((0, 0), ZERO)
    square = coefficients.pop((2, 0), ZERO)
    square_y = coefficients.pop((0, 2), ZERO)
    if coefficients or sign(square - square_y):
        raise ValueError(CURVE_NEEDED)
    if square == ZERO:
        return _zero_line(slope, c)
    if abs(as_float(square)) < MIN_COEFFICIENT_RATIO:
        raise ValueError("is 0 on a circle that is too large; write it as a line")
    # It is a (|x - m|^2 - r^2) with m = -b / (2 a) and r^2 = |m|^2 - c / a
    centre = [component / square.scale(-2) for component in slope]
    radius = as_float(centre[0] ** 2 + centre[1] ** 2 - c / square)
    place = (as_float(centre[0]), as_float(centre[1]))
    return [Kink(place, math.sqrt(radius), sign=1 if as_float(square) > 0 else -1)] if radius > 0 else []


def _zero_line(slope: list[Expression], c: Expression) -> list[Kink]:
    """The line b.(x, y) + c = 0, none if it is too far away; ValueError if the formula is 0."""
    along = [as_float(component) for component in slope]
    size = math.hypot(*along)
    if c == ZERO and size == 0:
        raise ValueError("is 0 everywhere; leave it out")
    if size <= MIN_COEFFICIENT_RATIO * abs(as_float(c)):
        return []
    # Through the point -c b / |b|^2 across b, so that the distance is positive where the formula is
    square = slope[0] ** 2 + slope[1] ** 2
    x = as_float(-c * slope[0] / square)
    y = as_float(-c * slope[1] / square)
    return [Kink((x, y), 0.0, (-along[1] / size, along[0] / size))]
