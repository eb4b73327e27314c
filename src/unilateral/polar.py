"""Polar atoms: c rho^beta cos(beta (theta - theta_0)), harmonic, times a smooth radial cutoff.

rho and theta are polar coordinates about a point of the boundary, rho in side lengths and theta from the
side's direction into Omega. Values are computed from them, never from x and y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy
from numpy.typing import NDArray

from unilateral.atoms import Array, Kink, Local, Singular
from unilateral.errors import InputError
from unilateral.expression import Compiled, compile_numpy, pos
from unilateral.polygon import Polygon

ON_SIDE = 1e-12
R, THETA = sympy.Symbol("r", real=True), sympy.Symbol("theta", real=True)


@dataclass(frozen=True, eq=False)
class Polar(Local):
    """times * factor rho^beta cos(beta (theta - theta_0)) (1 - (rho / cutoff)^2)_+^4, rho = r / L.

    No cutoff factor where `cutoff` is None.
    """

    beta: sympy.Expr
    theta_0: sympy.Expr
    factor: sympy.Expr
    cutoff: sympy.Expr | None

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

    def _polar(self, points: Array) -> tuple[Array, Array]:
        """rho (k,) and theta (k,) in [0, 2 pi); a rounding error outside the side counts as on it."""
        along, into = self.local(points)
        into = np.where(np.abs(into) < ON_SIDE, np.abs(into), into)  # arctan2(-0.0, -1) is -pi
        theta = np.arctan2(into, along)
        return np.hypot(along, into), np.where(theta < 0, theta + 2 * np.pi, theta)

    def _inside(self, r: Array) -> NDArray[np.intp] | slice:
        """The points (k,) in the support, but for the centre; a slice if these are all."""
        limit = np.inf if self.cutoff is None else float(self.cutoff)
        inside = (r < limit) & (r > 0)
        return slice(None) if inside.all() else np.flatnonzero(inside)

    def value_and_gradient(self, points: Array) -> tuple[Array, Array]:
        r, theta = self._polar(points)
        inside = self._inside(r)
        value, gradient = np.zeros(len(r)), np.zeros((len(r), 2))
        v, v_r, v_theta = self._values[0](r[inside], theta[inside])
        cos, sin = np.cos(theta[inside]), np.sin(theta[inside])
        value[inside] = self.length * v
        gradient[inside] = self.to_xy(v_r * cos - v_theta * sin, v_r * sin + v_theta * cos)
        return value, gradient

    def source(self, points: Array) -> Array:
        r, theta = self._polar(points)
        inside = self._inside(r)
        result = np.zeros(len(r))
        result[inside] = self._values[1](r[inside], theta[inside])[0]
        return result

    def trace_and_flux(self, t: Array) -> tuple[Array, Array]:
        """(k,) values of u and of its outward normal derivative on the own side, from r and theta exactly."""
        r, theta = np.abs(t - self.t), np.where(t < self.t, np.pi, 0.0)
        inside = self._inside(r)
        value, flux = np.zeros(len(r)), np.zeros(len(r))
        v, _, v_theta = self._values[0](r[inside], theta[inside])
        value[inside], flux[inside] = self.length * v, np.where(theta[inside] > 0, v_theta, -v_theta)
        return value, flux

    @property
    def in_H2(self) -> bool:
        return bool(self.beta > 1)

    @property
    def lipschitz(self) -> bool:
        return bool(self.beta >= 1)

    @property
    def flux_in_L2(self) -> bool:
        return bool(self.beta > sympy.Rational(1, 2))

    def kinks(self) -> list[Kink]:
        if self.cutoff is None:
            return []
        return [Kink((self.centre[0], self.centre[1]), float(self.cutoff) * self.length)]

    def singular(self) -> list[Singular]:
        """The centre, and the cutoff's ends on the own side, where only smoothness is lost."""
        points = [Singular(self.side, self.t, int(sympy.Rational(self.beta).q))]
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
