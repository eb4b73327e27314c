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
from unilateral.fem.p1 import load_vector, stiffness_and_mass, subtract_lift_from_load
from unilateral.problems.case import ExactSolution

FORM_AND_NORM_NAMES = {True: ("(u, v)_1", "H1"), False: ("(grad u, grad v)", "|.|_1")}
"""What the form and its norm are called, by whether it has a reaction term."""


class LoadFit(NamedTuple):
    """The `factor` for which factor times the right load is nearest to a load.

    `scaled_distance` is how far it is then, in the dual norm, and `expected_norm` is the norm of the right
    load.
    """

    factor: float
    scaled_distance: float
    expected_norm: float

    @property
    def distance(self) -> float:
        """How far the load is from the right one."""
        return math.hypot(self.scaled_distance, (self.factor - 1) * self.expected_norm)


@dataclass(frozen=True, eq=False)
class Residual:
    """The residual of u (n,) on a `discrete` problem, with a `load` (n,), which fixed nodes do not use."""

    discrete: CondensedProblem
    u: Array
    load: Array

    @property
    def names(self) -> tuple[str, str]:
        """Names of the form and of its norm."""
        return FORM_AND_NORM_NAMES[self.discrete.form.c > 0]

    @cached_property
    def values(self) -> Array:
        """A u - f (n,), 0 at fixed nodes."""
        return -subtract_lift_from_load(self.discrete.mesh, self.discrete.form, self.load, self.u)

    @cached_property
    def unconstrained_trace(self) -> Array:
        """Boundary values (nb,) of u without a multiplier: A^{-1} f, and u itself at fixed nodes."""
        condensed = self.discrete.spaces.condensed
        mesh = self.discrete.mesh
        clamped_values = np.where(condensed.clamped_nodes, self.u, 0.0)
        free = condensed.solve(subtract_lift_from_load(mesh, condensed.form, self.load, clamped_values))
        return np.asarray((clamped_values + free)[mesh.boundary])

    @cached_property
    def boundary_load(self) -> Array:
        """Load <lambda_h, phi_j> (nb,) of the multiplier that belongs to u's boundary values."""
        # A_3 (u - A^{-1} f) with the Schur complement A_3 on the boundary (section 5 of the paper)
        A_3 = self.discrete.spaces.condensed.A_3
        return np.asarray(A_3 @ (self.u[self.discrete.mesh.boundary] - self.unconstrained_trace))

    def choose_boundary_load(self, load: Array) -> Array:
        """The boundary load or the reactions A u - f (nb,), whichever is nearer to another load (nb,)."""
        # they differ by what is left inside
        reactions = self.values[self.discrete.mesh.boundary]
        return min((self.boundary_load, reactions), key=lambda right: self.boundary_dual_norm(load - right))

    @cached_property
    def interior_norm(self) -> float:
        """The dual norm of the residual over the v of V_h that are 0 on the boundary."""
        return self.interior_dual_norm(self.values)

    def interior_dual_norm(self, load: Array) -> float:
        """The dual norm of a load (n,) over the v of V_h that are 0 on the boundary."""
        return math.sqrt(max(float(self._interior_products(load[:, None])[0, 0]), 0.0))

    def total_norm(self, mu: Array | None) -> float:
        """Dual norm over V_h of the residual less a boundary load mu (nb,); without it the interior norm."""
        if mu is None:
            return self.interior_norm
        # functions that are 0 on the boundary are orthogonal to discrete harmonic ones, so squares add up
        return math.hypot(self.interior_norm, self.boundary_dual_norm(self.boundary_load - mu))

    def add_load(self, load: Array) -> Residual:
        """The residual with another load (n,) added to that of u's equation."""
        return replace(self, load=self.load + load)

    def fit_factor(self, signature: Array) -> float:
        """Factor c for which c times a signature (n,) is nearest to the residual inside; 0 if that is 0."""
        products = self._interior_products(np.column_stack([self.values, signature]))
        return float(products[0, 1] / products[1, 1]) if products[1, 1] > 0 else 0.0

    def _interior_products(self, loads: Array) -> Array:
        """Products (k, k) of loads (n, k) in the dual norm over the v of V_h that are 0 on the boundary."""
        condensed = self.discrete.spaces.condensed
        boundary = self.discrete.mesh.boundary
        inner = loads.copy()
        inner[boundary] = 0.0
        # b^T A_II^{-1} b = b^T A^{-1} b - x_B^T A_3 x_B with x = A^{-1} b, as A and not A_II is factorised
        x = condensed.solve(inner)
        return np.asarray(inner.T @ x - x[boundary].T @ (condensed.A_3 @ x[boundary]))

    def find_worst_place(self) -> tuple[float, ...]:
        """The place of the inner node at which the equation holds least."""
        # |r_j| / A_jj^{1/2} is the dual norm over the multiples of one hat
        scaled_residual = np.abs(self.values) / np.sqrt(self.discrete.spaces.condensed.A.diagonal())
        scaled_residual[self.discrete.mesh.boundary] = 0.0
        return tuple(self.discrete.mesh.points[scaled_residual.argmax()].tolist())

    def boundary_dual_norm(self, load: Array) -> float:
        """The dual norm over V_h of a boundary load (nb,): ||mu||_{-1/2,h}."""
        return math.sqrt(max(self.boundary_product(load, load), 0.0))

    def boundary_product(self, first_load: Array, second_load: Array) -> float:
        """The product of boundary loads (nb,) from which `boundary_dual_norm` comes."""
        # l_1 . A_3^{-1} l_2; loads at clamped nodes act on no v
        condensed = self.discrete.spaces.condensed
        unclamped_load = np.where(condensed.clamped_nodes[condensed.mesh.boundary], 0.0, second_load)
        return float(first_load @ condensed.solve_boundary(unclamped_load))

    def fit_multiple(self, load: Array, expected_load: Array) -> LoadFit:
        """Fit of the multiple of the right load, 0 if that is 0, that is nearest to a boundary load (nb,)."""
        # least squares: factor = (l, l_expected) / (l_expected, l_expected) in the dual product
        square = self.boundary_product(expected_load, expected_load)
        factor = self.boundary_product(load, expected_load) / square if square > 0 else 0.0
        return LoadFit(
            factor, self.boundary_dual_norm(load - factor * expected_load), math.sqrt(max(square, 0.0))
        )


