"""The reference spaces of a partition: P2 and BDM1 on one mesh that is graded to the boundary.

The mesh is made for T_H alone, its boundary nodes by `grading`; the triangles grow with the distance from
the boundary.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import div, dot
from skfem.models.poisson import laplace, mass

from unilateral.arrays import Array, Index
from unilateral.fem.condense import check_constants
from unilateral.fem.form import decoupled
from unilateral.fem.linear_systems import elimination_order, factorise, half_solved
from unilateral.fem.poincare import friedrichs
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.grading import EDGES_PER_CELL, boundary_nodes

GROWTH = 0.45
LESS = 1e-3
"""If c = 0 an upper bound on a square is too large by about this part. A smaller one costs digits."""


class Factor(NamedTuple):
    """A symmetric positive definite matrix (n, n), and the order (n,) in which it is eliminated."""

    A: sp.csr_array
    order: Index

    def products(self, F: sp.csc_array) -> Array:
        """(k, k) F^T A^{-1} F for a sparse F (n, k)."""
        half = half_solved(self.A, F, self.order)
        return (half.T @ half).toarray()


@dataclass(frozen=True, eq=False)
class ReferenceSpaces:
    """P2 and BDM1 on `mesh`, with the matrices of (v, w)_1 and of (q, r) + (div q, div r).

    `nodes` (nb, 3) are the unknowns of P2 on each boundary edge: its start, its end, its midpoint;
    `normal` (n_bdm1, 2 nb) takes the values of q.n at the starts and ends of the boundary edges, edge by
    edge, to the unknowns of BDM1; `inner` are the other unknowns of BDM1, with those on clamped edges, where
    q.n is free. Functions of P2 vanish at the unknowns `fixed`, those on these edges.

    If c = 0 the first matrix is that of (grad v, grad w), and the upper bound on the norm rests on

        (||q|| + C ||div q||)^2 <= (1 + LESS) (||q||^2 + C^2 ||div q||^2 / LESS),      C Friedrichs' constant.
    """

    mesh: Mesh
    n_p2: int
    nodes: Index
    p2: Factor
    normal: sp.csr_array
    bdm1: sp.csr_array
    inner: Index
    bdm1_inner: Factor
    fixed: Index
    above: float

    def suprema(self, loads: sp.csc_array) -> Array:
        """(k, k) matrix of the form whose root is sup over P2 of <mu, v> / ||v||, loads (n_p2, k)."""
        kept = np.ones(self.n_p2)
        kept[self.fixed] = 0.0
        return self.p2.products((sp.diags_array(kept) @ loads).tocsc())

    def least_fluxes(self, normal_fluxes: sp.csc_array) -> Array:
        """(k, k) matrix of the form min (||q||^2 + ||div q||^2) over BDM1 with the q.n given (2 nb, k)."""
        q = (self.normal @ normal_fluxes).tocsc()
        response = (self.bdm1 @ q).tocsc()
        direct = (q.T @ response).toarray()
        own = 0.5 * (direct + direct.T) - self.bdm1_inner.products(response.tocsr()[self.inner].tocsc())
        return self.above * own


def reference_spaces(
    partition: Partition,
    singular: Iterable[float] = (),
    edges_per_cell: int = EDGES_PER_CELL,
    clamped: Collection[int] = (),
    reaction: float = 1.0,
) -> ReferenceSpaces:
    """The reference spaces of a partition, refined towards the given arc lengths too, for a form."""
    polygon = partition.polygon
    s = boundary_nodes(partition, singular, edges_per_cell)
    mesh = meshes.with_boundary(polygon, s, GROWTH)
    of_skfem = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    facet = boundary_facets(of_skfem, mesh)
    p2 = skfem.Basis(of_skfem, skfem.ElementTriP2())
    bdm1 = skfem.Basis(of_skfem, skfem.ElementTriBDM1())
    given = ~np.isin(mesh.side, [*clamped])
    inner = np.setdiff1d(np.arange(bdm1.N), bdm1.facet_dofs[:, facet[given]])
    weight = 1.0 if reaction else friedrichs(mesh, tuple(clamped)) ** 2 / LESS
    A = sp.csr_array(hdiv.assemble(bdm1, weight=weight))
    M, start, end = mass.assemble(p2), mesh.boundary, np.roll(mesh.boundary, -1)
    on_edges = np.stack([p2.nodal_dofs[0][start], p2.nodal_dofs[0][end], p2.facet_dofs[0][facet]], axis=1)
    fixed = np.isin(np.arange(p2.N), on_edges[~given])
    matrix = decoupled(sp.csr_array(laplace.assemble(p2) + reaction * M), fixed)
    rank, of_bdm1 = ranks(p2, matrix), np.empty(bdm1.N)
    of_bdm1[bdm1.facet_dofs] = rank[p2.facet_dofs]
    factor = Factor(matrix, np.argsort(rank, kind="stable"))
    if given.all():
        check_constants(mesh, factorise(matrix, factor.order).solve(M.sum(axis=1)[factor.order]))
    return ReferenceSpaces(
        mesh,
        n_p2=p2.N,
        nodes=on_edges,
        p2=factor,
        normal=normal_fluxes(bdm1, mesh, facet),
        bdm1=A,
        inner=inner,
        bdm1_inner=Factor(A[inner][:, inner].tocsr(), np.argsort(of_bdm1[inner], kind="stable")),
        fixed=np.flatnonzero(fixed),
        above=1.0 if reaction else 1 + LESS,
    )


def ranks(p2: skfem.Basis, A: sp.csr_array) -> Array:
    """(n,) in which order the unknowns of P2, with the matrix A (n, n), are eliminated.

    The order comes from a dissection of the nodes alone. An edge goes with the earlier of its ends, so that
    what separates nodes separates edges, too, and in spaces of fluxes the unknowns of edges.
    """
    nodes, rank = p2.nodal_dofs[0], np.empty(p2.N)
    order = elimination_order(A[nodes][:, nodes])
    rank[nodes[order]] = np.arange(len(nodes))
    rank[p2.facet_dofs[0]] = rank[nodes[p2.mesh.facets]].min(axis=0) - 0.5
    return rank


@skfem.BilinearForm
def hdiv(q, r, of):  # type: ignore[no-untyped-def]
    """(q, r) + weight (div q, div r)."""
    return dot(q, r) + of["weight"] * div(q) * div(r)


def boundary_facets(of_skfem: skfem.MeshTri, mesh: Mesh) -> Index:
    """(nb,) skfem's facet of every boundary edge."""
    ends = np.sort([mesh.boundary, np.roll(mesh.boundary, -1)], axis=0)
    candidates = of_skfem.t2f[:, mesh.boundary_triangles]
    at_edge = np.all(of_skfem.facets[:, candidates] == ends[:, None], axis=0)
    return np.asarray(candidates[at_edge.argmax(axis=0), np.arange(len(mesh.boundary))])


