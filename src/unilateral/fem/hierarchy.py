"""Nested spaces V_0, ..., V_L on a mesh that was made by refinement, uniform or not.

Nodes keep their numbers, so one vector (n,) holds the values on all levels: V_l has the first of them. A
level knows the nodes whose hats changed and the rows of the matrix of the form that belong to them. These
nodes are new, or ends of edges that were halved. Where refinement was uniform they are all nodes. Vectors
are 0 at nodes on clamped sides; matrices are as `form` has them, and P is 0 at such nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from pyamg.amg_core import gauss_seidel
from scipy.sparse.linalg import SuperLU, splu

from unilateral.arrays import Array, Index, Int16, Int32, Mask
from unilateral.fem.edge_matrix import assemble_by_edges, assemble_rows
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import RefinementStep


@dataclass(frozen=True, eq=False)
class FinerSpace:
    """V_l with n nodes, after V_{l-1} with the first of them.

    `ends` (o,) are the ends of the halved edges, and `P` (k, o) takes values there to those at the k new
    nodes. `smoothed_nodes` (s,) are the nodes whose hats changed, `ends` first; `columns` (c,) are the nodes
    that their rows reach, `smoothed_nodes` first; `rows` (s, c) are these rows of the matrix. If refinement
    was uniform, `smoothed_nodes` and `columns` are None, and the rows are the whole matrix. The last level of
    a hierarchy has no rows, for the hierarchy has its matrix. `step` made the level. `area_halvings` says how
    often areas were halved from level 0 to each of its new triangles. When a functional goes to the level
    before, each of its numbers there is a sum of at most `max_summands`.
    """

    n: int
    ends: Int32
    P: sp.csr_array
    smoothed_nodes: Int32 | None
    columns: Int32 | None
    rows: sp.csr_array | None
    step: RefinementStep
    area_halvings: Int16
    max_summands: int

    @property
    def n_coarse(self) -> int:
        """The number of nodes of the level before."""
        return self.step.n_old_nodes

    def restrict(self, R: Array) -> None:
        """Turn R (n,) on the hats of this level into R on those of the level before, in place."""
        R[self.ends] += self.P.T @ R[self.n_coarse : self.n]

    def prolong(self, v: Array) -> None:
        """Give v, which has values at the nodes of the level before, those at the new nodes, in place."""
        v[self.n_coarse : self.n] = self.P @ v[self.ends]

    def sweep_down(self, rows: sp.csr_array, r: Array) -> tuple[Array, Array]:
        """x (s,), a forward sweep of Gauss and Seidel from 0 for r (n,), and what is left at its nodes.

        `rows` are those of a symmetric matrix at the `smoothed_nodes`. Its product with x is taken from r.
        """
        if self.smoothed_nodes is None:
            x = np.zeros(self.n)
            level_r = r[: self.n]
            gauss_seidel(rows.indptr, rows.indices, rows.data, x, level_r, 0, self.n, 1)
            level_r -= rows @ x
            return x, level_r.copy()
        assert self.columns is not None
        # the rows reach further nodes, at which x is 0
        x = np.zeros(rows.shape[1])
        k = rows.shape[0]
        gauss_seidel(rows.indptr, rows.indices, rows.data, x, r[self.smoothed_nodes], 0, k, 1)
        r[self.columns] -= rows.T @ x[:k]
        return x[:k], r[self.smoothed_nodes]

    def sweep_up(self, rows: sp.csr_array, e: Array, x: Array, residual: Array) -> None:
        """Add x and a backward sweep to the correction e (n,), which comes from coarser levels, in place.

        x and the `residual` (s,) that it leaves are those of `sweep_down`; the residual is overwritten.
        """
        if self.smoothed_nodes is None:
            level_e = e[: self.n]
            y = np.zeros(self.n)
            residual -= rows @ level_e
            gauss_seidel(rows.indptr, rows.indices, rows.data, y, residual, self.n - 1, -1, -1)
            level_e += x
            level_e += y
            return
        y = np.zeros(rows.shape[1])
        k = rows.shape[0]
        residual -= rows @ e[self.columns]
        gauss_seidel(rows.indptr, rows.indices, rows.data, y, residual, k - 1, -1, -1)
        e[self.smoothed_nodes] += x + y[:k]

    def attach_rows(self, rows: sp.csr_array) -> FinerSpace:
        """The level with the rows (s, n) of its `smoothed_nodes`, or with all rows if these are None."""
        if self.smoothed_nodes is None:
            return replace(self, rows=rows)
        touched = np.zeros(self.n, dtype=bool)
        touched[rows.indices] = True
        touched[self.smoothed_nodes] = False
        # columns are numbered anew: the smoothed nodes, as the rows, then the others that rows reach
        columns = np.concatenate([self.smoothed_nodes, np.flatnonzero(touched).astype(np.int32)])
        place = np.empty(self.n, dtype=np.int32)
        place[columns] = np.arange(len(columns), dtype=np.int32)
        shape = (len(self.smoothed_nodes), len(columns))
        rows = sp.csr_array((rows.data, place[rows.indices], rows.indptr), shape=shape)
        return replace(self, columns=columns, rows=rows)


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The levels 1, ..., L, and A (n, n) on the last one, each row beginning with the diagonal.

    `coarse_mesh` is the mesh of level 0, `A_0` its matrix, which `coarse_factors` factorises. `row_sums` (n,)
    are those of A's rows, and `nodal_weights` (n,) are numbers m_i with sum m_i v_i^2 <= 4 ||v||^2;
    `boundary` (nb,) and `s` (nb + 1,) are as in `Mesh`. The last level has the `triangles` (T, 3), each in
    the triangle `coarse_triangle` (T,) of level 0, whose area was halved `area_halvings` (T,) times.
    `clamped_nodes` (n,) says which nodes lie on clamped sides.
    """

    coarse_mesh: Mesh
    A_0: sp.csr_array
    coarse_factors: SuperLU
    levels: Sequence[FinerSpace]
    A: sp.csr_array
    row_sums: Array
    nodal_weights: Array
    boundary: Index
    s: Array
    triangles: Int32
    coarse_triangle: Int32
    area_halvings: Int16
    form: Form
    clamped_nodes: Mask

    @property
    def n(self) -> int:
        """The number of nodes of the last level."""
        return int(self.A.shape[0])

    @cached_property
    def roundness(self) -> Array:
        """The ratio of the singular values of the map from a right and isosceles triangle, on level 0.

        r + 1/r = |J|^2 / det J for the map J; its columns are the edges at the first node.
        """
        # r <= 1 is the smaller root; det J is twice the area
        a, b, c = self.coarse_mesh.points[self.coarse_mesh.triangulation.nodes.T]
        ratio_sum = (((b - a) ** 2).sum(axis=1) + ((c - a) ** 2).sum(axis=1)) / (2 * self.coarse_mesh.areas)
        return np.asarray(2 / (ratio_sum + np.sqrt(np.maximum(ratio_sum**2 - 4, 0))))

    @cached_property
    def smoothed_nodes(self) -> Int32:
        """The inner nodes whose hats the last level has changed; none on level 0."""
        if not self.levels:
            return np.zeros(0, dtype=np.int32)
        nodes = self.levels[-1].smoothed_nodes
        inside = np.zeros(self.n, dtype=bool)
        inside[slice(None) if nodes is None else nodes] = True
        inside[self.boundary] = False
        return np.flatnonzero(inside).astype(np.int32)

    @cached_property
    def coarser(self) -> Hierarchy | None:
        """The hierarchy of the level before, without its triangles.

        None unless the last step was uniform and the matrix before it is whole.
        """
        if not self.levels or any(level.smoothed_nodes is not None for level in self.levels[-2:]):
            return None
        *levels, last = self.levels
        n = last.n_coarse
        A = levels[-1].rows if levels else self.A_0
        assert A is not None
        coarse_boundary = np.flatnonzero(self.boundary < n)
        # a coarse hat is the sum of the finer ones in it, each times its value: so is its lumped mass
        mass = self.nodal_weights.copy()
        last.restrict(mass)
        # without clamped sides the coercivity is c, and rows of A add up to c times the lumped mass
        sums = np.asarray(A.sum(axis=1)) if self.form.clamped else mass[:n]
        s = np.append(self.s[coarse_boundary], self.s[-1])
        return replace(
            self,
            levels=levels,
            A=A,
            boundary=self.boundary[coarse_boundary],
            s=s,
            row_sums=sums,
            nodal_weights=mass[:n],
            clamped_nodes=self.clamped_nodes[:n],
        )


