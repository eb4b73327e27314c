"""Partial elimination by macro-elements, for meshes made by uniform refinement (the paper, section 5).

A macro-element is a triangle of a coarser mesh, with m = 2^k edges of the mesh on each side. It consists of
four with m/2 edges. Each is the whole one halved. The middle one is turned by 180 degrees, too, which changes
no entry of the matrix of (., .)_1. So one condensed matrix of size 3m/2, used four times, gives that of
size 3m, and only the nodes on the sides of the middle one are eliminated. Triangles of the coarsest mesh
share all of it if they are congruent. These are then joined two by two, and what lies inside is eliminated,
until A_3 on the boundary is left.

Each elimination is a `EliminationStage`. With the blocks of a matrix K on its inner (i) and outer (o) nodes
and W = K_ii^{-1} K_io, a load goes to the outer nodes as b_o - W^T b_i, and the solution comes back as x_i =
K_ii^{-1} b_i - W x_o.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from unilateral.arrays import Array, Index
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import Triangulation, refine_triangulation


@dataclass(frozen=True, eq=False)
class EliminationStage:
    """Inner nodes eliminated from p parts of each of s shapes.

    `inner` (s, p, i) and `outer` (s, p, o) are nodes, `factor` (s, i, i) is the lower Cholesky factor of
    K_ii, and `W` is (s, i, o).
    """

    inner: Index
    outer: Index
    factor: Array
    W: Array

    def reduce(self, loads: Array) -> None:
        """Moves the loads (k, n) of the inner nodes to the outer ones, in place."""
        # b_o - W^T b_i, for the p copies of each shape together
        k = len(loads)
        (s, p, o) = self.outer.shape
        inner = np.moveaxis(loads[:, self.inner], 1, 0).reshape(s, k * p, -1)
        outer_loads = np.moveaxis((inner @ self.W).reshape(s, k, p, o), 1, 0)
        for load, change in zip(loads, outer_loads, strict=True):
            np.subtract.at(load, self.outer.ravel(), change.ravel())

    def expand(self, x: Array) -> None:
        """Replaces the loads in the inner nodes of x (k, n) by the solution; the outer ones hold it."""
        for inner, outer, factor, W in zip(self.inner, self.outer, self.factor, self.W, strict=True):
            # x_i = K_ii^{-1} b_i - W x_o
            loads = x[:, inner].reshape(-1, len(factor)).T
            inner_solution = cho_solve((factor, True), loads, check_finite=False).T
            x[:, inner] = inner_solution.reshape(len(x), *inner.shape) - x[:, outer] @ W.T


@dataclass(frozen=True, eq=False)
class CondensedPatch:
    """A union of coarse triangles, condensed to the nodes (o,) that are left, with the matrix K (o, o).

    `triangle_counts` (o,) says how many of its triangles meet at each node.
    """

    nodes: Index
    triangle_counts: Index
    K: Array


class MacroElementFactors:
    """The stages of a refined mesh; A_3 (nb, nb) on its boundary nodes, and its upper Cholesky factor.

    A_3 is decoupled from clamped nodes, as all matrices of a form are.
    """

    def __init__(self, mesh: Mesh, form: Form = H1) -> None:
        self.boundary = mesh.boundary
        self.clamped_boundary = form.clamped_nodes(mesh)[mesh.boundary]
        self.stages: list[EliminationStage] = []
        nodes, matrices = self._condense_macro_elements(mesh, form)
        total_counts = np.bincount(nodes.ravel(), minlength=mesh.n_nodes)
        total_counts[mesh.boundary] += 1  # more than can meet, so that no boundary node is eliminated
        patches = [
            CondensedPatch(perimeter, np.ones_like(perimeter), K)
            for shape_nodes, K in zip(nodes, matrices, strict=True)
            for perimeter in shape_nodes
        ]
        # A_3: what is left of the matrix of the whole mesh; root.nodes[order] is mesh.boundary
        root = self._join_patches(patches, mesh.points, total_counts)
        order = np.argsort(root.nodes)[np.argsort(np.argsort(mesh.boundary))]
        coupled = ~(self.clamped_boundary[:, None] | self.clamped_boundary) | np.eye(len(order), dtype=bool)
        self.A_3 = np.where(coupled, root.K[np.ix_(order, order)], 0.0)
        self.cholesky = cholesky(self.A_3)

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs for rhs (n,) or (n, k)."""
        x = np.array(np.atleast_2d(rhs.T), dtype=float, order="C")
        for stage in self.stages:
            stage.reduce(x)
        loads = np.where(self.clamped_boundary, 0.0, x[:, self.boundary]).T
        x[:, self.boundary] = cho_solve((self.cholesky, False), loads, check_finite=False).T
        for stage in reversed(self.stages):
            stage.expand(x)
        return x.T.reshape(rhs.shape)

    def _condense_macro_elements(self, mesh: Mesh, form: Form) -> tuple[Index, Array]:
        """The nodes (s, p, 3m) around the coarse triangles, and the matrix (s, 3m, 3m) of each shape."""
        coarse = mesh.coarse or mesh
        triangulation = coarse.triangulation
        # m = 1: all finest triangles in a coarse one are that one scaled, turned or not, with one matrix
        shapes = 1 if triangulation.all_alike else len(triangulation.nodes)
        K = element_matrices(coarse.points[triangulation.nodes[:shapes]] / 2.0**mesh.halvings, form)
        levels = (
            level_nodes.reshape(shapes, -1, level_nodes.shape[-1])
            for level_nodes in perimeter_nodes(triangulation, mesh.halvings)
        )
        nodes = next(levels)
        for outer in levels:
            shapes, copies, _ = outer.shape
            # the four children of a triangle follow one another in `nodes`
            K = self._condense_four_children(K, nodes.reshape(shapes, copies, 4, -1), outer)
            nodes = outer
        return nodes, K

    def _condense_four_children(self, K: Array, children: Index, outer: Index) -> Array:
        """The matrices (s, 3m, 3m) on the nodes `outer` (s, p, 3m); K is that of each of four `children`."""
        # nodes of the four children that are not on the outer ones are inner; one copy stands for all
        example = children[0, 0]
        different, first = np.unique(example, return_index=True)
        first = first[np.isin(different, outer[0, 0], invert=True)]
        inner = children.reshape(*children.shape[:2], -1)[..., first]
        local = np.concatenate([inner[0, 0], outer[0, 0]])
        order = np.argsort(local)
        assembled = np.zeros((len(K), len(local), len(local)))
        # the sum of the four children's matrices, in the numbering inner, outer
        for child in order[np.searchsorted(local[order], example)]:
            assembled[:, child[:, None], child] += K
        return self._eliminate_inner(assembled, inner, outer)

    def _join_patches(
        self, patches: list[CondensedPatch], points: Array, total_counts: Index
    ) -> CondensedPatch:
        """The union of all patches: halved across the longer extent, and each half joined in itself first."""
        if len(patches) == 1:
            return patches[0]
        centres = np.array([points[patch.nodes].mean(axis=0) for patch in patches])
        order = np.argsort(centres[:, np.argmax(np.ptp(centres, axis=0))], kind="stable")
        half = len(patches) // 2
        first = self._join_patches([patches[k] for k in order[:half]], points, total_counts)
        second = self._join_patches([patches[k] for k in order[half:]], points, total_counts)
        return self._join_pair((first, second), total_counts)

    def _join_pair(self, pair: tuple[CondensedPatch, CondensedPatch], total_counts: Index) -> CondensedPatch:
        """The union of two patches, from which the nodes that have become inner ones are eliminated."""
        # a node is inside once all of its triangles, `total_counts`, are in the union
        nodes = np.union1d(pair[0].nodes, pair[1].nodes)
        counts = np.zeros_like(nodes)
        for patch in pair:
            counts[np.searchsorted(nodes, patch.nodes)] += patch.triangle_counts
        inside = counts == total_counts[nodes]
        # the sum of both matrices, in the numbering inside first
        order = np.argsort(~inside, kind="stable")
        rank = np.argsort(order)
        i = np.count_nonzero(inside)
        K = np.zeros((1, len(nodes), len(nodes)))
        for patch in pair:
            position = rank[np.searchsorted(nodes, patch.nodes)]
            K[0, position[:, None], position] += patch.K
        inner, outer = np.split(nodes[order], [i])
        K_outer = self._eliminate_inner(K, inner[None, None], outer[None, None])[0]
        return CondensedPatch(outer, counts[order][i:], K_outer)

    def _eliminate_inner(self, K: Array, inner: Index, outer: Index) -> Array:
        """The Schur complements (s, o, o) of K (s, i + o, i + o) on the outer nodes; a stage is appended.

        `inner` (s, p, i) and `outer` (s, p, o) are the nodes of the p parts that share a matrix.
        """
        i = inner.shape[-1]
        if i == 0:
            return K
        factor = cholesky(K[:, :i, :i], lower=True)
        W = K[:, :i, i:].copy()
        schur = K[:, i:, i:].copy()
        # K_ii = L L^T and Y = L^{-1} K_io: the complement is K_oo - Y^T Y, and W = K_ii^{-1} K_io = L^{-T} Y
        for L, Y, complement in zip(factor, W, schur, strict=True):
            Y[:] = solve_triangular(L, Y, lower=True, check_finite=False)
            complement -= Y.T @ Y
            Y[:] = solve_triangular(L, Y, lower=True, trans="T", check_finite=False)
        self.stages.append(EliminationStage(inner, outer, factor, W))
        return schur