def normal_fluxes(space: skfem.Basis, mesh: Mesh, facet: Index) -> sp.csr_array:
    """(n, 2 nb): the unknowns of BDM1 or RT1 with given values of q.n at the ends of the boundary edges."""
    ends = (np.array([[0.0, 1.0]]), np.array([0.5, 0.5]))
    basis = skfem.FacetBasis(space.mesh, space.elem, facets=facet, quadrature=ends)
    unknowns = space.facet_dofs[:, facet]
    values = np.stack(
        [np.sum(np.asarray(shape[0]) * np.asarray(basis.normals), axis=0) for shape in basis.basis]
    )
    local = basis.element_dofs[:, None] == unknowns
    traces = np.einsum("lnp,ldn->npd", values, local.astype(float))
    first = np.asarray(basis.global_coordinates())[:, :, 0].T
    flipped = np.any(np.abs(first - mesh.points[mesh.boundary]) > 0.5 * np.diff(mesh.s)[:, None], axis=1)
    traces[flipped] = traces[flipped, ::-1]
    to_unknowns = np.linalg.inv(traces)
    rows, columns = np.broadcast_arrays(
        unknowns.T[:, :, None], (2 * np.arange(len(facet))[:, None] + np.arange(2))[:, None, :]
    )
    shape = (space.N, 2 * len(facet))
    return sp.coo_array((to_unknowns.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()
