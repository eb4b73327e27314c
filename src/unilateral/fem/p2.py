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
from unilateral.fem.linear_systems import NONE, Descent, rough_inverse
from unilateral.fem.p1 import edge_load, from_elements, gradients
from unilateral.geometry.mesh import Mesh

HATS = (np.ones((3, 3)) + np.eye(3)) / 12
BUBBLES = (np.ones((3, 3)) + np.eye(3)) * 4 / 45
MIXED = (1 + np.eye(3) + np.eye(3)[[1, 2, 0]]) / 15
"""On a triangle of area 1, HATS, BUBBLES and MIXED are (., .)_0 of hats, of bubbles, of bubbles with hats."""
MASS = np.block([[HATS, MIXED.T], [MIXED, BUBBLES]])
AT_NODES = np.zeros((3, 3, 6))
"""AT_NODES[e, a, c] is the coefficient of grad psi_a at node e in the gradient of the basis function c."""
for _i, _j in ((0, 1), (1, 2), (2, 0)):
    AT_NODES[:, _i, _i] = 1
    AT_NODES[_i, _j, 3 + _i] = 4
    AT_NODES[_j, _i, 3 + _i] = 4
STIFFNESS = np.einsum("ef,eac,fbd->abcd", HATS, AT_NODES, AT_NODES)
"""STIFFNESS[a, b, c, d] is that of grad psi_a . grad psi_b in (grad ., grad .)_0 of c and d, at area 1."""


def linear_squares(areas: Array, values: Array) -> Array:
    """(k,) squared L2 norms of functions linear on triangles, from the values (k, 3, ...) at the nodes."""
    axes = tuple(range(1, values.ndim))
    own = (values**2).sum(axis=axes)
    of_sums = (values.sum(axis=1) ** 2).sum(axis=axes[:-1])
    return np.asarray(areas / 12 * (own + of_sums))


def squares(areas: Array, hats: Array, bubbles: Array) -> Array:
    """(k,) squared L2 norms, from the coefficients (k, 3, ...) on triangles."""
    a = hats.reshape(len(hats), 3, -1)
    b = bubbles.reshape(len(bubbles), 3, -1)
    return np.asarray(areas * np.sum(HATS @ a * a + BUBBLES @ b * b + 2 * (MIXED @ a) * b, axis=(1, 2)))


def slopes_at_nodes(slopes: Array, hats: Array, bubbles: Array) -> Array:
    """(k, 3, 2) gradients at the nodes, from the `slopes` (k, 3, 2) of the hats and coefficients (k, 3).

    grad 4 psi_i psi_j is 4 grad psi_j at i, and 4 grad psi_i at j.
    """
    linear = np.einsum("tid,ti->td", slopes, hats)[:, None]
    after = np.roll(slopes, -1, axis=1)
    before = np.roll(slopes, 1, axis=1)
    of_before = np.roll(bubbles, 1, axis=1)[..., None] * before
    return np.asarray(linear + 4 * (bubbles[..., None] * after + of_before))


@dataclass(frozen=True, eq=False)
class Quadratic:
    """P2 on a mesh: the `unknowns` (m, 6) of every triangle, those of hats first, and `slopes` (m, 3, 2).

    The slopes are the hats' gradients. `of_boundary` (2 nb,) are the unknowns of the boundary nodes, then
    those of the boundary edges; `size` is the number of all unknowns.
    """

    mesh: Mesh
    unknowns: Int32
    slopes: Array
    of_boundary: Index
    size: int

    def of_hats(self, v_h: Array) -> Array:
        """(size,) the coefficients of a function (n,) of V_h."""
        return np.append(v_h, np.zeros(self.size - len(v_h)))

    def coefficients(self, v: Array) -> tuple[Array, Array]:
        """(m, 3), (m, 3) the coefficients of hats and of bubbles on the triangles."""
        of = v[self.unknowns]
        return of[:, :3], of[:, 3:]

    def gradient(self, v: Array) -> Array:
        """(m, 3, 2) the gradient of v at the nodes of the triangles."""
        return slopes_at_nodes(self.slopes, *self.coefficients(v))

    def assembled(self, of_triangles: Array) -> Array:
        """(size,) the sums over the triangles of values (m, 6) that belong to their unknowns."""
        return np.bincount(self.unknowns.ravel(), of_triangles.ravel(), self.size).astype(float)

    def load(self, values: Array) -> Array:
        """(size,) the load of an f that is linear on every triangle, with the values (m, 3) at its nodes."""
        return self.assembled(self.mesh.areas[:, None] * (values @ MASS[:3]))

    def edge_load(self, values: Array) -> Array:
        """(size,) the load of a flux linear on every boundary edge, with the values (nb, 2) at its ends."""
        load = self.of_hats(edge_load(self.mesh, values))
        load[np.split(self.of_boundary, 2)[1]] = np.diff(self.mesh.s) / 3 * values.sum(axis=1)
        return load

    def load_of_gradients(self, hats: Array, bubbles: Array) -> Array:
        """(size,) the products of the basis functions' gradients with a field of coefficients (m, 3, 2)."""
        moments = self.mesh.areas[:, None, None] * (HATS @ hats + MIXED.T @ bubbles)
        along = moments @ self.slopes.transpose(0, 2, 1)
        return self.assembled(along.reshape(-1, 9) @ AT_NODES.reshape(9, 6))

    def matrix(self, form: Form) -> sp.csr_array:
        """(size, size) the matrix of k (grad ., grad .)_0 + c (., .)_0, on clamped sides, too."""
        products = form.k * (self.slopes @ self.slopes.transpose(0, 2, 1)).reshape(-1, 9)
        entries = self.mesh.areas[:, None] * (products @ STIFFNESS.reshape(9, 36) + form.c * MASS.ravel())
        return from_elements(self.unknowns, entries, self.size)

    def free(self, contact: Mask, others: Index = NONE) -> sp.csr_array:
        """(size, k) a basis of functions that vanish in `contact` (2 nb,): boundary nodes, then midpoints.

        At a midpoint in contact the bubble takes back half of each hat at the ends of its edge. The `others`
        are unknowns that are 0.
        """
        nodes, middles = np.split(self.of_boundary, 2)
        fixed = np.zeros(self.size, dtype=bool)
        fixed[self.of_boundary[contact]] = True
        fixed[others] = True
        here = np.flatnonzero(contact[len(nodes) :])
        rows = np.tile(middles[here], 2)
        ends = np.append(nodes[here], np.roll(nodes, -1)[here])
        back = sp.coo_array((np.full(len(rows), -0.5), (rows, ends)), shape=(self.size, self.size))
        return (sp.eye_array(self.size, format="csr") + back.tocsr())[:, ~fixed]

    def descent(self, A: sp.csr_array, load: Array, start: Array, free: sp.csr_array) -> Descent:
        """The descent to the x (k,) for which v = start + `free` x has the least v . A v - 2 load . v."""
        own = (free.T @ A @ free).tocsr()
        n = free[: self.mesh.n_nodes].nnz
        of_hats = rough_inverse(own[:n, :n].tocsr())
        diagonal = own.diagonal()[n:]
        zero = np.zeros(free.shape[1])
        rhs = free.T @ (load - A @ start)
        return Descent(own, rhs, zero, lambda r: np.append(of_hats(r[:n]), r[n:] / diagonal))


