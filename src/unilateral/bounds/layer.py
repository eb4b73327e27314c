"""Functions of P2 given at boundary nodes and on boundary edges, 0 but on the triangles at these nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.fem.p1 import hat_gradients
from unilateral.geometry.mesh import Mesh

HATS = (np.ones((3, 3)) + np.eye(3)) / 12
BUBBLES = (np.ones((3, 3)) + np.eye(3)) * 4 / 45
MIXED = (1 + np.eye(3) + np.eye(3)[[1, 2, 0]]) / 15
"""(., .)_0 on a triangle of area 1 of hats, of bubbles 4 psi_i psi_j; bubble i is of nodes i and i + 1."""


class Layer(NamedTuple):
    """The triangles (k,) with nodes on the boundary: their areas, and the gradients (k, 3, 2) of their hats.

    `at` (nb, 2) is the row and the node of it at which each boundary edge begins.
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

    def gradients(self, hats: Array, bubbles: Array) -> Array:
        """(k, 3, 2) at the nodes, where grad 4 psi_i psi_j is 4 grad psi_j at i and 4 grad psi_i at j."""
        linear = np.einsum("tid,ti->td", self.slopes, hats)[:, None]
        after, before = np.roll(self.slopes, -1, axis=1), np.roll(self.slopes, 1, axis=1)
        of_before = np.roll(bubbles, 1, axis=1)[..., None] * before
        return np.asarray(linear + 4 * (bubbles[..., None] * after + of_before))

    def squares(self, hats: Array, bubbles: Array) -> Array:
        """(k,) squared L2 norms."""
        own = np.sum(hats @ HATS * hats + bubbles @ BUBBLES * bubbles + 2 * (bubbles @ MIXED * hats), axis=1)
        return np.asarray(self.areas * own)

    def bubble_squares(self) -> Array:
        """(nb,) the squares of the bubbles' H1 norms on the boundary edges."""
        row, node = self.at.T
        hats, bubbles = np.zeros((len(row), 3)), np.eye(3)[node]
        of = self._replace(triangles=self.triangles[row], areas=self.areas[row], slopes=self.slopes[row])
        return linear_squares(of.areas, of.gradients(hats, bubbles)) + of.squares(hats, bubbles)


def layer(mesh: Mesh) -> Layer:
    """That of a mesh."""
    on_boundary = np.zeros(mesh.n_nodes, dtype=bool)
    on_boundary[mesh.boundary] = True
    triangles = np.flatnonzero(on_boundary[mesh.triangles].any(axis=1))
    node = np.argmax(mesh.triangles[mesh.boundary_triangles] == mesh.boundary[:, None], axis=1)
    at = np.column_stack([np.searchsorted(triangles, mesh.boundary_triangles), node])
    areas = mesh.areas[triangles]
    return Layer(mesh, triangles, areas, hat_gradients(mesh.points[mesh.triangles[triangles]], areas), at)


def linear_squares(areas: Array, values: Array) -> Array:
    """(k,) squared L2 norms of functions linear on triangles, from the values (k, 3, ...) at the nodes."""
    flat = values.reshape(len(values), 3, -1)
    return np.asarray(areas / 12 * (np.sum(flat**2, axis=(1, 2)) + np.sum(flat.sum(axis=1) ** 2, axis=1)))
