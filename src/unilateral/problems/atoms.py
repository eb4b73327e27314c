"""Atoms: the building blocks of manufactured solutions, each with a known trace, flux and regularity.

A *smooth* atom is a formula in x, y; a *tensor* atom is -d l(t) chi(d), in coordinates along a side and
away from it; the *polar* ones have their own module. Lengths are in units of the side's length L and values
in units of L, so that an atom's flux does not depend on L: u = L v(x / L), and
-Delta u + u = (-Delta v) / L + L v.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.formulas.derivative import derivative
from unilateral.formulas.exact_numbers import pos, rounded
from unilateral.formulas.expression import Expression, variable
from unilateral.formulas.formula import Compiled, compile_numpy, kinks
from unilateral.formulas.taylor import Model, by_part, number
from unilateral.formulas.taylor_enclosures import evaluate
from unilateral.geometry.curves import Kink, Singular
from unilateral.geometry.polygon import Polygon

ON_SIDE = 1e-12
"""A point counts as on a side up to this distance from it, in side lengths."""
T = variable("t")
D = variable("d")
X = variable("x")
Y = variable("y")


class Along(NamedTuple):
    """Points (k,) of a side, `t` = `anchor` + `offset` in side lengths; the sum rounds, the parts do not."""

    t: Array
    anchor: Array
    offset: Array

    def minus(self, t: float) -> Array:
        """The signed distance from the point t, exact near it if the anchors are that point."""
        return (self.anchor - t) + self.offset


class Regularity(NamedTuple):
    """What holds for an atom: u is in H2, and Lipschitz on the sides; lambda is in L2, and bounded.

    `finite`: contact has finitely many ends.
    """

    in_H2: bool = True
    lipschitz: bool = True
    flux_in_L2: bool = True
    flux_bounded: bool = True
    finite: bool = True


def laplacian(u: Expression, x: str, y: str) -> Expression:
    """The sum of the second derivatives of u by two variables."""
    return derivative(derivative(u, x), x) + derivative(derivative(u, y), y)


class OfFormulas(ABC):
    """An atom that is given by formulas."""

    @property
    @abstractmethod
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        """u and its two derivatives, and -Delta u + u, in two variables."""

    @cached_property
    def _values(self) -> tuple[Compiled, Compiled]:
        formulas, variables = self._formulas
        return compile_numpy(formulas[:3], variables), compile_numpy(formulas, variables)

    @abstractmethod
    def _at(self, formulas: Compiled, points: Array, offset: Array | float) -> tuple[Array, ...]:
        """The values of all formulas or the first three at points + offset (k, 2), with gradients (k, 2)."""

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """(k,) values and (k, 2) gradients at the places points + offset (k, 2)."""
        value, gradient = self._at(self._values[0], points, offset)
        return value, gradient

    def whole(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array, Array]:
        """What `value_and_gradient` returns, and (k,) values of -Delta u + u."""
        value, gradient, f = self._at(self._values[1], points, offset)
        return value, gradient, f


@dataclass(frozen=True, eq=False)
class Smooth(OfFormulas):
    """A formula in x, y; the case's `u` where no atom is needed."""

    u: Expression
    regularity = Regularity()

    @cached_property
    def _f(self) -> Expression:
        return self.u - laplacian(self.u, "x", "y")

    @property
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        return [self.u, derivative(self.u, "x"), derivative(self.u, "y"), self._f], ("x", "y")

    def value_model(self, x: Model, y: Model) -> Model:
        """u on the boxes of x and y."""
        return evaluate(self.u, {"x": x, "y": y})

    def source_model(self, x: Model, y: Model) -> Model:
        """-Delta u + u on the boxes of x and y."""
        return evaluate(self._f, {"x": x, "y": y})

    def _at(self, formulas: Compiled, points: Array, offset: Array | float) -> tuple[Array, ...]:
        value, dx, dy, *f = formulas(*(points + offset).T)
        return value, np.column_stack([dx, dy]), *f

    def vanishes(self, centre: Array, radius: Array) -> Mask:
        """(k,) on which of the circles with centres (k, 2) and radii (k,) u is known to be 0."""
        return np.zeros(len(radius), dtype=bool)

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
        return self.polygon.point(self.side, self.t)

    @cached_property
    def frame(self) -> Array:
        """(2, 2): rows the side's direction and its inward normal."""
        return np.stack([self.polygon.tangents[self.side], -self.polygon.normals[self.side]])

    def touches(self, side: int) -> bool:
        """Whether `trace_and_flux` knows the side."""
        return side == self.side

    def local(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """Coordinates (k,), (k,) along the side from the centre and into Omega of points + offset."""
        x, y = ((points - self.centre) + offset).T
        along, into = self.frame / self.length
        return x * along[0] + y * along[1], x * into[0] + y * into[1]

    def local_models(self, x: Model, y: Model) -> tuple[Model, Model]:
        """The coordinates of `local` on the boxes of x and y."""
        x = x + number(x, -self.centre[0])
        y = y + number(y, -self.centre[1])
        (a, b), (c, d) = self.frame / self.length
        return x.scaled(a) + y.scaled(b), x.scaled(c) + y.scaled(d)

    def local_inside(self, points: Array, offset: Array | float) -> tuple[Array, Array]:
        """As `local`, but points that rounding puts outside the side count as inside.

        The reason is that arctan2(-0.0, -1) is -pi.
        """
        along, into = self.local(points, offset)
        return along, np.where(np.abs(into) < ON_SIDE, np.abs(into), into)

    def to_xy(self, along: Array, into: Array) -> Array:
        """(k, 2) vectors from their components along the side and into Omega."""
        return np.column_stack([along * self.frame[0, i] + into * self.frame[1, i] for i in range(2)])

    def polar_to_xy(self, theta: Array, radial: Array, angular: Array) -> Array:
        """(k, 2) vectors from their components away from the centre and across, towards larger theta."""
        cos = np.cos(theta)
        sin = np.sin(theta)
        return self.to_xy(radial * cos - angular * sin, radial * sin + angular * cos)


@dataclass(frozen=True, eq=False)
class Tensor(Local, OfFormulas):
    """-d l(t) (1 - (d / cutoff)^2)_+^4, d the distance to the side in side lengths, l in H2."""

    profile: Expression
    cutoff: Expression
    regularity = Regularity()

    @property
    def _chi(self) -> Expression:
        return pos(1 - (D / self.cutoff) ** 2, 4)

    @cached_property
    def v(self) -> Expression:
        return -D * self.profile * self._chi

    @cached_property
    def _f(self) -> Expression:
        """-Delta v / L + L v. It stays factored: multiplied out, it is enclosed less closely on a mesh."""
        chi_d = derivative(self._chi, "d")
        # -Delta v = l'' d chi + l d (chi'' + 2 chi' / d)
        along = derivative(derivative(self.profile, "t"), "t") * D * self._chi
        across = self.profile * D * (derivative(chi_d, "d") + 2 * chi_d / D)
        length = Fraction(self.length)
        return length * self.v + (along + across) / length

    @property
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        return [self.v, derivative(self.v, "t"), derivative(self.v, "d"), self._f], ("t", "d")

    def value_model(self, x: Model, y: Model) -> Model:
        t, d = self.local_models(x, y)
        return evaluate(self.v, {"t": t, "d": d}).scaled(self.length)

    def source_model(self, x: Model, y: Model) -> Model:
        t, d = self.local_models(x, y)
        profile = evaluate(self.profile, {"t": t}).range
        support = (d.range[0] < rounded(self.cutoff)) & ((profile[0] < 0) | (profile[1] > 0))
        return by_part([(lambda t, d: evaluate(self._f, {"t": t, "d": d}), support)], t, d)

    def _at(self, formulas: Compiled, points: Array, offset: Array | float) -> tuple[Array, ...]:
        v, v_t, v_d, *f = formulas(*self.local(points, offset))
        return self.length * v, self.to_xy(v_t, v_d), *f

    def trace_and_flux(self, side: int, along: Along) -> tuple[Array, Array]:
        """(k,) values of u and of its outward normal derivative on the side."""
        v, _, v_d = self._values[0](along.t, np.zeros_like(along.t))
        return self.length * v, -v_d

    def vanishes(self, centre: Array, radius: Array) -> Mask:
        return self.local(centre)[1] - radius / self.length > rounded(self.cutoff)

    @cached_property
    def _profile_kinks(self) -> list[tuple[float, Fraction]]:
        return kinks(self.profile, "t")

    def kinks(self) -> list[Kink]:
        along = self.frame[0]
        into = self.frame[1]
        middle = self.centre + 0.5 * self.length * along
        lines = [Kink(tuple(middle + rounded(self.cutoff) * self.length * into), 0.0, tuple(along))]
        for t, _ in self._profile_kinks:
            lines.append(Kink(tuple(self.centre + t * self.length * along), 0.0, tuple(into)))
        return lines

    def singular(self) -> list[Singular]:
        return [Singular(self.side, t, k.denominator) for t, k in self._profile_kinks]
