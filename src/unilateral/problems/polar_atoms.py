"""Polar atoms: c rho^beta cos(beta (theta - theta_0)), harmonic, times a smooth radial cutoff.

`make_harmonic_atom` makes those of cases at a point inside a side, `make_corner_atom` those at a vertex.

rho and theta are polar coordinates about a point of the boundary, rho in side lengths and theta from the
side's direction into Omega. Values are computed from them, never from x and y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.errors import InputError
from unilateral.formulas.derivative import derivative
from unilateral.formulas.exact_numbers import apply_function, as_float, pos
from unilateral.formulas.expression import ONE, PI, Expression, variable
from unilateral.formulas.formula import CompiledFormulas
from unilateral.formulas.grammar import MAX_DENOMINATOR
from unilateral.formulas.taylor import TaylorModel, apply_on_subsets, number_model
from unilateral.formulas.taylor_enclosures import enclose_formula, polar_power_model
from unilateral.geometry.curves import Kink, SingularPoint
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import SIDE_TOLERANCE, FormulaAtom, Regularity, SideAtom, SidePoints

R = variable("r")
THETA = variable("theta")
Q = variable("q")


@dataclass(frozen=True, eq=False)
class PolarAtom(SideAtom, FormulaAtom):
    """times * factor rho^beta cos(beta (theta - theta_0)) (1 - (rho / cutoff)^2)_+^4, rho = r / L.

    No cutoff factor where `cutoff` is None. Angles are in units of pi. `omega` is Omega's angle at the
    centre: 1 inside the side, or that of the vertex at which the side begins. The side before that may be
    `clamped`.
    """

    beta: Fraction
    theta_0: Fraction
    factor: Expression
    cutoff: Expression | None
    omega: Fraction = Fraction(1)
    clamped: bool = False

    @property
    def derivatives(self) -> tuple[Expression, Expression, Expression, Expression]:
        """v, dv/dr, (dv/dtheta)/r and Delta v."""
        return _derive_polar(self.factor, self.beta, self.theta_0, self.cutoff)

    @property
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        v, v_r, v_theta_over_r, laplacian = self.derivatives
        length = Fraction(self.length)
        return [v, v_r, v_theta_over_r, length * v - laplacian / length], ("r", "theta")

    def value_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of u on the boxes of x and y."""
        return self._combine_in_support(x, y, lambda phi, eta, _: (phi * eta).scale(self.length))

    def source_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of -Delta u + u on the boxes of x and y."""
        scale = self.length
        return self._combine_in_support(
            x, y, lambda phi, eta, laplacian: phi * (eta.scale(scale) + laplacian.scale(-1 / scale))
        )

    def _combine_in_support(
        self,
        x: TaylorModel,
        y: TaylorModel,
        combine: Callable[[TaylorModel, TaylorModel, TaylorModel], TaylorModel],
    ) -> TaylorModel:
        """`combine` of phi, eta and Delta v / phi on boxes that may meet the support, 0 on the others."""
        along, into = self.local_models(x, y)
        # The distance of the box [a, b] from 0 is max(0, a, -b), by coordinate
        nearest = (np.maximum(0.0, np.maximum(z.range[0], -z.range[1])) for z in (along, into))
        inside = np.hypot(*nearest) < self._support_radius
        return apply_on_subsets(
            [(lambda along, into: combine(*self._factor_models(along, into)), inside)], along, into
        )

    def _factor_models(
        self, along: TaylorModel, into: TaylorModel
    ) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
        """The harmonic factor phi of v, the cutoff eta, and Delta v / phi.

        With q = (rho / cutoff)^2, eta = (1 - q)_+^4 and phi_r = beta phi / rho,
        Delta v / phi = (48 q (1 - q)_+^2 - 16 (1 + beta) (1 - q)_+^3) / cutoff^2.
        """
        theta_0 = as_float(PI * self.theta_0)
        omega = as_float(PI * self.omega)
        phi = polar_power_model(along, into, float(self.beta), theta_0, omega).scale(as_float(self.factor))
        if self.cutoff is None:
            return phi, number_model(along, 1.0), number_model(along, 0.0)
        q = (along * along + into * into).scale(self._support_radius**-2)
        laplacian = (48 * Q * pos(1 - Q, 2) - 16 * (1 + self.beta) * pos(1 - Q, 3)) / self.cutoff**2
        return phi, enclose_formula(pos(1 - Q, 4), {"q": q}), enclose_formula(laplacian, {"q": q})

    @property
    def _support_radius(self) -> float:
        return np.inf if self.cutoff is None else as_float(self.cutoff)

    def _is_in_support(self, r: Array) -> Mask:
        """Whether each distance r is inside the support and not 0, (k,)."""
        return (r < self._support_radius) & (r > 0)

    def _evaluate(
        self, formulas: CompiledFormulas, points: Array, offset: Array | float
    ) -> tuple[Array, ...]:
        """u, its gradient (k, 2) and the other `formulas` at points + offset (k, 2); 0 outside the support.

        They are 0 at the centre, too, where polar coordinates have no angle and a gradient may be infinite.
        """
        along, into = self.local_coordinates_inside(points, offset)
        r = np.hypot(along, into)
        inside = self._is_in_support(r)
        theta = np.arctan2(into[inside], along[inside])
        theta = np.where(theta < 0, theta + 2 * np.pi, theta)
        v, v_r, v_theta_over_r, *f = formulas(r[inside], theta)
        inside_values = (self.length * v, self.rotate_polar_to_xy(theta, v_r, v_theta_over_r), *f)
        return tuple(_fill_with_zeros(inside, values) for values in inside_values)

    def vanishes_in_circles(self, centre: Array, radius: Array) -> Mask:
        """Whether u is known to be 0 in each circle, (k,)."""
        return np.hypot(*self.local_coordinates(centre)) - radius / self.length > self._support_radius

    @property
    def is_at_vertex(self) -> bool:
        """Whether the centre is the vertex at which the side begins."""
        return self.t == 0

    def touches(self, side: int) -> bool:
        """Whether the atom's trace on the side is known exactly, and not by values in x and y."""
        return side == self.side or (self.is_at_vertex and side == self._previous_side)

    @property
    def _previous_side(self) -> int:
        return (self.side - 1) % self.polygon.n_sides

    def trace_and_normal_flux(self, side: int, along: SidePoints) -> tuple[Array, Array]:
        """Values of u and its outward normal derivative on the side, from exact r and theta, (k,) each."""
        # Signed, in lengths L of the atom's side: theta is 0 where it is >= 0, and else omega
        if side == self.side:
            distance = along.distance_from(self.t)
        else:
            distance = along.distance_from(1.0) * (self.polygon.lengths[side] / self.length)
        r = np.abs(distance)
        first = distance >= 0
        inside = self._is_in_support(r)
        v, _, v_theta_over_r = self._compiled_formulas[0](
            r[inside], np.where(first, 0.0, as_float(PI * self.omega))[inside]
        )
        # du/dn = -(dv/dtheta)/r at theta = 0, below which Omega ends, and +(dv/dtheta)/r at theta = omega
        flux = np.where(first[inside], -v_theta_over_r, v_theta_over_r)
        return _fill_with_zeros(inside, self.length * v), _fill_with_zeros(inside, flux)

    @cached_property
    def regularity(self) -> Regularity:
        """On a side u is like cos(beta (theta - theta_0)) rho^beta, lambda like sin(..) rho^(beta - 1).

        A clamped side does not count: there is no lambda.
        """
        sides = (Fraction(0),) if self.clamped else (Fraction(0), self.omega)
        turns = [self.beta * (theta - self.theta_0) for theta in sides]
        # cos(n pi/2) = 0 for odd n: no trace; sin(n pi) = 0: no flux. Else powers: H^2 needs beta > 1,
        # Lipschitz beta >= 1, and lambda ~ rho^(beta - 1) is in L^2 for 2 (beta - 1) > -1
        no_trace = all(turn.denominator == 2 for turn in turns)
        no_flux = all(turn.denominator == 1 for turn in turns)
        return Regularity(
            in_H2=self.beta > 1,
            lipschitz=self.beta >= 1 or no_trace,
            flux_in_L2=2 * self.beta > 1 or no_flux,
            flux_bounded=self.beta >= 1 or no_flux,
        )

    def kinks(self) -> list[Kink]:
        """The circle at which the cutoff ends, if there is one."""
        if self.cutoff is None:
            return []
        return [Kink((self.centre[0], self.centre[1]), self._support_radius * self.length)]

    def singular_points(self) -> list[SingularPoint]:
        """The centre, and the cutoff's ends on the atom's side, where only smoothness is lost."""
        points = [SingularPoint(self.side, self.t, self.beta.denominator)]
        if self.is_at_vertex:
            points.append(SingularPoint(self._previous_side, 1.0, points[0].grading))
        if self.cutoff is not None:
            points += [SingularPoint(self.side, self.t + sign * self._support_radius, 1) for sign in (-1, 1)]
        return points


