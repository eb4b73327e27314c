"""P2 on a mesh, in the hierarchical basis: the hats psi_i, and a bubble 4 psi_i psi_j on every edge.

On a triangle bubble i is that of the nodes i and i + 1. Between hats and bubbles there is an angle that no
refinement makes smaller, and the bubbles nearly decouple: a rough inverse for the hats and the diagonal for
the bubbles precondition both matrices, however fine the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Int32, Mask
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import NO_UNKNOWNS, ConjugateGradients, approximate_inverse
from unilateral.fem.p1 import assemble_matrix, edge_load, gradients
from unilateral.geometry.mesh import Mesh

HAT_MASS = (np.ones((3, 3)) + np.eye(3)) / 12
BUBBLE_MASS = (np.ones((3, 3)) + np.eye(3)) * 4 / 45
BUBBLE_HAT_MASS = (1 + np.eye(3) + np.eye(3)[[1, 2, 0]]) / 15
"""(., .)_0 on a triangle of area 1: of hats, of bubbles, and of bubbles (rows) with hats."""
QUADRATIC_MASS = np.block([[HAT_MASS, BUBBLE_HAT_MASS.T], [BUBBLE_HAT_MASS, BUBBLE_MASS]])
GRADIENTS_AT_NODES = np.zeros((3, 3, 6))
"""[e, a, c] is the coefficient of grad psi_a at node e in the gradient of the basis function c."""
for _i, _j in ((0, 1), (1, 2), (2, 0)):
    GRADIENTS_AT_NODES[:, _i, _i] = 1
    GRADIENTS_AT_NODES[_i, _j, 3 + _i] = 4
    GRADIENTS_AT_NODES[_j, _i, 3 + _i] = 4
QUADRATIC_STIFFNESS = np.einsum("ef,eac,fbd->abcd", HAT_MASS, GRADIENTS_AT_NODES, GRADIENTS_AT_NODES)
"""[a, b, c, d] is the coefficient of grad psi_a . grad psi_b in (grad ., grad .)_0 of c and d, at area 1."""


def linear_square_norms(areas: Array, values: Array) -> Array:
    """The squared L2 norms (k,) on triangles of functions that are linear there, from their corner values.

    ||v||_{0,T}^2 = |T| / 12 (sum v_i^2 + (sum v_i)^2), summed over the components of vectors and tensors.
    """
    axes = tuple(range(1, values.ndim))
    square_sums = (values**2).sum(axis=axes)
    sum_squares = (values.sum(axis=1) ** 2).sum(axis=axes[:-1])
    return np.asarray(areas / 12 * (square_sums + sum_squares))


def quadratic_square_norms(areas: Array, hats: Array, bubbles: Array) -> Array:
    """The squared L2 norms on triangles of functions of P2, from their coefficients; shape (k,)."""
    a = hats.reshape(len(hats), 3, -1)
    b = bubbles.reshape(len(bubbles), 3, -1)
    return np.asarray(
        areas * np.sum(HAT_MASS @ a * a + BUBBLE_MASS @ b * b + 2 * (BUBBLE_HAT_MASS @ a) * b, axis=(1, 2))
    )


def gradients_at_nodes(hat_gradients: Array, hats: Array, bubbles: Array) -> Array:
    """The gradients of a function of P2 at the corners of each triangle; shape (k, 3, 2)."""
    linear = np.einsum("tid,ti->td", hat_gradients, hats)[:, None]
    next_gradients = np.roll(hat_gradients, -1, axis=1)
    previous_gradients = np.roll(hat_gradients, 1, axis=1)
    # at node i the gradient of bubble i is 4 grad psi_{i+1}, and that of bubble i - 1 is 4 grad psi_{i-1}
    before_terms = np.roll(bubbles, 1, axis=1)[..., None] * previous_gradients
    return np.asarray(linear + 4 * (bubbles[..., None] * next_gradients + before_terms))


@dataclass(frozen=True, eq=False)
class QuadraticSpace:
    """P2 on a mesh: the `unknowns` (m, 6) of every triangle, those of hats first.

    `hat_gradients` (m, 3, 2) are the gradients of the hats. `boundary_unknowns` (2 nb,) are the unknowns of
    the boundary nodes, then those of the boundary edges; `size` is the number of all unknowns.
    """

    mesh: Mesh
    unknowns: Int32
    hat_gradients: Array
    boundary_unknowns: Index
    size: int

    def embed_linear(self, v_h: Array) -> Array:
        """The coefficients in P2 of a function of V_h; shape (size,)."""
        return np.append(v_h, np.zeros(self.size - len(v_h)))

    def coefficients(self, v: Array) -> tuple[Array, Array]:
        """The coefficients of hats and of bubbles on each triangle; shapes (m, 3), (m, 3)."""
        element_values = v[self.unknowns]
        return element_values[:, :3], element_values[:, 3:]

    def gradient(self, v: Array) -> Array:
        """The gradient of v at the corners of each triangle; shape (m, 3, 2)."""
        return gradients_at_nodes(self.hat_gradients, *self.coefficients(v))

    def assemble(self, element_values: Array) -> Array:
        """The sums over the triangles of numbers that belong to their unknowns; shape (size,)."""
        return np.bincount(self.unknowns.ravel(), element_values.ravel(), self.size).astype(float)

    def load(self, values: Array) -> Array:
        """The load (size,) of a source that is linear on every triangle, from its values at the corners."""
        return self.assemble(self.mesh.areas[:, None] * (values @ QUADRATIC_MASS[:3]))

    def edge_load(self, values: Array) -> Array:
        """The load (size,) of a flux that is linear on every boundary edge, from its values at the ends."""
        load = self.embed_linear(edge_load(self.mesh, values))
        # a bubble is 4 x (1 - x) on its edge: a linear flux has |e| / 3 (sigma_a + sigma_b) against it
        load[np.split(self.boundary_unknowns, 2)[1]] = np.diff(self.mesh.s) / 3 * values.sum(axis=1)
        return load

    def gradient_load(self, hats: Array, bubbles: Array) -> Array:
        """The load (q, grad phi) (size,) of a vector field q of P2 on each triangle, by its coefficients."""
        moments = self.mesh.areas[:, None, None] * (HAT_MASS @ hats + BUBBLE_HAT_MASS.T @ bubbles)
        # moments of q with the hats, times grad psi_a: what GRADIENTS_AT_NODES combines to (q, grad phi)
        along = moments @ self.hat_gradients.transpose(0, 2, 1)
        return self.assemble(along.reshape(-1, 9) @ GRADIENTS_AT_NODES.reshape(9, 6))

    def matrix(self, form: Form) -> sp.csr_array:
        """The matrix of k (grad ., grad .)_0 + c (., .)_0, clamped sides included; shape (size, size)."""
        products = form.k * (self.hat_gradients @ self.hat_gradients.transpose(0, 2, 1)).reshape(-1, 9)
        entries = self.mesh.areas[:, None] * (
            products @ QUADRATIC_STIFFNESS.reshape(9, 36) + form.c * QUADRATIC_MASS.ravel()
        )
        return assemble_matrix(self.unknowns, entries, self.size)

    def vanishing_basis(self, contact: Mask, zero_unknowns: Index = NO_UNKNOWNS) -> sp.csr_array:
        """A basis (size, k) of the functions that vanish at the boundary nodes and midpoints in contact.

        At a midpoint in contact the bubble takes back half of each hat at the ends of its edge. The
        `zero_unknowns` are unknowns that are 0.
        """
        nodes, middles = np.split(self.boundary_unknowns, 2)
        fixed = np.zeros(self.size, dtype=bool)
        fixed[self.boundary_unknowns[contact]] = True
        fixed[zero_unknowns] = True
        contact_edges = np.flatnonzero(contact[len(nodes) :])
        rows = np.tile(middles[contact_edges], 2)
        ends = np.append(nodes[contact_edges], np.roll(nodes, -1)[contact_edges])
        taken_back = sp.coo_array((np.full(len(rows), -0.5), (rows, ends)), shape=(self.size, self.size))
        return (sp.eye_array(self.size, format="csr") + taken_back.tocsr())[:, ~fixed]

    def conjugate_gradients(
        self, A: sp.csr_array, load: Array, start: Array, basis: sp.csr_array
    ) -> ConjugateGradients:
        """The descent to the x (k,) for which v = start + `basis` x has the least v . A v - 2 load . v.

        `basis` (size, k) is one of `vanishing_basis`: a column for each free hat, in the first columns, then
        bubbles.
        """
        # hats and bubbles nearly decouple: each has its own preconditioner
        reduced = (basis.T @ A @ basis).tocsr()
        # a hat has an entry in its own column only; those of bubbles take back parts of hats
        n_hats = basis[: self.mesh.n_nodes].nnz
        invert_hats = approximate_inverse(reduced[:n_hats, :n_hats].tocsr())
        diagonal = reduced.diagonal()[n_hats:]
        zero = np.zeros(basis.shape[1])
        rhs = basis.T @ (load - A @ start)
        return ConjugateGradients(
            reduced, rhs, zero, lambda r: np.append(invert_hats(r[:n_hats]), r[n_hats:] / diagonal)
        )


def quadratic_space(mesh: Mesh) -> QuadraticSpace:
    """P2 on a mesh."""
    n = mesh.n_nodes
    edges = mesh.opposite_edges[:, [2, 0, 1]]
    triangulation = mesh.triangulation
    return QuadraticSpace(
        mesh,
        unknowns=np.concatenate([mesh.triangles, n + edges], axis=1).astype(np.int32),
        hat_gradients=gradients(mesh),
        boundary_unknowns=np.concatenate([mesh.boundary, n + triangulation.boundary_edges]),
        size=n + len(triangulation.ends),
    )


class BoundaryLayer(NamedTuple):
    """The triangles (k,) with nodes on the boundary: their areas, and the gradients (k, 3, 2) of their hats.

    `edge_places` (nb, 2) says where each boundary edge begins: in which row, and at which node of that
    triangle. Bubble i of a triangle is that of its nodes i and i + 1.
    """

    mesh: Mesh
    triangles: Index
    areas: Array
    hat_gradients: Array
    edge_places: Index

    def expand(self, nodal: Array, bubble: Array) -> tuple[Array, Array]:
        """The coefficients (k, 3) of hats and bubbles: those at boundary nodes and edges (nb,), else 0."""
        values = np.zeros(self.mesh.n_nodes)
        bubbles = np.zeros((len(self.triangles), 3))
        values[self.mesh.boundary] = nodal
        bubbles[self.edge_places[:, 0], self.edge_places[:, 1]] = bubble
        return values[self.mesh.triangles[self.triangles]], bubbles

    def square_norms(self, form: Form, hats: Array, bubbles: Array) -> Array:
        """The squared energy norms on the triangles of a function with these coefficients; shape (k,)."""
        corner_gradients = gradients_at_nodes(self.hat_gradients, hats, bubbles)
        gradient_squares = linear_square_norms(self.areas, corner_gradients)
        return form.k * gradient_squares + form.c * quadratic_square_norms(self.areas, hats, bubbles)

    def norm(self, form: Form, nodal: Array, bubble: Array) -> float:
        """The energy norm of the function with these coefficients at boundary nodes and edges (nb,)."""
        return math.sqrt(float(self.square_norms(form, *self.expand(nodal, bubble)).sum()))

    def bubble_square_norms(self, form: Form) -> Array:
        """The squared energy norms of the bubbles of the boundary edges; shape (nb,)."""
        row, node = self.edge_places.T
        edge_layer = self._replace(
            triangles=self.triangles[row], areas=self.areas[row], hat_gradients=self.hat_gradients[row]
        )
        return edge_layer.square_norms(form, np.zeros((len(row), 3)), np.eye(3)[node])


def boundary_layer(mesh: Mesh) -> BoundaryLayer:
    """The triangles of a mesh that have nodes on its boundary."""
    on_boundary = np.zeros(mesh.n_nodes, dtype=bool)
    on_boundary[mesh.boundary] = True
    triangles = np.flatnonzero(np.logical_or.reduce([on_boundary.take(nodes) for nodes in mesh.triangles.T]))
    # where in its triangle each boundary edge begins: edge e does so at boundary node e
    node = np.argmax(mesh.triangles[mesh.boundary_triangles] == mesh.boundary[:, None], axis=1)
    edge_places = np.column_stack([np.searchsorted(triangles, mesh.boundary_triangles), node])
    layer_mesh = mesh.select_triangles(triangles)
    return BoundaryLayer(
        mesh, triangles, areas=layer_mesh.areas, hat_gradients=gradients(layer_mesh), edge_places=edge_places
    )
