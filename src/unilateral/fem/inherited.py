"""Matrices on uniformly refined levels, inherited from the coarsest one without sorting anything.

Children are similar to their parents, so nothing of the geometry is computed anew. With K + M the
matrix of (., .)_1 and, on the coarser of two levels,

    e      an edge; k_e and m_e its off-diagonal entries of K and M,
    T, i   a triangle and a node of it; k_Ti the part of T in the entry of K of the edge opposite to i,

the off-diagonal entries of the finer level are

    k_e + m_e / 4        on both halves of e: each triangle at e has one child at each half, with the
                         same angles, hence the same stiffness, and a quarter of the area;
    2 k_Ti + |T| / 24    on the edge inside T that is parallel to the one opposite to i: the child at
                         i lies on one side of it, the middle one on the other.

K maps constants to 0, so the rows of K + M add up to those of M, a third of the area around the
node. That gives the diagonal.

An old node's neighbours are the midpoints of its edges; a midpoint's row has 7 entries, on the
boundary 5.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Int32
from unilateral.fem.p1 import gradients
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import CORNERS, Triangulation


class Elements(NamedTuple):
    """Triangles with their parts (T, 3) in K's entries of the opposite edges, and areas (T,)."""

    of: Triangulation
    stiffness: Array
    area: Array

    def children(self) -> Elements:
        """Of the next level."""
        return Elements(self.of.children(), np.repeat(self.stiffness, 4, axis=0), np.repeat(self.area / 4, 4))


def elements(mesh: Mesh) -> Elements:
    """Of a mesh."""
    of, area = mesh.triangulation, mesh.areas
    slopes = gradients(replace(mesh, triangles=of.nodes.astype(np.intp)))
    products = np.stack([np.sum(slopes[:, j] * slopes[:, k], axis=1) for _, j, k in CORNERS], axis=1)
    return Elements(of, area[:, None] * products, area)


def prolongation(of: Triangulation) -> sp.csr_array:
    """P (n + E, n): the values at old nodes, and the means of the ends of each edge."""
    old = np.arange(of.n, dtype=np.int32)
    start = np.concatenate([old, of.n + 2 * np.arange(len(of.ends) + 1, dtype=np.int32)])
    data = np.repeat([1.0, 0.5], [of.n, of.ends.size])
    columns = np.concatenate([old, of.ends.ravel()])
    return sp.csr_array((data, columns, start), shape=(of.n + len(of.ends), of.n))


def matrix(coarser: Elements, P: sp.csr_array) -> sp.csr_array:
    """(n + E, n + E), of the children; each row begins with the diagonal and is not sorted."""
    of = coarser.of
    E, mass = len(of.ends), of.sums(coarser.area[:, None] / 12)
    half = of.sums(coarser.stiffness) + mass / 4
    around, starts = _around(P)
    start = len(around) + 7 * np.arange(E + 1, dtype=np.int32)
    start[of.inside :] -= 2 * np.arange(E + 1 - of.inside, dtype=np.int32)
    columns, values = np.empty(start[-1], dtype=np.int32), np.empty(start[-1])
    columns[: len(around)] = around
    values[: len(around)] = np.concatenate([np.zeros(of.n), half])[around]
    columns[start[:-1]], values[start[:-1]] = of.n + np.arange(E, dtype=np.int32), 0.0
    for slot, end in enumerate(of.ends.T, start=1):
        columns[start[:-1] + slot], values[start[:-1] + slot] = end, half
    _fill_within(coarser, start, columns, values)
    rows = np.concatenate([starts[:-1], start])
    A = sp.csr_array((values, columns, rows), shape=(of.n + E, of.n + E))
    values[rows[:-1]] = lumped(coarser) - A @ np.ones(of.n + E)
    return A


def lumped(coarser: Elements) -> Array:
    """(n + E,) a third of the area around each node, of the children: the sums of that matrix's rows."""
    of = coarser.of
    old = np.bincount(of.nodes.ravel(), np.repeat(coarser.area / 12, 3), of.n)
    return np.concatenate([old, 3 * of.sums(coarser.area[:, None] / 12)])


def refined_matrix(mesh: Mesh) -> sp.csr_array:
    """A (n, n) of a mesh that was refined once or more often, its rows as those of `matrix`."""
    of = elements(mesh.coarse or mesh)
    for _ in range(mesh.halvings - 1):
        of = of.children()
    return matrix(of, prolongation(of.of))


def _around(P: sp.csr_array) -> tuple[Int32, Int32]:
    """The rows of each column of P, which are an old node and its neighbours, and where they start."""
    columns = P.tocsc()
    return columns.indices, columns.indptr


def _fill_within(coarser: Elements, start: Int32, columns: Int32, values: Array) -> None:
    """Both entries of each edge inside a triangle; the second triangle at an edge uses the last slots."""
    of, within = coarser.of, 2 * coarser.stiffness + coarser.area[:, None] / 24
    one = np.empty(len(of.ends), dtype=np.int32)
    one[of.edges.ravel()] = np.arange(of.edges.size, dtype=np.int32)
    for i, j, k in CORNERS:
        other = one[of.edges[:, i]] != np.arange(i, of.edges.size, 3)
        slot = start[of.edges[:, i]] + 3 + 2 * other
        columns[slot], values[slot] = of.n + of.edges[:, j], within[:, k]
        columns[slot + 1], values[slot + 1] = of.n + of.edges[:, k], within[:, j]
