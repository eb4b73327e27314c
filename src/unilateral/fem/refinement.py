"""Uniform refinement of triangles, edges and matrices, without sorting anything.

Red refinement cuts every triangle into four similar ones, so nothing of the geometry is computed
anew. With K + M the matrix of (., .)_1 and, on the coarser of two levels,

    e      an edge; k_e and m_e its off-diagonal entries of K and M,
    T, i   a triangle and a node of it; k_Ti the part of T in the entry of K of the edge opposite to i,

the off-diagonal entries of the finer level are

    k_e + m_e / 4        on both halves of e: each triangle at e has one child at each half, with the
                         same angles, hence the same stiffness, and a quarter of the area;
    2 k_Ti + |T| / 24    on the edge inside T that is parallel to the one opposite to i: the child at
                         i lies on one side of it, the middle one on the other.

K maps constants to 0, so the rows of K + M add up to those of M, a third of the area around the
node. That gives the diagonal.

Nodes of the finer level: those of the coarser, with their numbers, then the midpoint of every edge.
An old node's neighbours are the midpoints of its edges; a midpoint's row has 7 entries, on the
boundary 5. Edges on the boundary have the last numbers, in their order along it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from unilateral.fem.p1 import gradients
from unilateral.geometry.mesh import Mesh

Array = NDArray[np.float64]
Int32 = NDArray[np.int32]
CORNERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""A node of a triangle and the two after it."""


class Triangles(NamedTuple):
    """Of a level with n nodes: nodes (T, 3), opposite edges (T, 3), and the ends (E, 2) of the edges.

    The first `inside` edges are not on the boundary. `stiffness` (T, 3) is a triangle's part in the
    entry of each of its edges, `area` (T,) its area.
    """

    n: int
    nodes: Int32
    edges: Int32
    ends: Int32
    inside: int
    stiffness: Array
    area: Array

    def on_edges(self, values: Array) -> Array:
        """(E,) sums over the triangles at each edge of values (T, 3), or (T, 1) for all three edges."""
        of_each = np.broadcast_to(values, self.edges.shape)
        return np.bincount(self.edges.ravel(), of_each.ravel(), len(self.ends)).astype(float, copy=False)


def triangles(mesh: Mesh) -> Triangles:
    """Of a mesh; here the edges are sorted."""
    n, nodes, place = mesh.n_nodes, mesh.triangles, np.array([mesh.n_nodes, 1])
    opposite = np.sort(nodes[:, [[1, 2], [2, 0], [0, 1]]], axis=2) @ place
    boundary = np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)])
    of_boundary = np.sort(boundary, axis=1) @ place
    inside = np.setdiff1d(opposite, of_boundary)
    numbers = np.concatenate([inside, of_boundary])
    order = np.argsort(numbers)
    edges = order[np.searchsorted(numbers, opposite, sorter=order)].astype(np.int32)
    ends = np.concatenate([np.column_stack(np.divmod(inside, n)), boundary]).astype(np.int32)
    slopes, area = gradients(mesh), mesh.areas
    products = np.stack([np.sum(slopes[:, j] * slopes[:, k], axis=1) for _, j, k in CORNERS], axis=1)
    return Triangles(n, nodes.astype(np.int32), edges, ends, len(inside), area[:, None] * products, area)


def corners(n: int, nodes: Int32, edges: Int32) -> Int32:
    """(4 T, 3) nodes of the children: i < 3 lies at node i, 3 in the middle, its node i on edge i."""
    found = np.empty((len(nodes), 4, 3), dtype=np.int32)
    for i, j, k in CORNERS:
        found[:, i, i], found[:, 3, i] = nodes[:, i], n + edges[:, i]
        found[:, i, j], found[:, i, k] = n + edges[:, k], n + edges[:, j]
    return found.reshape(-1, 3)


