"""The reference spaces of a partition: P2 and BDM1 on one mesh that is graded to the boundary.

The mesh is made for T_H alone, its boundary nodes by `grading`; the triangles grow with the distance from
the boundary.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.models.poisson import laplace, mass

from unilateral.arrays import Array, Index
from unilateral.fem.condense import check_constants
from unilateral.fem.form import H1, Form, decoupled
from unilateral.fem.linear_systems import Factor, elimination_order, factorise
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.grading import EDGES_PER_CELL, boundary_nodes
from unilateral.norms.least_fluxes import LeastFluxes, with_divergence, without_divergence

GROWTH = 0.45


@dataclass(frozen=True, eq=False)
class ReferenceSpaces:
    """P2 and BDM1 on `mesh`: the matrix of the form, and the least energies of fluxes.

    `nodes` (nb, 3) are the unknowns of P2 on each boundary edge: its start, its end, its midpoint. Functions
    vanish at the unknowns `fixed`, those on clamped edges.
    """

    mesh: Mesh
    n_p2: int
    nodes: Index
    p2: Factor
    fixed: Index
    least_fluxes: LeastFluxes

    def suprema(self, loads: sp.csc_array) -> Array:
        """(k, k) matrix of the form whose root is sup over P2 of <mu, v> / ||v||, loads (n_p2, k)."""
        kept = np.ones(self.n_p2)
        kept[self.fixed] = 0.0
        return self.p2.products((sp.diags_array(kept) @ loads).tocsc())


def reference_spaces(
    partition: Partition,
    singular: Iterable[float] = (),
    edges_per_cell: int = EDGES_PER_CELL,
    form: Form = H1,
) -> ReferenceSpaces:
    """The reference spaces of a partition, refined towards the given arc lengths too, for a form."""
    polygon = partition.polygon
    s = boundary_nodes(partition, singular, edges_per_cell)
    mesh = meshes.with_boundary(polygon, s, GROWTH)
    of_skfem = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    facet = boundary_facets(of_skfem, mesh)
    p2 = skfem.Basis(of_skfem, skfem.ElementTriP2())
    given = ~form.edges(mesh)
    M = mass.assemble(p2)
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    nodes = np.stack([p2.nodal_dofs[0][start], p2.nodal_dofs[0][end], p2.facet_dofs[0][facet]], axis=1)
    fixed = np.isin(np.arange(p2.N), nodes[~given])
    K = sp.csr_array(laplace.assemble(p2))
    matrix = decoupled(sp.csr_array(form.k * K + form.c * M), fixed)
    rank = ranks(p2, matrix)
    factor = Factor(matrix, np.argsort(rank, kind="stable"))
    if given.all():
        check_constants(
            mesh, form, factorise(matrix, factor.order).solve(form.c * M.sum(axis=1)[factor.order])
        )
    if form.c:
        least = with_divergence(mesh, facet, given, p2, rank, form)
    else:
        least = without_divergence(mesh, nodes, given, K / form.k, rank)
    return ReferenceSpaces(mesh, p2.N, nodes, factor, np.flatnonzero(fixed), least)


def ranks(p2: skfem.Basis, A: sp.csr_array) -> Array:
    """(n,) in which order the unknowns of P2, with the matrix A (n, n), are eliminated.

    The order comes from a dissection of the nodes alone. An edge goes with the earlier of its ends, so that
    what separates nodes separates edges, too, and in spaces of fluxes the unknowns of edges.
    """
    nodes = p2.nodal_dofs[0]
    rank = np.empty(p2.N)
    order = elimination_order(A[nodes][:, nodes])
    rank[nodes[order]] = np.arange(len(nodes))
    rank[p2.facet_dofs[0]] = rank[nodes[p2.mesh.facets]].min(axis=0) - 0.5
    return rank


def boundary_facets(of_skfem: skfem.MeshTri, mesh: Mesh) -> Index:
    """(nb,) skfem's facet of every boundary edge."""
    ends = np.sort([mesh.boundary, np.roll(mesh.boundary, -1)], axis=0)
    candidates = of_skfem.t2f[:, mesh.boundary_triangles]
    at_edge = np.all(of_skfem.facets[:, candidates] == ends[:, None], axis=0)
    return np.asarray(candidates[at_edge.argmax(axis=0), np.arange(len(mesh.boundary))])
