"""Polar atoms: c rho^beta cos(beta (theta - theta_0)), harmonic, times a smooth radial cutoff.

rho and theta are polar coordinates about a point of the boundary, rho in side lengths and theta from the
side's direction into Omega. Values are computed from them, never from x and y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
import sympy

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.elementary import evaluate, real_power
from unilateral.formulas.formula import MAX_DENOMINATOR, Compiled, compile_numpy, pos
from unilateral.formulas.taylor import Model, by_part, number
from unilateral.geometry.curves import Kink, Singular
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import ON_SIDE, Along, Local, Regularity

R, THETA, Q = (sympy.Symbol(name, real=True) for name in ("r", "theta", "q"))


@dataclass(frozen=True, eq=False)
class Polar(Local):
    """times * factor rho^beta cos(beta (theta - theta_0)) (1 - (rho / cutoff)^2)_+^4, rho = r / L.

    No cutoff factor where `cutoff` is None. `omega` is Omega's angle at the centre: pi inside the side, or
    that of the vertex at which the side begins.
    """

    beta: sympy.Expr
    theta_0: sympy.Expr
    factor: sympy.Expr
    cutoff: sympy.Expr | None
    omega: sympy.Expr = sympy.pi

    @cached_property
    def symbolic(self) -> tuple[sympy.Expr, sympy.Expr, sympy.Expr, sympy.Expr]:
        """v, dv/dr, (dv/dtheta)/r and Delta v; the harmonic factor adds nothing to the last."""
        phi = self.factor * R**self.beta * sympy.cos(self.beta * (THETA - self.theta_0))
        eta = sympy.Integer(1) if self.cutoff is None else pos(1 - (R / self.cutoff) ** 2, 4)
        d_phi, d_eta = sympy.diff(phi, R), sympy.diff(eta, R)
        laplacian = 2 * d_phi * d_eta + phi * (sympy.diff(d_eta, R) + d_eta / R)
        return phi * eta, d_phi * eta + phi * d_eta, sympy.diff(phi, THETA) / R * eta, laplacian

    @cached_property
    def _values(self) -> tuple[Compiled, Compiled]:
        v, v_r, v_theta, laplacian = self.symbolic
        scale = sympy.Float(self.length, 17)
        return compile_numpy([v, v_r, v_theta], (R, THETA)), compile_numpy(
            [scale * v - laplacian / scale], (R, THETA)
        )

    def value_model(self, x: Model, y: Model) -> Model:
        """u on the boxes of x and y."""
        return self._in_support(self._value, x, y)

    def source_model(self, x: Model, y: Model) -> Model:
        """-Delta u + u on the boxes of x and y."""
        return self._in_support(self._source, x, y)

    def _in_support(self, of: Callable[[Model, Model], Model], x: Model, y: Model) -> Model:
        along, into = self.local_models(x, y)
        limit = np.inf if self.cutoff is None else float(self.cutoff)
        nearest = (np.maximum(0.0, np.maximum(z.range[0], -z.range[1])) for z in (along, into))
        return by_part([(of, np.hypot(*nearest) < limit)], along, into)

    def _value(self, along: Model, into: Model) -> Model:
        phi, cut_off, _ = self._models(along, into)
        return (phi * cut_off).scaled(self.length)

    def _source(self, along: Model, into: Model) -> Model:
        phi, cut_off, of_laplacian = self._models(along, into)
        return phi * (cut_off.scaled(self.length) + of_laplacian.scaled(-1 / self.length))

    def _models(self, along: Model, into: Model) -> tuple[Model, Model, Model]:
        """The harmonic factor phi of v, the cutoff eta, and Delta v / phi.

        With q = (rho / cutoff)^2, eta = (1 - q)_+^4 and phi_r = beta phi / rho,
        Delta v / phi = (48 q (1 - q)_+^2 - 16 (1 + beta) (1 - q)_+^3) / cutoff^2.
        """
        beta, omega = float(self.beta), float(self.omega)
        phi = real_power(along, into, beta, float(self.theta_0), omega).scaled(float(self.factor))
        if self.cutoff is None:
            return phi, number(along, 1.0), number(along, 0.0)
        q = (along * along + into * into).scaled(float(self.cutoff) ** -2)
        laplacian = (48 * Q * pos(1 - Q, 2) - 16 * (1 + self.beta) * pos(1 - Q, 3)) / self.cutoff**2
        return phi, evaluate(pos(1 - Q, 4), {Q: q}), evaluate(laplacian, {Q: q})

    def _polar(self, points: Array, offset: Array | float) -> tuple[Array, Array]:
        """rho (k,) and theta (k,) in [0, 2 pi)."""
        along, into = self.local_inside(points, offset)
        theta = np.arctan2(into, along)
        return np.hypot(along, into), np.where(theta < 0, theta + 2 * np.pi, theta)

    def _inside(self, r: Array) -> Index | slice:
        """The points (k,) in the support, but for the centre; a slice if these are all."""
        limit = np.inf if self.cutoff is None else float(self.cutoff)
        inside = (r < limit) & (r > 0)
        return slice(None) if inside.all() else np.flatnonzero(inside)

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        r, theta = self._polar(points, offset)
        inside = self._inside(r)
        value, gradient = np.zeros(len(r)), np.zeros((len(r), 2))
        v, v_r, v_theta = self._values[0](r[inside], theta[inside])
        value[inside] = self.length * v
        gradient[inside] = self.polar_to_xy(theta[inside], v_r, v_theta)
        return value, gradient

    def source(self, points: Array, offset: Array | float = 0.0) -> Array:
        r, theta = self._polar(points, offset)
        inside = self._inside(r)
        result = np.zeros(len(r))
        result[inside] = self._values[1](r[inside], theta[inside])[0]
        return result

    @property
    def at_vertex(self) -> bool:
        return self.t == 0

    def touches(self, side: int) -> bool:
        return side == self.side or (self.at_vertex and side == self._before)

    @property
    def _before(self) -> int:
        return (self.side - 1) % self.polygon.n_sides

    def trace_and_flux(self, side: int, along: Along) -> tuple[Array, Array]:
        """(k,) values of u and of its outward normal derivative on the side, from r and theta exactly."""
        if side == self.side:
            distance = along.minus(self.t)
        else:
            distance = along.minus(1.0) * (self.polygon.lengths[side] / self.length)
        r, first = np.abs(distance), distance >= 0
        inside = self._inside(r)
        theta = np.where(first, 0.0, float(self.omega))[inside]
        value, flux = np.zeros(len(r)), np.zeros(len(r))
        v, _, v_theta = self._values[0](r[inside], theta)
        value[inside], flux[inside] = self.length * v, np.where(first[inside], -v_theta, v_theta)
        return value, flux

    @cached_property
    def regularity(self) -> Regularity:
        """On a side u is like cos(beta (theta - theta_0)) rho^beta, lambda like sin(..) rho^(beta - 1)."""
        ends = [self.beta * (theta - self.theta_0) for theta in (0, self.omega)]
        no_trace, no_flux = (
            all(sympy.simplify(of(end)) == 0 for end in ends) for of in (sympy.cos, sympy.sin)
        )
        return Regularity(
            in_H2=bool(self.beta > 1),
            lipschitz=bool(self.beta >= 1) or no_trace,
            flux_in_L2=bool(2 * self.beta > 1),
            flux_bounded=bool(self.beta >= 1) or no_flux,
        )

    def kinks(self) -> list[Kink]:
        if self.cutoff is None:
            return []
        return [Kink((self.centre[0], self.centre[1]), float(self.cutoff) * self.length)]

    def singular(self) -> list[Singular]:
        """The centre, and the cutoff's ends on the own side, where only smoothness is lost."""
        points = [Singular(self.side, self.t, int(sympy.Rational(self.beta).q))]
        if self.at_vertex:
            points.append(Singular(self._before, 1.0, points[0].grading))
        if self.cutoff is not None:
            points += [Singular(self.side, self.t + sign * float(self.cutoff), 1) for sign in (-1, 1)]
        return points