def children(of: Triangles) -> Triangles:
    """Of the next level. Edges: halves of those inside, three in each triangle, halves on the boundary."""
    a, b = of.ends.T
    T, middle = len(of.nodes), of.n + np.arange(len(a), dtype=np.int32)
    halves = np.stack([a, middle, middle, b], axis=1).reshape(-1, 2)
    within = of.n + of.edges[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2)
    half = 2 * np.arange(len(a), dtype=np.int32)
    half[of.inside :] += 3 * T
    edges = np.empty((T, 4, 3), dtype=np.int32)
    for i, *others in CORNERS:
        edges[:, i, i] = edges[:, 3, i] = 2 * of.inside + np.arange(i, 3 * T, 3)
        for j in others:
            edges[:, i, j] = half[of.edges[:, j]] + (b[of.edges[:, j]] == of.nodes[:, i])
    return Triangles(
        of.n + len(a),
        corners(of.n, of.nodes, of.edges),
        edges.reshape(-1, 3),
        np.concatenate([halves[: 2 * of.inside], within, halves[2 * of.inside :]]),
        2 * of.inside + 3 * T,
        np.repeat(of.stiffness, 4, axis=0),
        np.repeat(of.area / 4, 4),
    )


def prolongation(of: Triangles) -> sp.csr_array:
    """P (n + E, n): the values at old nodes, and the means of the ends of each edge."""
    old = np.arange(of.n, dtype=np.int32)
    start = np.concatenate([old, of.n + 2 * np.arange(len(of.ends) + 1, dtype=np.int32)])
    data = np.repeat([1.0, 0.5], [of.n, of.ends.size])
    columns = np.concatenate([old, of.ends.ravel()])
    return sp.csr_array((data, columns, start), shape=(of.n + len(of.ends), of.n))


def matrix(of: Triangles, P: sp.csr_array) -> sp.csr_array:
    """(n + E, n + E), of the children; each row begins with the diagonal and is not sorted."""
    E, mass = len(of.ends), of.on_edges(of.area[:, None] / 12)
    half = of.on_edges(of.stiffness) + mass / 4
    around, starts = _around(P)
    start = len(around) + 7 * np.arange(E + 1, dtype=np.int32)
    start[of.inside :] -= 2 * np.arange(E + 1 - of.inside, dtype=np.int32)
    columns, values = np.empty(start[-1], dtype=np.int32), np.empty(start[-1])
    columns[: len(around)] = around
    values[: len(around)] = np.concatenate([np.zeros(of.n), half])[around]
    columns[start[:-1]], values[start[:-1]] = of.n + np.arange(E, dtype=np.int32), 0.0
    for slot, end in enumerate(of.ends.T, start=1):
        columns[start[:-1] + slot], values[start[:-1] + slot] = end, half
    _fill_within(of, start, columns, values)
    rows = np.concatenate([starts[:-1], start])
    A = sp.csr_array((values, columns, rows), shape=(of.n + E, of.n + E))
    lumped = np.bincount(of.nodes.ravel(), np.repeat(of.area / 12, 3), of.n)
    values[rows[:-1]] = np.concatenate([lumped, 3 * mass]) - A @ np.ones(of.n + E)
    return A


def _around(P: sp.csr_array) -> tuple[Int32, Int32]:
    """The rows of each column of P, which are an old node and its neighbours, and where they start."""
    columns = P.tocsc()
    return columns.indices, columns.indptr


def _fill_within(of: Triangles, start: Int32, columns: Int32, values: Array) -> None:
    """Both entries of each edge inside a triangle; the second triangle at an edge uses the last slots."""
    within = 2 * of.stiffness + of.area[:, None] / 24
    one = np.empty(len(of.ends), dtype=np.int32)
    one[of.edges.ravel()] = np.arange(of.edges.size, dtype=np.int32)
    for i, j, k in CORNERS:
        other = one[of.edges[:, i]] != np.arange(i, of.edges.size, 3)
        slot = start[of.edges[:, i]] + 3 + 2 * other
        columns[slot], values[slot] = of.n + of.edges[:, j], within[:, k]
        columns[slot + 1], values[slot + 1] = of.n + of.edges[:, k], within[:, j]
