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
from unilateral.fem.form import H1, Form, decouple_nodes
from unilateral.fem.linear_systems import OrderedMatrix, elimination_order, factorise
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.grading import EDGES_PER_CELL, grade_boundary_nodes
from unilateral.norms.least_fluxes import LeastFluxes, least_bdm1_fluxes, least_divergence_free_fluxes

REFERENCE_MESH_GROWTH = 0.45


@dataclass(frozen=True, eq=False)
class ReferenceSpaces:
    """P2 and BDM1 on `mesh`: the matrix of the form, and the least energies of fluxes.

    `edge_unknowns` (nb, 3) are the unknowns of P2 on each boundary edge: its start, its end, its midpoint.
    Functions vanish at the unknowns `fixed`, those on clamped edges.
    """

    mesh: Mesh
    n_p2: int
    edge_unknowns: Index
    p2_factor: OrderedMatrix
    fixed: Index
    least_fluxes: LeastFluxes

    def suprema(self, loads: sp.csc_array) -> Array:
        """The matrix of a form (k, k) in the k loads of mu, the square of sup <mu, v> / ||v|| over P2."""
        # b . A^{-1} b for a load b, which has no part at the fixed unknowns
        is_free = np.ones(self.n_p2)
        is_free[self.fixed] = 0.0
        return self.p2_factor.inverse_products((sp.diags_array(is_free) @ loads).tocsc())


def build_reference_spaces(
    partition: Partition,
    singular: Iterable[float] = (),
    edges_per_cell: int = EDGES_PER_CELL,
    form: Form = H1,
) -> ReferenceSpaces:
    """The reference spaces of a partition for a form; `grade_boundary_nodes` has the boundary nodes."""
    s = grade_boundary_nodes(partition, singular, edges_per_cell)
    mesh = meshes.triangulate_from_boundary(partition.polygon, s, REFERENCE_MESH_GROWTH)
    skfem_mesh = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy())
    facet = boundary_facets(skfem_mesh, mesh)
    p2 = skfem.Basis(skfem_mesh, skfem.ElementTriP2())
    has_flux = ~form.clamped_edges(mesh)
    M = mass.assemble(p2)
    starts = p2.nodal_dofs[0][mesh.boundary]
    edge_unknowns = np.stack([starts, np.roll(starts, -1), p2.facet_dofs[0][facet]], axis=1)
    fixed = np.isin(np.arange(p2.N), edge_unknowns[~has_flux])
    K = sp.csr_array(laplace.assemble(p2))
    # k (grad v, grad w) + c (v, w) on P2, v = 0 on clamped edges
    matrix = decouple_nodes(sp.csr_array(form.k * K + form.c * M), fixed)
    rank = elimination_ranks(p2, matrix)
    factor = OrderedMatrix(matrix, np.argsort(rank, kind="stable"))
    # A 1 = c M 1 if nothing is clamped: how far the solution is from 1 shows the rounding
    if has_flux.all():
        check_constants(
            mesh, form, factorise(matrix, factor.order).solve(form.c * M.sum(axis=1)[factor.order])
        )
    # for c = 0 fluxes have no divergence, and are curls of P2
    if form.c:
        least_fluxes = least_bdm1_fluxes(mesh, facet, has_flux, p2, rank, form)
    else:
        least_fluxes = least_divergence_free_fluxes(mesh, edge_unknowns, has_flux, K / form.k, rank)
    return ReferenceSpaces(mesh, p2.N, edge_unknowns, factor, np.flatnonzero(fixed), least_fluxes)


def elimination_ranks(p2: skfem.Basis, A: sp.csr_array) -> Array:
    """The rank of each unknown of P2 in the order in which they are eliminated, (n,)."""
    # a dissection of the nodes alone. An edge goes with the earlier of its ends, so that what separates nodes
    # separates edges, too, and in spaces of fluxes the unknowns of edges
    nodes = p2.nodal_dofs[0]
    rank = np.empty(p2.N)
    order = elimination_order(A[nodes][:, nodes])
    rank[nodes[order]] = np.arange(len(nodes))
    rank[p2.facet_dofs[0]] = rank[nodes[p2.mesh.facets]].min(axis=0) - 0.5
    return rank


def boundary_facets(skfem_mesh: skfem.MeshTri, mesh: Mesh) -> Index:
    """The facet of scikit-fem that is each boundary edge, (nb,): that of its triangle with the same ends."""
    ends = np.sort([mesh.boundary, np.roll(mesh.boundary, -1)], axis=0)
    candidates = skfem_mesh.t2f[:, mesh.boundary_triangles]
    at_edge = np.all(skfem_mesh.facets[:, candidates] == ends[:, None], axis=0)
    return np.asarray(candidates[at_edge.argmax(axis=0), np.arange(len(mesh.boundary))])
