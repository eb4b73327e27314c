"""P2 on a mesh, in the hierarchical basis: the hats psi_i, and a bubble 4 psi_i psi_j on every edge.

On a triangle bubble i is that of the nodes i and i + 1. A function of P2 is the sum of a function of V_h and
of one whose values are small on small triangles, and its squared norm is equivalent to the sum of both, the
second one weighed by values. So the sum of a rough inverse for the hats and of the diagonal for values at
nodes and midpoints preconditions the form, however fine the mesh.

No matrix is stored. On a triangle let K be the matrix of (grad ., grad .)_0 for the hats, and let b_i be the
coefficient of the bubble opposite to node i. As the gradients of the hats add up to 0, the products of

    sum a_i psi_i + sum b_i 4 psi_j psi_k    with the hats are    x = K (a - 4/3 b),
                                             with the bubbles    -4/3 x_i + 8/9 (K b)_i - 8/3 K_jk b_i.

Long arrays are worked on block by block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask, row_blocks
from unilateral.fem.edge_matrix import edge_stiffness_and_areas
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import NO_UNKNOWNS
from unilateral.fem.p1 import edge_load, gradients
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross
from unilateral.geometry.refinement import CYCLIC_CORNERS

HAT_MASS = (np.ones((3, 3)) + np.eye(3)) / 12
BUBBLE_MASS = (np.ones((3, 3)) + np.eye(3)) * 4 / 45
BUBBLE_HAT_MASS = (1 + np.eye(3) + np.eye(3)[[1, 2, 0]]) / 15
"""(., .)_0 on a triangle of area 1: of hats, of bubbles, and of bubbles (rows) with hats."""
QUADRATIC_MASS = np.block([[HAT_MASS, BUBBLE_HAT_MASS.T], [BUBBLE_HAT_MASS, BUBBLE_MASS]])


OPPOSITE_BUBBLES = [0, 1, 2, 4, 5, 3]
"""The basis functions of a triangle, the bubbles in the order of the nodes that they are opposite to."""
APPLY_TRIANGLES_PER_BLOCK = 1 << 14
"""A form is applied to so many triangles at a time."""


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
    # the coefficients (6, components, k), so that one product with the mass matrix does for all triangles
    coefficients = np.concatenate([hats, bubbles], axis=1).reshape(len(areas), 6, -1).transpose(1, 2, 0)
    rows = np.ascontiguousarray(coefficients).reshape(6, -1)
    squares = np.einsum("ij,ij->j", rows, QUADRATIC_MASS @ rows)
    return np.asarray(areas * squares.reshape(-1, len(areas)).sum(axis=0))


def gradients_at_nodes(hat_gradients: Array, hats: Array, bubbles: Array) -> Array:
    """The gradients of a function of P2 at the corners of each triangle; shape (k, 3, 2)."""
    slopes = hat_gradients.transpose(1, 2, 0)
    a = hats.T
    b = bubbles.T
    values = np.empty((3, 2, len(hats)))
    # at node i the gradient of bubble i is 4 grad psi_j, and that of bubble k is 4 grad psi_k
    for i, j, k in CYCLIC_CORNERS:
        values[i] = a[i] * slopes[i] + (a[j] + 4 * b[i]) * slopes[j] + (a[k] + 4 * b[k]) * slopes[k]
    return values.transpose(2, 0, 1)


class VanishingFunctions(NamedTuple):
    """The functions of P2 that vanish at some places, of which `n_nodes` are nodes and the others midpoints.

    `is_fixed` (size,) are the places; `middles` (k,) are unknowns of midpoints among them. Hats that are not
    0 there are added with bubbles that take back half of the values at both `ends` (2, k) of the edge.
    """

    n_nodes: int
    is_fixed: Mask
    middles: Index
    ends: Index

    def restrict_to_hats(self, r: Array) -> Array:
        """The functional r (size,) on what `add_hats` adds for each hat, 0 at fixed nodes; shape (n,)."""
        restricted = r[: self.n_nodes].copy()
        for nodes in self.ends:
            np.subtract.at(restricted, nodes, 0.5 * r[self.middles])
        restricted[self.is_fixed[: self.n_nodes]] = 0.0
        return restricted

    def add_hats(self, v: Array, h: Array) -> None:
        """Add h (n,) of V_h, 0 at fixed nodes, to v (size,) so that the sum vanishes where v does."""
        v[: self.n_nodes] += h
        v[self.middles] -= 0.5 * h[self.ends].sum(axis=0)


@dataclass(frozen=True, eq=False)
class QuadraticForm:
    """The `form` on P2 of a mesh, clamped sides included, triangle by triangle.

    `unknowns` (m, 6) and `size` are those of `QuadraticSpace`. `edge_products` (m, 3) are the products
    k (grad psi_j, grad psi_k)_T of the hats at the ends of the edge opposite to node i.
    """

    mesh: Mesh
    unknowns: Int32
    size: int
    form: Form
    edge_products: Array

    def apply(self, v: Array) -> Array:
        """The products (size,) of v (size,) with the basis functions."""
        total = np.zeros_like(v)
        mass_matrix = self.form.c * QUADRATIC_MASS[OPPOSITE_BUBBLES][:, OPPOSITE_BUBBLES]
        for block in row_blocks(len(self.unknowns), APPLY_TRIANGLES_PER_BLOCK):
            unknowns = self.unknowns[block].T[OPPOSITE_BUBBLES]
            stiffness = self.edge_products[block].T
            values = v.take(unknowns)
            a = values[:3]
            b = values[3:]
            # the module's docstring: x = K (a - 4/3 b), and -4/3 x + 8/9 K b - 8/3 K_jk b_i
            products = np.empty_like(values)
            _apply_hat_stiffness(stiffness, a - 4 / 3 * b, out=products[:3])
            _apply_hat_stiffness(stiffness, 8 / 9 * b, out=products[3:])
            products[3:] -= 4 / 3 * products[:3]
            products[3:] -= (8 / 3 * stiffness) * b
            if self.form.c:
                products += (mass_matrix @ values) * self.mesh.areas[block]
            np.add.at(total, unknowns.ravel(), products.ravel())
        return total

    @cached_property
    def nodal_squares(self) -> Array:
        """The squared norms (size,) of the functions that are 1 at one node or midpoint, and 0 at others."""
        products = self.edge_products.T
        mass = self.form.c * self.mesh.areas
        # the bubble of the edge from i to j: on T -8/3 (K_jk + K_ki + K_ij), and 8 / 45 |T|
        bubble_squares = -8 / 3 * (products[0] + products[1] + products[2]) + 8 / 45 * mass
        total = np.zeros(self.size)
        for i, j, k in CYCLIC_CORNERS:
            np.add.at(total, self.unknowns[:, 3 + i], bubble_squares)
            # psi_i (2 psi_i - 1) at node i: K_ii, as for the hat, and 1 / 30 |T|
            np.add.at(total, self.unknowns[:, i], mass / 30 - (products[j] + products[k]))
        return total


def _apply_hat_stiffness(stiffness: Array, x: Array, out: Array) -> None:
    """Put K x (3, k) on triangles in `out`, where K_jk is the `stiffness` (3, k) of the edge from j to k."""
    # rows of K add up to 0: row j is K_jk (x_k - x_j) + K_ji (x_i - x_j)
    flows = [stiffness[i] * (x[k] - x[j]) for i, j, k in CYCLIC_CORNERS]
    for i, j, k in CYCLIC_CORNERS:
        np.subtract(flows[k], flows[j], out=out[i])


@dataclass(frozen=True, eq=False)
class QuadraticSpace:
    """P2 on a mesh: the `unknowns` (m, 6) of every triangle, those of hats first.

    `boundary_unknowns` (2 nb,) are the unknowns of the boundary nodes, then those of the boundary edges;
    `size` is the number of all unknowns.
    """

    mesh: Mesh
    unknowns: Int32
    boundary_unknowns: Index
    size: int

    def embed_linear(self, v_h: Array) -> Array:
        """The coefficients in P2 of a function of V_h; shape (size,)."""
        return np.append(v_h, np.zeros(self.size - len(v_h)))

    def coefficients(self, v: Array, triangles: slice = slice(None)) -> tuple[Array, Array]:
        """The coefficients of hats and of bubbles on some triangles, or on all; shapes (k, 3), (k, 3)."""
        element_values = v.take(self.unknowns[triangles].T)
        return element_values[:3].T, element_values[3:].T

    def coefficient_sums(self, v: Array) -> Array:
        """The sums of the sizes of v's coefficients on each triangle; shape (m,)."""
        sums = np.empty(len(self.unknowns))
        for block in row_blocks(len(sums)):
            sums[block] = np.abs(v.take(self.unknowns[block].T)).sum(axis=0)
        return sums

    def subtract_hats(self, values: Array) -> Array:
        """The coefficients (size,) of a function from its values at nodes and midpoints, in place."""
        bubbles = values[self.mesh.n_nodes :]
        for block in row_blocks(len(bubbles)):
            start, end = values.take(self.mesh.triangulation.ends[block].T)
            bubbles[block] -= 0.5 * (start + end)
        return values

    def subtract_bubbles(self, r: Array) -> Array:
        """The functional r (size,) on functions that are 1 at one node or midpoint and 0 at others."""
        # that of a node is its hat less half of the bubbles of its edges
        nodal = r.copy()
        bubbles = r[self.mesh.n_nodes :]
        for block in row_blocks(len(bubbles)):
            half = 0.5 * bubbles[block]
            start, end = self.mesh.triangulation.ends[block].T
            np.subtract.at(nodal, start, half)
            np.subtract.at(nodal, end, half)
        return nodal

    def gradient(self, v: Array, triangles: slice = slice(None)) -> Array:
        """The gradient of v at the corners of some triangles, or of all; shape (k, 3, 2)."""
        return gradients_at_nodes(self.hat_gradients(triangles), *self.coefficients(v, triangles))

    def hat_gradients(self, triangles: slice) -> Array:
        """The gradients of the hats on some triangles; shape (k, 3, 2)."""
        nodes = self.unknowns[triangles].T[:3]
        points = self.mesh.points.ravel()
        x = points.take(2 * nodes)
        y = points.take(2 * nodes + 1)
        scale = 0.5 / self.mesh.areas[triangles]
        # grad psi_i is the opposite edge, turned by a right angle, over 2 |T|
        slopes = np.empty((2, *nodes.shape))
        for i, j, k in CYCLIC_CORNERS:
            slopes[0, i] = (y[j] - y[k]) * scale
            slopes[1, i] = (x[k] - x[j]) * scale
        return slopes.transpose(2, 1, 0)

    def load(self, values: Array) -> Array:
        """The load (size,) of a source that is linear on every triangle, from its values at the corners."""
        total = np.zeros(self.size)
        for block in row_blocks(len(self.unknowns)):
            moments = (QUADRATIC_MASS[:, :3] @ values[block].T) * self.mesh.areas[block]
            np.add.at(total, self.unknowns[block].T.ravel(), moments.ravel())
        return total

    def edge_load(self, values: Array) -> Array:
        """The load (size,) of a flux that is linear on every boundary edge, from its values at the ends."""
        load = self.embed_linear(edge_load(self.mesh, values))
        # a bubble is 4 x (1 - x) on its edge: a linear flux has |e| / 3 (sigma_a + sigma_b) against it
        load[np.split(self.boundary_unknowns, 2)[1]] = np.diff(self.mesh.s) / 3 * values.sum(axis=1)
        return load

    def curl_load(self, hats: Array, bubbles: Array) -> Array:
        """The load (q, curl phi) (size,) of a vector field q of P2 on each triangle, by its coefficients.

        curl phi is (d_y phi, -d_x phi).
        """
        total = np.zeros(self.size)
        for block in row_blocks(len(self.unknowns)):
            # moments (3, 2, k) of q with the hats, and their products with curl psi_j
            q = np.concatenate([hats[block], bubbles[block]], axis=1).transpose(1, 2, 0)
            moments = (QUADRATIC_MASS[:3] @ q.reshape(6, -1)).reshape(3, *q.shape[1:])
            moments = (moments * self.mesh.areas[block]).transpose(0, 2, 1)
            whole = moments[0] + moments[1] + moments[2]
            slopes = self.hat_gradients(block).transpose(1, 0, 2)
            products = np.empty((6, q.shape[2]))
            for i, j, _ in CYCLIC_CORNERS:
                products[i] = cross(whole, slopes[i])
                # the curl of bubble i is 4 (psi_i curl psi_j + psi_j curl psi_i)
                products[3 + i] = 4 * (cross(moments[i], slopes[j]) + cross(moments[j], slopes[i]))
            np.add.at(total, self.unknowns[block].T.ravel(), products.ravel())
        return total

    def quadratic_form(self, form: Form) -> QuadraticForm:
        """The form k (grad ., grad .)_0 + c (., .)_0 on this space, clamped sides included."""
        products = np.empty((3, len(self.unknowns))).T
        for block in row_blocks(len(products)):
            stiffness, _ = edge_stiffness_and_areas(self.mesh.points, self.unknowns[block, :3])
            products[block] = form.k * stiffness.T
        return QuadraticForm(self.mesh, self.unknowns, self.size, form, edge_products=products)

    def vanishing_functions(self, contact: Mask, zero_unknowns: Index = NO_UNKNOWNS) -> VanishingFunctions:
        """The functions that vanish at the boundary nodes and midpoints in contact (2 nb,).

        They vanish at the nodes and midpoints of the `zero_unknowns`, too.
        """
        is_fixed = np.zeros(self.size, dtype=bool)
        is_fixed[self.boundary_unknowns[contact]] = True
        is_fixed[zero_unknowns] = True
        fixed_middles = np.flatnonzero(is_fixed[self.mesh.n_nodes :])
        return VanishingFunctions(
            self.mesh.n_nodes,
            is_fixed,
            middles=self.mesh.n_nodes + fixed_middles,
            ends=self.mesh.triangulation.ends[fixed_middles].T,
        )


def quadratic_space(mesh: Mesh) -> QuadraticSpace:
    """P2 on a mesh."""
    n = mesh.n_nodes
    triangulation = mesh.triangulation
    # the numbers of one unknown of all triangles stand together, as blocks of triangles use them
    unknowns = np.empty((6, len(mesh.triangles)), dtype=np.int32).T
    unknowns[:, :3] = mesh.triangles
    for bubble, node in enumerate((2, 0, 1)):
        np.add(mesh.opposite_edges[:, node], n, out=unknowns[:, 3 + bubble])
    return QuadraticSpace(
        mesh,
        unknowns=unknowns,
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
