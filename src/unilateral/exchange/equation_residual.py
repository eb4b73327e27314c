"""What u leaves of the equation (u, v)_1 = (f, v) on V_h, in the dual norm of V_h: an error of u in H1.

If c = 0, (grad u, grad v) takes the place of (u, v)_1. Functions v vanish on clamped sides, where u is what
was handed in. On functions v that are 0 on the boundary it is what a linear solver left. On the others it is
what a multiplier of the same discrete problem has to be, exactly: discretisation errors are no part of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem
from unilateral.fem.p1 import load_vector, of_rest, stiffness_and_mass
from unilateral.problems.case import ExactSolution

NAMES = {True: ("(u, v)_1", "H1"), False: ("(grad u, grad v)", "|.|_1")}
"""What the form and its norm are called, by whether it has a reaction term."""


class Fit(NamedTuple):
    """The `factor` for which factor times the right load is nearest to a load.

    `left` is how far it is then, in the dual norm, and `size` is the norm of the right load.
    """

    factor: float
    left: float
    size: float

    @property
    def misfit(self) -> float:
        """How far the load is from the right one."""
        return math.hypot(self.left, (self.factor - 1) * self.size)


@dataclass(frozen=True, eq=False)
class Residual:
    """The residual of u (n,) on a `discrete` problem, with a `load` (n,), which fixed nodes do not use."""

    discrete: CondensedProblem
    u: Array
    load: Array

    @property
    def names(self) -> tuple[str, str]:
        """What the form and its norm are called."""
        return NAMES[self.discrete.form.c > 0]

    @cached_property
    def values(self) -> Array:
        """A u - f (n,), 0 at fixed nodes."""
        return -of_rest(self.discrete.mesh, self.discrete.form, self.load, self.u)

    @cached_property
    def trace(self) -> Array:
        """(nb,) what u is on the boundary without a multiplier: A^{-1} f, and u itself at fixed nodes."""
        condensed = self.discrete.spaces.condensed
        mesh = self.discrete.mesh
        held = np.where(condensed.fixed, self.u, 0.0)
        free = condensed.solve(of_rest(mesh, condensed.form, self.load, held))
        return np.asarray((held + free)[mesh.boundary])

    @cached_property
    def boundary(self) -> Array:
        """(nb,) <lambda_h, phi_j> of the multiplier that u's boundary values have: A_3 (u - A^{-1} f)."""
        A_3 = self.discrete.spaces.condensed.A_3
        return np.asarray(A_3 @ (self.u[self.discrete.mesh.boundary] - self.trace))

    def nearer_to(self, load: Array) -> Array:
        """(nb,) `boundary` or the reactions A u - f, whichever is nearer to `load`.

        They differ by what is left inside.
        """
        reactions = self.values[self.discrete.mesh.boundary]
        return min((self.boundary, reactions), key=lambda right: self.norm(load - right))

    @cached_property
    def inside(self) -> float:
        """The dual norm of the residual over the v of V_h that are 0 on the boundary."""
        return self.size(self.values)

    def size(self, load: Array) -> float:
        """The dual norm of a load (n,) over the v of V_h that are 0 on the boundary."""
        return math.sqrt(max(float(self._inner(load[:, None])[0, 0]), 0.0))

    def whole(self, mu: Array | None) -> float:
        """The dual norm over V_h of what is left beside a boundary load mu (nb,); without it `inside`."""
        return self.inside if mu is None else math.hypot(self.inside, self.norm(self.boundary - mu))

    def plus(self, load: Array) -> Residual:
        """The residual with another load (n,) added to that of u's equation."""
        return replace(self, load=self.load + load)

    def share(self, signature: Array) -> float:
        """The factor by which a signature (n,) is nearest to what is left inside; 0 for one that is 0."""
        products = self._inner(np.column_stack([self.values, signature]))
        return float(products[0, 1] / products[1, 1]) if products[1, 1] > 0 else 0.0

    def _inner(self, loads: Array) -> Array:
        """(k, k) products of loads (n, k) in the norm of `size`, by A^{-1} in place of A_II^{-1}."""
        condensed = self.discrete.spaces.condensed
        boundary = self.discrete.mesh.boundary
        inner = loads.copy()
        inner[boundary] = 0.0
        x = condensed.solve(inner)
        return np.asarray(inner.T @ x - x[boundary].T @ (condensed.A_3 @ x[boundary]))

    def worst(self) -> tuple[float, ...]:
        """The place of the inner node at which the equation holds least."""
        of_node = np.abs(self.values) / np.sqrt(self.discrete.spaces.condensed.A.diagonal())
        of_node[self.discrete.mesh.boundary] = 0.0
        return tuple(self.discrete.mesh.points[of_node.argmax()].tolist())

    def norm(self, load: Array) -> float:
        """The dual norm over V_h of a boundary load (nb,): ||mu||_{-1/2,h}."""
        return math.sqrt(max(self.product(load, load), 0.0))

    def product(self, one: Array, other: Array) -> float:
        """The product of boundary loads (nb,) from which `norm` comes."""
        condensed = self.discrete.spaces.condensed
        free = np.where(condensed.fixed[condensed.mesh.boundary], 0.0, other)
        return float(one @ condensed.solve_boundary(free))

    def fitted(self, load: Array, right: Array) -> Fit:
        """The multiple of the right load, by 0 if that is 0, that is nearest to a boundary load (nb,)."""
        square = self.product(right, right)
        factor = self.product(load, right) / square if square > 0 else 0.0
        return Fit(factor, self.norm(load - factor * right), math.sqrt(max(square, 0.0)))


def loads(exact: ExactSolution, discrete: CondensedProblem) -> Iterator[tuple[str, Array]]:
    """Loads (n,) that a right solver may have: the exported one, and f by simple rules, with their names."""
    mesh = discrete.mesh
    yield "", discrete.load
    mass = stiffness_and_mass(mesh)[1]
    corners = mesh.triangles
    f = exact.source(mesh.points)
    yield "interpolated at the nodes", mass @ f
    yield "at the nodes with the lumped mass matrix", mass.sum(axis=1) * f
    middle = exact.source(mesh.points[corners].mean(axis=1))
    yield "at the centroids", load_vector(mesh, np.repeat((mesh.areas * middle / 3)[:, None], 3, axis=1))
    ends = mesh.points[np.roll(corners, 1, axis=1)] + mesh.points[corners]
    on_edges = exact.source(ends.reshape(-1, 2) / 2).reshape(-1, 3)
    of_corner = on_edges + np.roll(on_edges, -1, axis=1)
    yield "at the midpoints of the edges", load_vector(mesh, mesh.areas[:, None] / 6 * of_corner)


def flux_load(discrete: CondensedProblem) -> Array:
    """<lambda, phi_j> (nb,) of a case's lambda."""
    assert discrete.exact is not None
    return discrete.exact.ritz.flux_load