def _fill_with_zeros(inside: Mask, values: Array) -> Array:
    """The values (m, ...) where `inside` (k,), and 0 elsewhere, (k, ...)."""
    if inside.all():
        return values
    everywhere = np.zeros((len(inside), *values.shape[1:]))
    everywhere[inside] = values
    return everywhere


@cache
def _derive_polar(
    factor: Expression, beta: Fraction, theta_0: Fraction, cutoff: Expression | None
) -> tuple[Expression, Expression, Expression, Expression]:
    """v, dv/dr, (dv/dtheta)/r and Delta v; the harmonic factor adds nothing to the last."""
    # cos(beta (theta - theta_0)) by the addition theorem, so that whole quarters of a turn are exact
    shift = beta * theta_0 * PI
    turned = beta * THETA
    cosine = apply_function("cos", shift) * apply_function("cos", turned) + apply_function(
        "sin", shift
    ) * apply_function("sin", turned)
    phi = factor * R**beta * cosine
    eta = ONE if cutoff is None else pos(1 - (R / cutoff) ** 2, 4)
    # Delta (phi eta) = 2 phi_r eta_r + phi (eta_rr + eta_r / r), as Delta phi = 0
    phi_r = derivative(phi, "r")
    eta_r = derivative(eta, "r")
    laplacian = 2 * phi_r * eta_r + phi * (derivative(eta_r, "r") + eta_r / R)
    return phi * eta, phi_r * eta + phi * eta_r, derivative(phi, "theta") / R * eta, laplacian