def element_matrices(corners: Array, form: Form = H1) -> Array:
    """The matrices (s, 3, 3) of a form on triangles, for the barycentric functions of their corners."""
    sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])[:, None, None]
    # k e_i . e_j / (4 |T|) + c |T| (1 + delta_ij) / 12, e_i the edge opposite to corner i
    mass = form.c * area / 12 * (np.ones((3, 3)) + np.eye(3))
    return form.k * sides @ np.swapaxes(sides, 1, 2) / (4 * area) + mass


def perimeter_nodes(coarse: Triangulation, halvings: int) -> Iterator[Index]:
    """The nodes (T, 3m) around the triangles of each level, m = 1, 2, ..., anticlockwise from a corner.

    They are numbered as by `refine_triangulation`, but triangles 4t ... 4t + 3 of a level are the children of
    triangle t of the coarser one.
    """
    levels = [coarse]
    for _ in range(halvings):
        levels.append(refine_triangulation(levels[-1])[0])
    # the nodes (E, m + 1) on each edge of the level, which are its ends on the finest one
    along = levels[-1].ends
    while levels:
        triangulation = levels.pop()
        n_edges = len(triangulation.ends)
        # `refine_triangulation` puts all first children before second ones; here sisters follow one another
        order = np.arange(len(triangulation.nodes)).reshape(*[4] * len(levels), -1).T.ravel()
        if len(along) > n_edges:  # the halves of edge e are e and E + e, which meet at its midpoint
            along = np.concatenate([along[:n_edges], along[n_edges : 2 * n_edges, 1:]], axis=1)
        # edge i is opposite to node i: the one from node i to i + 1 is edge i + 2, or that turned around
        line = along[np.roll(triangulation.edges[order], 1, axis=1)]
        begins_at_node = line[..., 0] == triangulation.nodes[order]
        line = np.where(begins_at_node[..., None], line, line[..., ::-1])[..., :-1]
        yield line.reshape(len(line), -1).astype(np.intp)