def harmonic(
    polygon: Polygon,
    side: int,
    t: sympy.Expr,
    alpha: sympy.Expr,
    cutoff: sympy.Expr | None = None,
    times: sympy.Expr = sympy.S.One,
) -> Polar:
    """The atom with flux times * s_+^alpha on its side: C rho^(1+alpha) cos((1+alpha)(pi - theta)).

    C = 1 / ((1 + alpha) sin(alpha pi)), alpha > -1 not an integer. Raises InputError for other alpha,
    and where it has no cutoff and Omega reaches behind its side, so that theta would not be unique.
    """
    if alpha.is_integer or alpha <= -1:
        raise InputError(f"a harmonic atom needs alpha > -1 that is not an integer, not {alpha}")
    factor = times / ((1 + alpha) * sympy.sin(alpha * sympy.pi))
    atom = Polar(polygon, side, float(t), 1 + alpha, sympy.pi, factor, cutoff)
    if cutoff is None and np.any(atom.local(polygon.vertices)[1] < -ON_SIDE):
        raise InputError(f"a harmonic atom on side {side} of '{polygon.name}' needs a cutoff")
    return atom


def corner(
    polygon: Polygon,
    side: int,
    kind: str,
    alpha: sympy.Expr | None = None,
    cutoff: sympy.Expr | None = None,
    times: sympy.Expr = sympy.S.One,
) -> Polar:
    """An atom at the vertex of angle omega at which the side begins, by its kind.

    `free`: rho^(pi/omega) cos(pi theta/omega), without flux on both sides. `held`:
    -rho^(pi/omega) sin(pi theta/omega), without trace, lambda = (pi/omega) rho^(pi/omega - 1) on both.
    `transition`: lambda = rho^alpha on the side that begins there and 0 on the one before.
    Raises InputError where omega is no simple fraction of pi, or the transition would need a logarithm.
    """
    share = sympy.Rational(Fraction(polygon.angles[side] / np.pi).limit_denominator(MAX_DENOMINATOR))
    if abs(float(share) * np.pi - polygon.angles[side]) > ON_SIDE:
        raise InputError(
            f"the angle at vertex {side} of '{polygon.name}' is no fraction of pi with a denominator of at "
            f"most {MAX_DENOMINATOR}, as an atom there needs"
        )
    omega = share * sympy.pi
    if kind != "transition":
        beta, theta_0, factor = (1 / share, sympy.S.Zero, 1) if kind == "free" else (1 / share, omega / 2, -1)
    elif alpha is None or ((1 + alpha) * share).is_integer or alpha <= -1:
        raise InputError(
            f"a transition at a vertex needs alpha > -1, (1 + alpha) omega/pi no integer, not {alpha}"
        )
    else:
        beta, theta_0, factor = 1 + alpha, omega, -1 / ((1 + alpha) * sympy.sin(omega * (1 + alpha)))
    return Polar(polygon, side, 0.0, beta, theta_0, times * factor, cutoff, omega)
