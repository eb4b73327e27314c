"""The energy of a form on P2, and descents to its least value on functions that vanish at some places.

A descent is by conjugate gradients. The preconditioner is the sum of two (`fem.p2`): one for hats, and the
diagonal for the values at nodes and midpoints. A few hats are eliminated; for many there is one symmetric
cycle of multigrid, on the mesh's own levels if it was refined from a coarse one, else on algebraic levels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Mask
from unilateral.fem import linear_systems
from unilateral.fem.edge_matrix import assemble_by_edges
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import ConjugateGradients, approximate_inverse
from unilateral.fem.p2 import QuadraticForm, QuadraticSpace, VanishingFunctions
from unilateral.geometry.mesh import Mesh

if TYPE_CHECKING:
    from unilateral.fem.hierarchy import Hierarchy

MAX_CG_STEPS = 200


@dataclass(frozen=True, eq=False)
class HatMatrix:
    """A (n, n), the matrix of a form on V_h, and the `hierarchy` of the mesh, if its levels are used."""

    A: sp.csr_array
    hierarchy: Hierarchy | None

    def approximate_inverse(self, is_fixed: Mask) -> Callable[[Array], Array]:
        """The map from r (n,) to z (n,), near A^{-1} r on the functions that are 0 where `is_fixed` (n,)."""
        if self.hierarchy:
            from unilateral.solvers.v_cycle import SymmetricCycle

            return SymmetricCycle(self.hierarchy, is_fixed).apply
        free = np.flatnonzero(~is_fixed)
        invert_free = approximate_inverse(self.A[free][:, free].tocsr())

        def invert(r: Array) -> Array:
            """The approximate inverse on the free nodes, 0 at the others."""
            z = np.zeros_like(r)
            z[free] = invert_free(r[free])
            return z

        return invert

    def solve(self, r: Array, weights: Array, max_residual_square: float) -> Array:
        """x (n,) with A x = r, up to a residual with sum r_i^2 / weights_i of at most that square."""
        if r @ (r / weights) <= max_residual_square:
            return np.zeros_like(r)
        run = ConjugateGradients(
            self.A.__matmul__, r.copy(), self.approximate_inverse(np.zeros(len(r), dtype=bool))
        )
        steps = 0
        while run.r @ (run.r / weights) > max_residual_square and steps < MAX_CG_STEPS and run.rz > 0:
            run.step()
            steps += 1
        return run.x


def build_hat_matrix(mesh: Mesh, form: Form) -> HatMatrix:
    """The matrix of a form on a mesh; nodes on clamped sides are decoupled."""
    few = linear_systems.MAX_FACTORISED_UNKNOWNS
    if mesh.n_nodes > few and mesh.steps and (mesh.coarse or mesh).n_nodes <= few:
        from unilateral.fem.hierarchy import build_hierarchy  # and with it PyAMG

        hierarchy = build_hierarchy(mesh, form=form)
        return HatMatrix(hierarchy.A, hierarchy)
    clamped_nodes = form.clamped_nodes(mesh)
    return HatMatrix(assemble_by_edges(mesh.triangulation, mesh.points, form, clamped_nodes)[0], None)


def start_descent(
    spaces: QuadraticSpace,
    quadratic_form: QuadraticForm,
    hat_matrix: HatMatrix,
    r: Array,
    functions: VanishingFunctions,
) -> ConjugateGradients:
    """The descent to the v with the least v . A v - 2 b . v, for changes of v among the `functions`.

    `r` (size,) is what the first v leaves of b; it is overwritten. A is the matrix of the `quadratic_form`,
    and `hat_matrix` is that of an equivalent form on V_h.
    """
    invert_hats = hat_matrix.approximate_inverse(functions.is_fixed[: spaces.mesh.n_nodes])
    fixed = np.flatnonzero(functions.is_fixed)
    nodal_squares = quadratic_form.nodal_squares

    def precondition(r: Array) -> Array:
        """The sum of an inverse for values at free nodes and midpoints, and of one for hats."""
        z = spaces.subtract_bubbles(r)
        z /= nodal_squares
        z[fixed] = 0.0
        z = spaces.subtract_hats(z)
        functions.add_hats(z, invert_hats(functions.restrict_to_hats(r)))
        return z

    return ConjugateGradients(quadratic_form.apply, r, precondition)