def build_hierarchy(mesh: Mesh, previous: Hierarchy | None = None, form: Form = H1) -> Hierarchy:
    """The levels from the coarse mesh that a mesh was refined from, to the mesh itself.

    Those of the `previous` hierarchy, and its form, are taken over; this mesh was refined from its mesh.
    """
    hierarchy = previous or _build_level_0(mesh.coarse or mesh, form)
    steps = mesh.steps[len(hierarchy.levels) :]
    if not steps:
        return hierarchy
    levels = [*hierarchy.levels]
    triangles = hierarchy.triangles
    coarse_triangle = hierarchy.coarse_triangle
    area_halvings = hierarchy.area_halvings
    form = hierarchy.form
    clamped_nodes = hierarchy.form.clamped_nodes(mesh)
    if levels:
        smoothed = levels[-1].smoothed_nodes
        # it was the last level, which has no rows of its own
        levels[-1] = levels[-1].attach_rows(hierarchy.A if smoothed is None else hierarchy.A[smoothed])
    for step in steps:
        # triangles of this step: their nodes, their triangle of level 0, and how often that was halved
        child_halvings = area_halvings[step.parent] + step.halvings_from_parent
        triangles = step.replace_values(triangles, step.nodes)
        coarse_triangle = step.inherit(coarse_triangle)
        area_halvings = step.replace_values(area_halvings, child_halvings)
        level = _build_level(step, child_halvings, clamped_nodes)
        if step is not steps[-1]:
            rows = _assemble_level_rows(level, mesh.points, triangles, form, clamped_nodes)
            level = level.attach_rows(rows)
        levels.append(level)
    return replace(
        hierarchy,
        levels=levels,
        triangles=triangles,
        coarse_triangle=coarse_triangle,
        area_halvings=area_halvings,
        **_finest_fields(mesh, form),
    )


