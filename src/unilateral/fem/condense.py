"""Partial elimination of the interior unknowns (the paper, section 5): A c = g becomes A_3 c'' = g''.

It is done by macro-elements where the mesh was refined often enough, else by sparse elimination.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_solve, solve_triangular
from scipy.sparse.linalg import LinearOperator, eigsh

from unilateral.arrays import Array, Mask
from unilateral.errors import InputError
from unilateral.fem import edge_matrix
from unilateral.fem.form import H1, Form, decoupled, row_sums
from unilateral.fem.linear_systems import Sparse, dissected, last_block
from unilateral.fem.macro_elements import Recursive
from unilateral.fem.p1 import boundary_mass, lumped_mass, stiffness_and_mass
from unilateral.geometry.mesh import Mesh

CONSTANTS = 1e-8
"""Constants have to be solved for with at most this error; guarantees hold up to this rounding of A_3."""
REFINED = 3
"""Macro-elements pay on meshes that were refined at least this often."""


@dataclass(frozen=True, eq=False)
class Condensed:
    """The matrix A (n, n) of a `form` on V_h, factorised, and its condensation to the boundary.

    `A_3` (nb, nb) is the Schur complement on `mesh.boundary`; `cholesky` (nb, nb) is its upper
    triangular factor R with A_3 = R^T R.
    """

    mesh: Mesh
    factors: Sparse | Recursive
    A_3: Array
    cholesky: Array
    form: Form = H1

    @cached_property
    def A(self) -> sp.csr_array:
        """(n, n) the matrix of the form on V_h."""
        return matrix(self.mesh, self.form)

    @cached_property
    def fixed(self) -> Mask:
        """(n,) which nodes are fixed."""
        return self.form.fixed(self.mesh)

    @cached_property
    def mass(self) -> Array:
        """(n,) numbers m_i with sum m_i v_i^2 <= 4 ||v||^2 for all v in V_h, see `residual_rounding`."""
        return self.form.coercivity * lumped_mass(self.mesh)

    @cached_property
    def for_products(self) -> tuple[sp.csr_array, Array]:
        """A (n, n) up to rounding, its rows not sorted, and their sums (n,).

        That is faster to make where the mesh knows its edges.
        """
        if self.mesh.known:
            return edge_matrix.matrix(self.mesh.known, self.mesh.points, self.form, self.fixed)[:2]
        return self.A, row_sums(self.A, self.form.c * lumped_mass(self.mesh), self.fixed)

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs on all nodes, for rhs (n,) or (n, k)."""
        return self.factors.solve(rhs)

    def solve_boundary(self, rhs: Array) -> Array:
        """A_3^{-1} rhs for rhs (nb,) or (nb, k)."""
        return cho_solve((self.cholesky, False), rhs, check_finite=False)

    @cached_property
    def sigma_1(self) -> float:
        """The smallest sigma with (v, w) = sigma <v, w> for all w in V_h: above Steklov's by O(h^2)."""
        mass = boundary_mass(self.mesh)
        size = len(self.mesh.boundary)
        mass = decoupled(mass, fixed := self.fixed[self.mesh.boundary])
        mass.setdiag(np.where(fixed, 0.0, mass.diagonal()))

        def similar(v: Array) -> Array:
            R = self.cholesky
            return solve_triangular(R, mass @ solve_triangular(R, v), trans="T")

        operator = LinearOperator((size, size), matvec=similar, dtype=float)
        return float(1 / eigsh(operator, k=1, v0=np.ones(size), return_eigenvectors=False)[0])


def matrix(mesh: Mesh, form: Form = H1) -> sp.csr_array:
    """A (n, n), the matrix of the form on V_h."""
    stiffness, mass = stiffness_and_mass(mesh)
    return decoupled(form.k * stiffness + form.c * mass, form.fixed(mesh))


def condense(mesh: Mesh, form: Form = H1) -> Condensed:
    """Factorise A on the mesh and condense it to the boundary nodes.

    Raises InputError where c is so small that rounding loses the constants, if no side is clamped.
    """
    if mesh.halvings < REFINED:
        return by_sparse(mesh, dissected(matrix(mesh, form), mesh.boundary), form)
    factors = Recursive(mesh, form)
    _check(mesh, factors, form)
    return Condensed(mesh, factors, factors.A_3, factors.cholesky, form)


def by_sparse(mesh: Mesh, factors: Sparse, form: Form = H1) -> Condensed:
    """The condensation from the factors of A with the boundary last. Raises InputError as `condense` does."""
    _check(mesh, factors, form)
    cholesky = last_block(factors.lu, len(mesh.boundary))
    return Condensed(mesh, factors, cholesky.T @ cholesky, cholesky, form)


def _check(mesh: Mesh, factors: Sparse | Recursive, form: Form) -> None:
    """Raises InputError as `condense`."""
    if not form.clamped:
        check_constants(mesh, form, factors.solve(form.c * lumped_mass(mesh)))


def check_constants(mesh: Mesh, form: Form, u: Array) -> None:
    """Raises InputError unless u, with (u, v) = c (1, v)_0, is 1: where c is small k K + c M loses c M."""
    if not np.max(np.abs(u - 1)) <= CONSTANTS:
        polygon = mesh.polygon
        edge = np.diff(mesh.s).min()
        raise InputError(
            f"polygon '{polygon.name}' of diameter {polygon.diameter:.3g} with boundary edges e down to "
            f"{edge:.3g}: c = {form.c:.3g} is lost in rounding beside k/e^2 = {form.k / edge**2:.3g}, as no "
            "side is clamped; take a larger c, clamp a side, or take longer edges"
        )
