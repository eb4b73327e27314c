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
from unilateral.fem.form import H1, Form, decouple_nodes, decoupled_row_sums
from unilateral.fem.linear_systems import SparseFactors, factorise_by_dissection, schur_factor
from unilateral.fem.macro_elements import MacroElementFactors
from unilateral.fem.p1 import boundary_mass, lumped_mass, stiffness_and_mass
from unilateral.geometry.mesh import Mesh

MAX_CONSTANT_ERROR = 1e-8
"""Constants have to be solved for with at most this error; guarantees hold up to this rounding of A_3."""
MIN_MACRO_HALVINGS = 3
"""Macro-elements pay on meshes that were refined at least this often."""
Factors = SparseFactors | MacroElementFactors


@dataclass(frozen=True, eq=False)
class CondensedMatrix:
    """The matrix A (n, n) of a `form` on V_h, factorised, and its condensation to the boundary.

    `A_3` (nb, nb) is the Schur complement on `mesh.boundary`; `cholesky` (nb, nb) is its upper
    triangular factor R with A_3 = R^T R.
    """

    mesh: Mesh
    factors: Factors
    A_3: Array
    cholesky: Array
    form: Form = H1

    @cached_property
    def A(self) -> sp.csr_array:
        """The matrix of the form on V_h; shape (n, n)."""
        return form_matrix(self.mesh, self.form)

    @cached_property
    def clamped_nodes(self) -> Mask:
        """Whether each node lies on a clamped side; shape (n,)."""
        return self.form.clamped_nodes(self.mesh)

    @cached_property
    def nodal_weights(self) -> Array:
        """Weights m_i (n,) with sum m_i v_i^2 <= 4 ||v||^2 on V_h: lumped masses times the coercivity."""
        return self.form.coercivity * lumped_mass(self.mesh)

    @cached_property
    def matrix_and_row_sums(self) -> tuple[sp.csr_array, Array]:
        """A (n, n) up to rounding, its rows not sorted, and their sums (n,).

        It is assembled from edges where the mesh knows these, which is faster.
        """
        if self.mesh.stored_triangulation:
            return edge_matrix.assemble_by_edges(
                self.mesh.stored_triangulation, self.mesh.points, self.form, self.clamped_nodes
            )[:2]
        return self.A, decoupled_row_sums(self.A, self.form.c * lumped_mass(self.mesh), self.clamped_nodes)

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs on all nodes, for rhs (n,) or (n, k)."""
        return self.factors.solve(rhs)

    def solve_boundary(self, rhs: Array) -> Array:
        """A_3^{-1} rhs for rhs (nb,) or (nb, k)."""
        return cho_solve((self.cholesky, False), rhs, check_finite=False)

    @cached_property
    def sigma_1(self) -> float:
        """The least sigma with (v, w) = sigma <v, w> for a v and all w in V_h: above Steklov's by O(h^2)."""
        clamped = self.clamped_nodes[self.mesh.boundary]
        size = len(clamped)
        # clamped rows of the mass are 0: they give the eigenvalue 0, which is not the largest one below
        mass = decouple_nodes(boundary_mass(self.mesh), clamped)
        mass.setdiag(np.where(clamped, 0.0, mass.diagonal()))

        # A_3 v = sigma M v on the boundary, so 1 / sigma is the largest eigenvalue of R^{-T} M R^{-1}
        def apply_scaled_mass(v: Array) -> Array:
            """R^{-T} M R^{-1} v, for A_3 = R^T R and the mass matrix M of the boundary."""
            R = self.cholesky
            return solve_triangular(R, mass @ solve_triangular(R, v), trans="T")

        scaled_mass = LinearOperator((size, size), matvec=apply_scaled_mass, dtype=float)
        return float(1 / eigsh(scaled_mass, k=1, v0=np.ones(size), return_eigenvectors=False)[0])


def form_matrix(mesh: Mesh, form: Form = H1) -> sp.csr_array:
    """A (n, n), the matrix of the form on V_h."""
    stiffness, mass = stiffness_and_mass(mesh)
    return decouple_nodes(form.k * stiffness + form.c * mass, form.clamped_nodes(mesh))


def condense(mesh: Mesh, form: Form = H1) -> CondensedMatrix:
    """Factorise A on the mesh and condense it to the boundary nodes.

    Raises InputError where c is so small that rounding loses the constants, if no side is clamped.
    """
    if mesh.halvings < MIN_MACRO_HALVINGS:
        return condense_factors(mesh, factorise_by_dissection(form_matrix(mesh, form), mesh.boundary), form)
    return condense_factors(mesh, MacroElementFactors(mesh, form), form)


def condense_factors(mesh: Mesh, factors: Factors, form: Form = H1) -> CondensedMatrix:
    """The condensation from factors of A with the boundary last. Raises InputError as `condense` does."""
    if not form.clamped:
        # the load of c (1, v)_0 has the solution 1
        check_constants(mesh, form, factors.solve(form.c * lumped_mass(mesh)))
    if isinstance(factors, MacroElementFactors):
        return CondensedMatrix(mesh, factors, A_3=factors.A_3, cholesky=factors.cholesky, form=form)
    cholesky = schur_factor(factors.lu, len(mesh.boundary))
    return CondensedMatrix(mesh, factors, A_3=cholesky.T @ cholesky, cholesky=cholesky, form=form)


def check_constants(mesh: Mesh, form: Form, u: Array) -> None:
    """Raises InputError unless u, with (u, v) = c (1, v)_0, is 1: where c is small k K + c M loses c M."""
    if not np.max(np.abs(u - 1)) <= MAX_CONSTANT_ERROR:
        polygon = mesh.polygon
        edge = np.diff(mesh.s).min()
        raise InputError(
            f"polygon '{polygon.name}' of diameter {polygon.diameter:.3g} with boundary edges e down to "
            f"{edge:.3g}: c = {form.c:.3g} is lost in rounding beside k/e^2 = {form.k / edge**2:.3g}, as no "
            "side is clamped; take a larger c, clamp a side, or take longer edges"
        )