def _finest_fields(mesh: Mesh, form: Form) -> dict[str, Any]:
    """The fields of a `Hierarchy` that belong to the mesh of the last level, by their names."""
    clamped_nodes = form.clamped_nodes(mesh)
    A, sums, mass = assemble_by_edges(mesh.triangulation, mesh.points, form, clamped_nodes)
    mass *= form.coercivity
    return {
        "A": A,
        "row_sums": sums,
        "nodal_weights": mass,
        "clamped_nodes": clamped_nodes,
        "boundary": mesh.boundary,
        "s": mesh.s,
    }


def _assemble_level_rows(
    level: FinerSpace, points: Array, triangles: Int32, form: Form, clamped_nodes: Mask
) -> sp.csr_array:
    """The matrix's rows at the `smoothed_nodes`, or all; `triangles` (T, 3) are those of the level."""
    clamped_nodes = clamped_nodes[: level.n]
    if level.step.refined_triangulation:
        return assemble_by_edges(level.step.refined_triangulation, points, form, clamped_nodes)[0]
    assert level.smoothed_nodes is not None
    return assemble_rows(points, triangles, level.smoothed_nodes, level.n, form, clamped_nodes)


def _build_level_0(mesh: Mesh, form: Form) -> Hierarchy:
    """The hierarchy of a mesh that was not refined."""
    nodes = mesh.triangulation.nodes
    fields = _finest_fields(mesh, form)
    return Hierarchy(
        coarse_mesh=mesh,
        A_0=fields["A"],
        coarse_factors=splu(fields["A"].tocsc()),
        levels=[],
        **fields,
        triangles=nodes,
        coarse_triangle=np.arange(len(nodes), dtype=np.int32),
        area_halvings=np.zeros(len(nodes), dtype=np.int16),
        form=form,
    )


def _build_level(step: RefinementStep, area_halvings: Int16, clamped_nodes: Mask) -> FinerSpace:
    """The level that a step makes, without its rows; some of the nodes (n,) are `clamped_nodes`.

    `area_halvings` are those of the step's new triangles, since level 0.
    """
    n = step.n_old_nodes
    k = len(step.ends)
    changed = np.zeros(n, dtype=bool)
    changed[step.ends] = True
    ends = np.flatnonzero(changed).astype(np.int32)
    place = np.empty(n, dtype=np.int32)
    place[ends] = np.arange(len(ends), dtype=np.int32)
    # the value at a new node is the mean of those at the two ends of its edge, 0 at clamped ends
    start = np.arange(0, 2 * k + 1, 2, dtype=np.int32)
    half = np.where(clamped_nodes[step.ends.ravel()], 0.0, 0.5)
    P = sp.csr_array((half, place[step.ends.ravel()], start), shape=(k, len(ends)))
    smoothed = (
        None if step.refined_triangulation else np.concatenate([ends, np.arange(n, n + k, dtype=np.int32)])
    )
    # a restricted number is that of the node itself and halves of those at the midpoints around it
    max_summands = 1 + int(np.bincount(P.indices).max())
    return FinerSpace(
        n=n + k,
        ends=ends,
        P=P,
        smoothed_nodes=smoothed,
        columns=None,
        rows=None,
        step=step,
        area_halvings=area_halvings,
        max_summands=max_summands,
    )