def make_harmonic_atom(
    polygon: Polygon,
    side: int,
    t: float,
    alpha: Fraction,
    cutoff: Expression | None = None,
    times: Expression = ONE,
) -> PolarAtom:
    """The atom with flux times * s_+^alpha on its side: C rho^(1+alpha) cos((1+alpha)(pi - theta)).

    C = 1 / ((1 + alpha) sin(alpha pi)), alpha > -1 not an integer. Raises InputError for other alpha,
    and where it has no cutoff and Omega reaches behind its side, so that theta would not be unique.
    """
    if alpha.denominator == 1 or alpha <= -1:
        raise InputError(f"a harmonic atom needs alpha > -1 that is not an integer, not {alpha}")
    # At theta = 0 lambda = -(dv/dtheta)/r = C (1 + alpha) sin(alpha pi) rho^alpha
    factor = times / ((1 + alpha) * apply_function("sin", alpha * PI))
    atom = PolarAtom(polygon, side, t, 1 + alpha, Fraction(1), factor, cutoff)
    if cutoff is None and np.any(atom.local_coordinates(polygon.vertices)[1] < -SIDE_TOLERANCE):
        raise InputError(f"a harmonic atom on side {side} of '{polygon.name}' needs a cutoff")
    return atom


def make_corner_atom(
    polygon: Polygon,
    side: int,
    kind: str,
    alpha: Fraction | None = None,
    cutoff: Expression | None = None,
    times: Expression = ONE,
) -> PolarAtom:
    """An atom at the vertex of angle omega at which the side begins, by its kind.

    `free`: rho^(pi/omega) cos(pi theta/omega), without flux on both sides. `held`:
    -rho^(pi/omega) sin(pi theta/omega), without trace, lambda = (pi/omega) rho^(pi/omega - 1) on both.
    `transition`: lambda = rho^alpha on the side that begins there and 0 on the one before.
    `clamped`: u = 0 on the side before. On the one that begins there lambda = rho^alpha or, without alpha, 0,
    and u is rho^(pi/(2 omega)) cos(pi theta/(2 omega)).
    Raises InputError where omega is no simple fraction of pi, or lambda would need a logarithm.
    """
    omega = Fraction(polygon.angles[side] / np.pi).limit_denominator(MAX_DENOMINATOR)
    if abs(float(omega) * np.pi - polygon.angles[side]) > SIDE_TOLERANCE:
        raise InputError(
            f"the angle at vertex {side} of '{polygon.name}' is no fraction of pi with a denominator of at "
            f"most {MAX_DENOMINATOR}; an atom at a vertex needs such an angle"
        )
    beta, theta_0, factor = _corner_function(kind, omega, alpha)
    is_clamped = kind == "clamped"
    return PolarAtom(polygon, side, 0.0, beta, theta_0, times * factor, cutoff, omega, clamped=is_clamped)


def _corner_function(
    kind: str, omega: Fraction, alpha: Fraction | None
) -> tuple[Fraction, Fraction, Expression]:
    """beta, theta_0 and C of C rho^beta cos(beta (theta - theta_0)), by kind; angles are in units of pi.

    The kinds, and the errors raised, are those of `make_corner_atom`.
    """
    # beta omega = 1 without flux (theta_0 = 0) or trace (theta_0 = omega / 2) on both sides
    if kind == "free":
        return 1 / omega, Fraction(0), ONE
    if kind == "held":
        return 1 / omega, omega / 2, -ONE
    if kind == "clamped":
        beta = 1 / (2 * omega) if alpha is None else 1 + alpha
        if alpha is not None and ((beta * omega).denominator == 2 or alpha <= -1):
            raise InputError(
                f"at a clamped side lambda needs alpha > -1, (1 + alpha) omega/pi - 1/2 no integer, not "
                f"{alpha}"
            )
        # u = 0 at theta = omega: beta (omega - theta_0) = 1/2. Without alpha this makes theta_0 = 0: no flux
        theta_0 = omega - 1 / (2 * beta)
        return beta, theta_0, ONE if alpha is None else 1 / (beta * apply_function("cos", beta * omega * PI))
    if alpha is None or ((1 + alpha) * omega).denominator == 1 or alpha <= -1:
        raise InputError(
            f"a transition at a vertex needs alpha > -1, (1 + alpha) omega/pi no integer, not {alpha}"
        )
    # no flux at theta = omega = theta_0; lambda = -(du/dtheta)/r = rho^alpha at theta = 0
    beta = 1 + alpha
    return beta, omega, -1 / (beta * apply_function("sin", beta * omega * PI))
