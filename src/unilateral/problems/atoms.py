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
from unilateral.formulas.exact_numbers import as_float, pos
from unilateral.formulas.expression import Expression, variable
from unilateral.formulas.formula import CompiledFormulas, compile_numpy, find_kinks
from unilateral.formulas.taylor import TaylorModel, apply_on_subsets, number_model
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.geometry.curves import Kink, SingularPoint
from unilateral.geometry.polygon import Polygon

SIDE_TOLERANCE = 1e-12
"""A point counts as on a side up to this distance from it, in side lengths."""
T = variable("t")
D = variable("d")
X = variable("x")
Y = variable("y")


class SidePoints(NamedTuple):
    """Points (k,) of a side, `t` = `anchor` + `offset` in side lengths; the sum rounds, the parts do not."""

    t: Array
    anchor: Array
    offset: Array

    def distance_from(self, t: float) -> Array:
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


class FormulaAtom(ABC):
    """An atom that is given by formulas."""

    @property
    @abstractmethod
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        """u and its two derivatives, and -Delta u + u, in two variables."""

    @cached_property
    def _compiled_formulas(self) -> tuple[CompiledFormulas, CompiledFormulas]:
        formulas, variables = self._formulas
        return compile_numpy(formulas[:3], variables), compile_numpy(formulas, variables)

    @abstractmethod
    def _evaluate(
        self, formulas: CompiledFormulas, points: Array, offset: Array | float
    ) -> tuple[Array, ...]:
        """The values of all formulas or the first three at points + offset (k, 2), with gradients (k, 2)."""

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """Values (k,) and gradients (k, 2) at points + offset."""
        value, gradient = self._evaluate(self._compiled_formulas[0], points, offset)
        return value, gradient

    def value_gradient_and_source(
        self, points: Array, offset: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Values, gradients and values of -Delta u + u at points + offset."""
        value, gradient, f = self._evaluate(self._compiled_formulas[1], points, offset)
        return value, gradient, f


@dataclass(frozen=True, eq=False)
class SmoothAtom(FormulaAtom):
    """A formula in x, y; the case's `u` where no atom is needed."""

    u: Expression
    regularity = Regularity()

    @cached_property
    def _source(self) -> Expression:
        return self.u - laplacian(self.u, "x", "y")

    @property
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        return [self.u, derivative(self.u, "x"), derivative(self.u, "y"), self._source], ("x", "y")

    def value_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """u on the boxes of x and y."""
        return enclose_formula(self.u, {"x": x, "y": y})

    def source_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """-Delta u + u on the boxes of x and y."""
        return enclose_formula(self._source, {"x": x, "y": y})

    def _evaluate(
        self, formulas: CompiledFormulas, points: Array, offset: Array | float
    ) -> tuple[Array, ...]:
        value, dx, dy, *f = formulas(*(points + offset).T)
        return value, np.column_stack([dx, dy]), *f

    def vanishes_in_circles(self, centre: Array, radius: Array) -> Mask:
        """Whether u is known to be 0 in each circle (k,): never."""
        return np.zeros(len(radius), dtype=bool)

    def kinks(self) -> list[Kink]:
        """No curves: u is smooth in Omega."""
        return []

    def singular_points(self) -> list[SingularPoint]:
        """No points: u is smooth on the boundary."""
        return []


@dataclass(frozen=True, eq=False)
class SideAtom:
    """What polar and tensor atoms share: a frame at the point `t` (in side lengths) of a side."""

    polygon: Polygon
    side: int
    t: float

    @property
    def length(self) -> float:
        """The length L of the side."""
        return float(self.polygon.lengths[self.side])

    @cached_property
    def centre(self) -> Array:
        """The point at which the frame is, (2,)."""
        return self.polygon.point(self.side, self.t)

    @cached_property
    def frame(self) -> Array:
        """The side's direction and its inward normal, the rows of a (2, 2) array."""
        return np.stack([self.polygon.tangents[self.side], -self.polygon.normals[self.side]])

    def touches(self, side: int) -> bool:
        """Whether `trace_and_normal_flux` knows the side."""
        return side == self.side

    def local_coordinates(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """Coordinates (k,), (k,) along the side from the centre and into Omega of points + offset."""
        # In this order: near the centre the offset is exact and the first difference small, or 0
        x, y = ((points - self.centre) + offset).T
        along, into = self.frame / self.length
        return x * along[0] + y * along[1], x * into[0] + y * into[1]

    def local_models(self, x: TaylorModel, y: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
        """The coordinates of `local_coordinates` on the boxes of x and y."""
        x = x + number_model(x, -self.centre[0])
        y = y + number_model(y, -self.centre[1])
        (a, b), (c, d) = self.frame / self.length
        return x.scale(a) + y.scale(b), x.scale(c) + y.scale(d)

    def local_coordinates_inside(self, points: Array, offset: Array | float) -> tuple[Array, Array]:
        """Local coordinates in which points that rounding puts outside the side count as inside.

        The reason is that arctan2(-0.0, -1) is -pi.
        """
        along, into = self.local_coordinates(points, offset)
        return along, np.where(np.abs(into) < SIDE_TOLERANCE, np.abs(into), into)

    def rotate_to_xy(self, along: Array, into: Array) -> Array:
        """Vectors in x and y from their components along the side and into Omega, (k, 2)."""
        return np.column_stack([along * self.frame[0, i] + into * self.frame[1, i] for i in range(2)])

    def rotate_polar_to_xy(self, theta: Array, radial: Array, angular: Array) -> Array:
        """Vectors (k, 2) in x and y from their components towards larger r and towards larger theta."""
        cos = np.cos(theta)
        sin = np.sin(theta)
        return self.rotate_to_xy(radial * cos - angular * sin, radial * sin + angular * cos)


@dataclass(frozen=True, eq=False)
class TensorAtom(SideAtom, FormulaAtom):
    """-d l(t) (1 - (d / cutoff)^2)_+^4, d the distance to the side in side lengths, l in H2."""

    profile: Expression
    cutoff: Expression
    regularity = Regularity()

    @property
    def _chi(self) -> Expression:
        """The cutoff chi(d) = (1 - (d / cutoff)^2)_+^4, in C^3."""
        return pos(1 - (D / self.cutoff) ** 2, 4)

    @cached_property
    def v(self) -> Expression:
        """The formula of the atom in units of the side's length, in t and d."""
        return -D * self.profile * self._chi

    @cached_property
    def _source(self) -> Expression:
        """-Delta v / L + L v. It stays factored: multiplied out, it is enclosed less closely on a mesh."""
        chi_d = derivative(self._chi, "d")
        # -Delta v = l'' d chi + l d (chi'' + 2 chi' / d)
        along = derivative(derivative(self.profile, "t"), "t") * D * self._chi
        across = self.profile * D * (derivative(chi_d, "d") + 2 * chi_d / D)
        length = Fraction(self.length)
        return length * self.v + (along + across) / length

    @property
    def _formulas(self) -> tuple[list[Expression], tuple[str, str]]:
        return [self.v, derivative(self.v, "t"), derivative(self.v, "d"), self._source], ("t", "d")

    def value_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of u on the boxes of x and y."""
        t, d = self.local_models(x, y)
        return enclose_formula(self.v, {"t": t, "d": d}).scale(self.length)

    def source_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of -Delta u + u on the boxes of x and y."""
        t, d = self.local_models(x, y)
        profile = enclose_formula(self.profile, {"t": t}).range
        # The source is 0 beyond the cutoff, and where the profile is known to be 0
        support = (d.range[0] < as_float(self.cutoff)) & ((profile[0] < 0) | (profile[1] > 0))
        return apply_on_subsets(
            [(lambda t, d: enclose_formula(self._source, {"t": t, "d": d}), support)], t, d
        )

    def _evaluate(
        self, formulas: CompiledFormulas, points: Array, offset: Array | float
    ) -> tuple[Array, ...]:
        v, v_t, v_d, *f = formulas(*self.local_coordinates(points, offset))
        return self.length * v, self.rotate_to_xy(v_t, v_d), *f

    def trace_and_normal_flux(self, side: int, along: SidePoints) -> tuple[Array, Array]:
        """Values of u and of its outward normal derivative on the side, (k,) each."""
        # u = L v and du/dn = -dv/dd at d = 0, for d grows into Omega
        v, _, v_d = self._compiled_formulas[0](along.t, np.zeros_like(along.t))
        return self.length * v, -v_d

    def vanishes_in_circles(self, centre: Array, radius: Array) -> Mask:
        """Whether u is known to be 0 in each circle, (k,)."""
        return self.local_coordinates(centre)[1] - radius / self.length > as_float(self.cutoff)

    @cached_property
    def _profile_kinks(self) -> list[tuple[float, Fraction]]:
        return find_kinks(self.profile, "t")

    def kinks(self) -> list[Kink]:
        """The line at which the cutoff ends, and normals at kinks of the profile: u is not smooth there."""
        along = self.frame[0]
        into = self.frame[1]
        middle = self.centre + 0.5 * self.length * along
        lines = [Kink(tuple(middle + as_float(self.cutoff) * self.length * into), 0.0, tuple(along))]
        for t, _ in self._profile_kinks:
            lines.append(Kink(tuple(self.centre + t * self.length * along), 0.0, tuple(into)))
        return lines

    def singular_points(self) -> list[SingularPoint]:
        """The kinks of the profile on the side."""
        return [SingularPoint(self.side, t, k.denominator) for t, k in self._profile_kinks]