def quadratic(mesh: Mesh) -> Quadratic:
    """P2 on a mesh."""
    n = mesh.n_nodes
    edges = mesh.opposite_edges[:, [2, 0, 1]]
    of = mesh.triangulation
    return Quadratic(
        mesh,
        unknowns=np.concatenate([mesh.triangles, n + edges], axis=1).astype(np.int32),
        slopes=gradients(mesh),
        of_boundary=np.concatenate([mesh.boundary, n + of.boundary]),
        size=n + len(of.ends),
    )


class Layer(NamedTuple):
    """The triangles (k,) with nodes on the boundary: their areas, and the gradients (k, 3, 2) of their hats.

    `at` (nb, 2) says where each boundary edge begins: in which row, and at which node of that triangle.
    Bubble i of a triangle is that of its nodes i and i + 1.
    """

    mesh: Mesh
    triangles: Index
    areas: Array
    slopes: Array
    at: Index

    def function(self, nodal: Array, bubble: Array) -> tuple[Array, Array]:
        """The coefficients (k, 3) of hats and of bubbles, from those at boundary nodes and edges (nb,)."""
        values = np.zeros(self.mesh.n_nodes)
        of_edges = np.zeros((len(self.triangles), 3))
        values[self.mesh.boundary] = nodal
        of_edges[self.at[:, 0], self.at[:, 1]] = bubble
        return values[self.mesh.triangles[self.triangles]], of_edges

    def squares(self, form: Form, hats: Array, bubbles: Array) -> Array:
        """(k,) the squared energy norms on the triangles, from these coefficients."""
        of_gradient = linear_squares(self.areas, slopes_at_nodes(self.slopes, hats, bubbles))
        return form.k * of_gradient + form.c * squares(self.areas, hats, bubbles)

    def norm(self, form: Form, nodal: Array, bubble: Array) -> float:
        """The energy norm of the function with these coefficients at boundary nodes and edges (nb,)."""
        return math.sqrt(float(self.squares(form, *self.function(nodal, bubble)).sum()))

    def bubble_squares(self, form: Form) -> Array:
        """(nb,) the squares of the bubbles' energy norms on the boundary edges."""
        row, node = self.at.T
        of = self._replace(triangles=self.triangles[row], areas=self.areas[row], slopes=self.slopes[row])
        return of.squares(form, np.zeros((len(row), 3)), np.eye(3)[node])


def layer(mesh: Mesh) -> Layer:
    """The layer of a mesh."""
    on_boundary = np.zeros(mesh.n_nodes, dtype=bool)
    on_boundary[mesh.boundary] = True
    triangles = np.flatnonzero(np.logical_or.reduce([on_boundary.take(nodes) for nodes in mesh.triangles.T]))
    node = np.argmax(mesh.triangles[mesh.boundary_triangles] == mesh.boundary[:, None], axis=1)
    at = np.column_stack([np.searchsorted(triangles, mesh.boundary_triangles), node])
    part = mesh.part(triangles)
    return Layer(mesh, triangles, part.areas, gradients(part), at)
