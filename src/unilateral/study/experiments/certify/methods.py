"""Solutions of a case by other methods, linear on triangles: what another program may hand in.

Matrices and loads are scikit-fem's. On clamped sides each solution has the given values at nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.linalg import spsolve
from skfem.models.poisson import laplace, mass

from unilateral.arrays import Array, Mask
from unilateral.geometry.mesh import Mesh
from unilateral.norms.reference import boundary_facets
from unilateral.problems.case import Case

DEGREE = 8
"""Of the quadrature of f."""
ROUNDS = 100
"""The most active sets; a dozen are enough."""


@dataclass(frozen=True, eq=False)
class NodalProblem:
    """Find x >= obstacle with r = Ax - load >= 0 and r.(x - obstacle) = 0 at unknowns that are not fixed.

    `obstacle` (n,) is -inf where x is not constrained, and the value of x where it is `fixed` (n,).
    """

    A: sp.csr_array
    load: Array
    obstacle: Array
    fixed: Mask

    def gap(self, x: Array) -> Array:
        """(n,) x - obstacle, infinite where there is no constraint."""
        return np.where(self.fixed, np.inf, x - self.obstacle)

    def solved(self, matrix: sp.csr_array, load: Array, known: Mask) -> Array:
        """(n,) the solution of a linear system that is the obstacle where it is `known` (n,)."""
        x = np.where(known, self.obstacle, 0.0)
        x[~known] = spsolve(matrix[~known][:, ~known].tocsc(), (load - matrix @ x)[~known])
        return x


def nodal_problem(case: Case, mesh: Mesh, element: skfem.Element) -> NodalProblem:
    """A case with u >= g at the element's boundary unknowns: nodes, and for P2 the midpoints of edges."""
    of_skfem = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    basis = skfem.Basis(of_skfem, element, intorder=DEGREE)
    A = laplace.assemble(basis) + case.reaction * mass.assemble(basis)

    @skfem.LinearForm
    def load(v: Any, w: Any) -> Any:
        return case.source(w.x.reshape(2, -1).T).reshape(w.x.shape[1:]) * v

    facets, clamped = boundary_facets(of_skfem, mesh), np.isin(mesh.side, case.clamped_sides)
    obstacle, fixed = np.full(basis.N, -np.inf), np.zeros(basis.N, dtype=bool)
    ends = [basis.nodal_dofs[0][nodes] for nodes in (mesh.boundary, np.roll(mesh.boundary, -1))]
    places = [(ends[0], 0.0), (ends[1], 1.0), *((dofs[facets], 0.5) for dofs in basis.facet_dofs)]
    for dofs, part in places:
        s = mesh.s[:-1] + part * np.diff(mesh.s) - mesh.polygon.starts[mesh.side]
        u, _, gap = case.boundary(mesh.side, s)
        np.maximum.at(obstacle, dofs, u - gap)
        fixed[dofs[clamped]] = True
    return NodalProblem(A.tocsr(), load.assemble(basis), obstacle, fixed)


def active_set(of: NodalProblem, solved: Callable[[Mask], Array], active: Callable[[Array], Mask]) -> Array:
    """A semismooth Newton method: `solved` takes an active set to a solution, `active` that to the next set.

    It begins with contact everywhere, and ends where the set stays, or after ROUNDS.
    """
    contact = np.isfinite(of.obstacle) & ~of.fixed
    for _ in range(ROUNDS):
        x, before = solved(contact), contact
        contact = active(x)
        if np.array_equal(contact, before):
            break
    return x


def nodal_constraints(of: NodalProblem) -> Array:
    """x by the primal-dual active set method of Hintermüller, Ito and Kunisch (2002)."""
    # a node is active where its reaction is larger than its gap times the diagonal
    diagonal = of.A.diagonal()
    return active_set(
        of,
        lambda active: of.solved(of.A, of.load, active | of.fixed),
        lambda x: of.A @ x - of.load > diagonal * of.gap(x),
    )


def penalty(of: NodalProblem, mesh: Mesh, gamma: float) -> Array:
    """x with the forces gamma (g - x)_+ per length at nodes in place of the constraint, for P1."""
    # the trapezoidal rule: a node has half of both edges beside it; at the ends of clamped sides x is fixed
    lengths, weights = np.diff(mesh.s), np.zeros(mesh.n_nodes)
    weights[mesh.boundary] = gamma * 0.5 * (lengths + np.roll(lengths, 1))

    def solved(active: Mask) -> Array:
        springs = np.where(active, weights, 0.0)
        force = springs * np.where(active, of.obstacle, 0.0)
        return of.solved((of.A + sp.diags_array(springs)).tocsr(), of.load + force, of.fixed)

    return active_set(of, solved, lambda x: of.gap(x) < 0)


def gauss_seidel(of: NodalProblem, sweeps: int) -> Array:
    """x after some sweeps of the projected Gauss-Seidel iteration, from the obstacle and 0 inside."""
    A, x = of.A, np.where(np.isfinite(of.obstacle), of.obstacle, 0.0)
    diagonal, nodes = A.diagonal(), np.flatnonzero(~of.fixed)
    for node in np.tile(nodes, sweeps):
        row = slice(A.indptr[node], A.indptr[node + 1])
        residual = of.load[node] - A.data[row] @ x[A.indices[row]]
        x[node] = max(x[node] + residual / diagonal[node], of.obstacle[node])
    return x


def others(case: Case, mesh: Mesh, penalties: list[int], sweeps: int) -> dict[str, Array]:
    """(n,) the values at the nodes of each method's solution, by its name."""
    of = nodal_problem(case, mesh, skfem.ElementTriP1())
    of_p2 = nodal_problem(case, mesh, skfem.ElementTriP2())
    return {
        "nodal constraints": nodal_constraints(of),
        "P2, interpolated": nodal_constraints(of_p2)[: mesh.n_nodes],  # scikit-fem numbers the nodes first
        **{f"penalty {factor}/h": penalty(of, mesh, factor / mesh.h) for factor in penalties},
        "stopped early": gauss_seidel(of, sweeps),
        "half the load": nodal_constraints(replace(of, load=of.load / 2)),
    }
