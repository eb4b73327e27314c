"""The matrix of (., .)_1 from the edges of a triangulation, without sorting entries.

An off-diagonal entry belongs to an edge: the sum over the triangles T at it of |T| / 12, from the mass, and
of the product of the gradients of its ends' hats, from the stiffness, which is

    (e_j . e_k) / (4 |T|)      for the edge opposite to node i, e_j and e_k the other two edges.

The stiffness maps constants to 0, so the rows add up to those of the mass, a third of the area around the
node. That gives the diagonal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Int32, blocks
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import Triangulation


class Elements(NamedTuple):
    """Of triangles: the products (T, 3) that belong to the opposite edges, and areas (T,)."""

    stiffness: Array
    area: Array


def elements(points: Array, nodes: Int32) -> Elements:
    """Of the triangles with those nodes (T, 3)."""
    stiffness, area = np.empty(nodes.shape), np.empty(len(nodes))
    for of in blocks(len(nodes)):
        (x, y) = points.T[:, nodes[of].T]
        e, f = x[[2, 0, 1]] - x[[1, 2, 0]], y[[2, 0, 1]] - y[[1, 2, 0]]
        area[of] = 0.5 * (e[2] * f[0] - f[2] * e[0])
        product = e[[1, 2, 0]] * e[[2, 0, 1]] + f[[1, 2, 0]] * f[[2, 0, 1]]
        stiffness[of] = (0.25 * product / area[of]).T
    return Elements(stiffness, area)


def lumped(nodes: Int32, area: Array, n: int) -> Array:
    """(n,) a third of the area around each node: the sums of the matrix's rows."""
    return np.bincount(nodes.ravel(), np.repeat(area / 3, 3), n).astype(float, copy=False)


def h1_matrix(mesh: Mesh) -> sp.csr_array:
    """A (n, n) of a mesh, see `matrix`."""
    return matrix(mesh.triangulation, mesh.points)


def matrix(tri: Triangulation, points: Array) -> sp.csr_array:
    """A (n, n) of those triangles, each row beginning with the diagonal."""
    n, of = tri.n, elements(points, tri.nodes)
    parts = of.stiffness + (of.area / 12)[:, None]
    beside = np.bincount(tri.edges.ravel(), parts.ravel(), len(tri.ends))
    a, b = tri.ends.T
    diagonal = lumped(tri.nodes, of.area, n) - np.bincount(a, beside, n) - np.bincount(b, beside, n)
    every = np.arange(n, dtype=np.int32)
    places = np.concatenate([every, a, b]), np.concatenate([every, b, a])
    A = sp.coo_array((np.concatenate([diagonal, beside, beside]), places), shape=(n, n))
    A.has_canonical_format = True  # no entry occurs twice; it would be looked for
    return A.tocsr()


def some_rows(points: Array, nodes: Int32, chosen: Int32, n: int) -> sp.csr_array:
    """(k, n) the rows of the nodes (k,) alone, from the triangles at them."""
    place = np.full(n, -1, dtype=np.int32)
    place[chosen] = np.arange(len(chosen), dtype=np.int32)
    row = place[nodes]
    some = np.flatnonzero((row >= 0).any(axis=1))
    row, nodes = row[some], nodes[some]
    stiffness, area = elements(points, nodes)
    values = np.empty((len(some), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        values[:, i, j] = values[:, j, i] = stiffness[:, k] + area / 12
        values[:, i, i] = area / 6 - stiffness[:, j] - stiffness[:, k]
    kept = np.repeat(row[:, :, None] >= 0, 3, axis=2)
    rows, columns = np.repeat(row[:, :, None], 3, axis=2)[kept], np.repeat(nodes[:, None], 3, axis=1)[kept]
    return sp.coo_array((values[kept], (rows, columns)), shape=(len(chosen), n)).tocsr()
