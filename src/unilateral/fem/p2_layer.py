"""Functions of P2 given at boundary nodes and on boundary edges, 0 except on the triangles at these nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.fem.p1 import hat_gradients
from unilateral.fem.p2 import linear_squares, slopes_at_nodes, squares
from unilateral.geometry.mesh import Mesh


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
        values, of_edges = np.zeros(self.mesh.n_nodes), np.zeros((len(self.triangles), 3))
        values[self.mesh.boundary] = nodal
        of_edges[self.at[:, 0], self.at[:, 1]] = bubble
        return values[self.mesh.triangles[self.triangles]], of_edges

    def norms(self, hats: Array, bubbles: Array) -> Array:
        """(k,) the squared H1 norms on the triangles, from these coefficients."""
        of_gradient = linear_squares(self.areas, slopes_at_nodes(self.slopes, hats, bubbles))
        return of_gradient + squares(self.areas, hats, bubbles)

    def bubble_squares(self) -> Array:
        """(nb,) the squares of the bubbles' H1 norms on the boundary edges."""
        row, node = self.at.T
        of = self._replace(triangles=self.triangles[row], areas=self.areas[row], slopes=self.slopes[row])
        return of.norms(np.zeros((len(row), 3)), np.eye(3)[node])


def layer(mesh: Mesh) -> Layer:
    """The layer of a mesh."""
    on_boundary = np.zeros(mesh.n_nodes, dtype=bool)
    on_boundary[mesh.boundary] = True
    triangles = np.flatnonzero(np.logical_or.reduce([on_boundary.take(nodes) for nodes in mesh.triangles.T]))
    node = np.argmax(mesh.triangles[mesh.boundary_triangles] == mesh.boundary[:, None], axis=1)
    at = np.column_stack([np.searchsorted(triangles, mesh.boundary_triangles), node])
    areas = mesh.areas[triangles]
    return Layer(mesh, triangles, areas, hat_gradients(mesh.points[mesh.triangles[triangles]], areas), at)
