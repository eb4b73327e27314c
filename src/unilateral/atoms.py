"""Atoms: the building blocks of manufactured solutions, each with a known trace, flux and regularity.

Three kinds. A *polar* atom is c rho^beta cos(beta (theta - theta_0)), harmonic, times a smooth radial
cutoff, in polar coordinates about a point of the boundary; a *tensor* atom is -d l(t) chi(d), in
coordinates along a side and away from it; a *smooth* atom is a formula in x, y. Lengths are in units
of the side's length L and values in units of L, so that an atom's flux does not depend on L:
u = L v(x / L), and -Delta u + u = (-Delta v) / L + L v.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy
from numpy.typing import NDArray

from unilateral.errors import InputError
from unilateral.expression import Compiled, compile_numpy, kinks, pos
from unilateral.polygon import Polygon

Array = NDArray[np.float64]
ON_SIDE = 1e-12
R, THETA, T, D, X, Y = (sympy.Symbol(name, real=True) for name in ("r", "theta", "t", "d", "x", "y"))


@dataclass(frozen=True)
class Kink:
    """A curve {level = 0} across which u is only finitely smooth.

    |grad level| = 1. `radius` > 0: the circle about `centre`; 0: the line through `centre` along `tangent`.
    """

    centre: tuple[float, float]
    radius: float = 0.0
    tangent: tuple[float, float] = (1.0, 0.0)

    def level(self, points: Array) -> Array:
        """(k,) signed distances of the points (k, 2) from the curve."""
        moved = points - np.array(self.centre)
        if self.radius:
            return np.hypot(moved[:, 0], moved[:, 1]) - self.radius
        return moved[:, 0] * self.tangent[1] - moved[:, 1] * self.tangent[0]


@dataclass(frozen=True)
class Singular:
    """A boundary point at which functions behave like r to the power of multiples of 1 / `grading`."""

    side: int
    t: float
    grading: int


@dataclass(frozen=True, eq=False)
class Smooth:
    """A formula in x, y; the case's `u` where no atom is needed."""

    u: sympy.Expr
    in_H2: bool = field(default=True, init=False)
    lipschitz: bool = field(default=True, init=False)

    @cached_property
    def _values(self) -> tuple[Compiled, Compiled]:
        du = [sympy.diff(self.u, X), sympy.diff(self.u, Y)]
        return compile_numpy([self.u, *du], (X, Y)), compile_numpy(
            [self.u - sympy.diff(du[0], X) - sympy.diff(du[1], Y)], (X, Y)
        )

    def value_and_gradient(self, points: Array) -> tuple[Array, Array]:
        """(k,) values and (k, 2) gradients at the points (k, 2)."""
        value, dx, dy = self._values[0](points[:, 0], points[:, 1])
        return value, np.column_stack([dx, dy])

    def source(self, points: Array) -> Array:
        """(k,) values of -Delta u + u."""
        return self._values[1](points[:, 0], points[:, 1])[0]

    def own_side(self) -> int | None:
        return None

    def kinks(self) -> list[Kink]:
        return []

    def singular(self) -> list[Singular]:
        return []


@dataclass(frozen=True, eq=False)
class Local:
    """What polar and tensor atoms share: a frame at the point `t` (in side lengths) of a side."""

    polygon: Polygon
    side: int
    t: float

    @property
    def length(self) -> float:
        return float(self.polygon.lengths[self.side])

    @cached_property
    def centre(self) -> Array:
        return self.polygon.at(np.array([self.side]), np.array([self.t * self.length]))[0]

    @cached_property
    def frame(self) -> Array:
        """(2, 2): rows the side's direction and its inward normal."""
        return np.stack([self.polygon.tangents[self.side], -self.polygon.normals[self.side]])

    def local(self, points: Array) -> tuple[Array, Array]:
        """Coordinates (k,), (k,) of the points along the side from the centre and into Omega."""
        x, y = (points[:, i] - self.centre[i] for i in range(2))
        along, into = self.frame / self.length
        return x * along[0] + y * along[1], x * into[0] + y * into[1]

    def own_side(self) -> int | None:
        return self.side


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

    def _inside(self, r: Array) -> NDArray[np.intp]:
        limit = np.inf if self.cutoff is None else float(self.cutoff)
        return np.flatnonzero((r < limit) & (r > 0))

    def value_and_gradient(self, points: Array) -> tuple[Array, Array]:
        r, theta = self._polar(points)
        inside = self._inside(r)
        value, gradient = np.zeros(len(r)), np.zeros((len(r), 2))
        v, v_r, v_theta = self._values[0](r[inside], theta[inside])
        cos, sin = np.cos(theta[inside]), np.sin(theta[inside])
        value[inside] = self.length * v
        along, into = v_r * cos - v_theta * sin, v_r * sin + v_theta * cos
        gradient[inside] = np.column_stack([along, into]) @ self.frame
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


@dataclass(frozen=True, eq=False)
class Tensor(Local):
    """-d l(t) (1 - (d / cutoff)^2)_+^4, d the distance to the side in side lengths, l in H2."""

    profile: sympy.Expr
    cutoff: sympy.Expr
    in_H2: bool = field(default=True, init=False)
    lipschitz: bool = field(default=True, init=False)

    @cached_property
    def _values(self) -> tuple[Compiled, Compiled]:
        v = -D * self.profile * pos(1 - (D / self.cutoff) ** 2, 4)
        laplacian = sympy.diff(v, T, 2) + sympy.diff(v, D, 2)
        scale = sympy.Float(self.length, 17)
        return compile_numpy([v, sympy.diff(v, T), sympy.diff(v, D)], (T, D)), compile_numpy(
            [scale * v - laplacian / scale], (T, D)
        )

    def value_and_gradient(self, points: Array) -> tuple[Array, Array]:
        v, v_t, v_d = self._values[0](*self.local(points))
        return self.length * v, np.column_stack([v_t, v_d]) @ self.frame

    def source(self, points: Array) -> Array:
        return self._values[1](*self.local(points))[0]

    def trace_and_flux(self, t: Array) -> tuple[Array, Array]:
        v, _, v_d = self._values[0](t, np.zeros_like(t))
        return self.length * v, -v_d

    @cached_property
    def _profile_kinks(self) -> list[tuple[float, sympy.Expr]]:
        return kinks(self.profile, T)

    def kinks(self) -> list[Kink]:
        along, into = self.frame[0], self.frame[1]
        middle = self.centre + 0.5 * self.length * along
        lines = [Kink(tuple(middle + float(self.cutoff) * self.length * into), 0.0, tuple(along))]
        for t, _ in self._profile_kinks:
            lines.append(Kink(tuple(self.centre + t * self.length * along), 0.0, tuple(into)))
        return lines

    def singular(self) -> list[Singular]:
        return [Singular(self.side, t, int(k.q)) for t, k in self._profile_kinks if 0 < t < 1]


Atom = Smooth | Polar | Tensor


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