def list_candidate_loads(exact: ExactSolution, discrete: CondensedProblem) -> Iterator[tuple[str, Array]]:
    """Loads (n,) that a right solver may have: the exported one, and f by simple rules, with their names."""
    mesh = discrete.mesh
    yield "", discrete.load
    mass = stiffness_and_mass(mesh)[1]
    corners = mesh.triangles
    f = exact.source(mesh.points)
    yield "interpolated at the nodes", mass @ f
    yield "at the nodes with the lumped mass matrix", mass.sum(axis=1) * f
    # one point: |T| f(centroid) / 3 at each corner
    middle = exact.source(mesh.points[corners].mean(axis=1))
    yield "at the centroids", load_vector(mesh, np.repeat((mesh.areas * middle / 3)[:, None], 3, axis=1))
    # midpoints of edges: |T|/3 times f phi, where phi is 1/2 on the two edges at its corner
    end_sums = mesh.points[np.roll(corners, 1, axis=1)] + mesh.points[corners]
    edge_values = exact.source(end_sums.reshape(-1, 2) / 2).reshape(-1, 3)
    corner_sums = edge_values + np.roll(edge_values, -1, axis=1)
    yield "at the midpoints of the edges", load_vector(mesh, mesh.areas[:, None] / 6 * corner_sums)


def exact_multiplier_load(discrete: CondensedProblem) -> Array:
    """Load <lambda, phi_j> (nb,) of a case's exact lambda."""
    assert discrete.exact is not None
    return discrete.exact.ritz.multiplier_load
