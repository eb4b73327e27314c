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
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh
from unilateral.norms.reference import boundary_facets
from unilateral.problems.case import Case

DEGREE = 8
"""Of the quadrature of f."""
ROUNDS = 100
"""The most active sets that are tried; they are a dozen."""


@dataclass(frozen=True, eq=False)
class NodalProblem:
    """Find x >= obstacle with r = Ax - load >= 0 and r.(x - obstacle) = 0 at unknowns that are not fixed.

    `obstacle` (n,) is -inf where x is not constrained, and the value of x where it is `fixed` (n,).
    """

    A: sp.csr_array
    load: Array
    obstacle: Array
    fixed: Mask

    @property
    def constrained(self) -> Mask:
        return np.isfinite(self.obstacle) & ~self.fixed

    def solved(self, matrix: sp.csr_array, load: Array, held: Mask) -> Array:
        """(n,) the solution of a linear system that is the obstacle where it is `held` or fixed."""
        known = held | self.fixed
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


def active_set(solved: Callable[[Mask], Array], pushed: Callable[[Array], Mask], active: Mask) -> Array:
    """The solution whose active set is the one that it was computed with: a semismooth Newton method.

    `solved` takes a set to a solution, and `pushed` that one to the next set. Raises InputError without end.
    """
    for _ in range(ROUNDS):
        x = solved(active)
        after = pushed(x)
        if np.array_equal(after, active):
            return x
        active = after
    raise InputError(f"certify: there is no active set after {ROUNDS} rounds; take a coarser mesh")


def nodal_constraints(of: NodalProblem) -> Array:
    """x by the primal-dual active set method of Hintermueller, Ito and Kunisch (2003)."""

    def pushed(x: Array) -> Mask:
        # a node is active where the force on it, plus its penetration times the diagonal, is positive
        force = of.A @ x - of.load - of.A.diagonal() * (x - np.where(of.constrained, of.obstacle, 0.0))
        return of.constrained & (force > 0)

    return active_set(lambda active: of.solved(of.A, of.load, active), pushed, of.constrained)


def penalty(of: NodalProblem, mesh: Mesh, case: Case, gamma: float) -> Array:
    """x with the forces gamma (g - x)_+ per length at nodes in place of the constraint, for P1."""
    # the trapezoidal rule gives half of each contact edge to the nodes at its ends
    half = np.where(np.isin(mesh.side, case.clamped_sides), 0.0, 0.5 * np.diff(mesh.s))
    weights = np.zeros(mesh.n_nodes)
    weights[mesh.boundary] = gamma * (half + np.roll(half, 1))
    g = np.where(of.constrained, of.obstacle, 0.0)
    none = np.zeros_like(of.fixed)

    def solved(active: Mask) -> Array:
        on = weights * active
        return of.solved((of.A + sp.diags_array(on)).tocsr(), of.load + on * g, none)

    return active_set(solved, lambda x: of.constrained & (x < g), of.constrained)


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
        **{f"penalty {factor}/h": penalty(of, mesh, case, factor / mesh.h) for factor in penalties},
        "stopped early": gauss_seidel(of, sweeps),
        "half the load": nodal_constraints(replace(of, load=of.load / 2)),
    }
