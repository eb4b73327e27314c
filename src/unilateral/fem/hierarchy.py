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
from unilateral.fem.edge_matrix import matrix, some_rows
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import Step


@dataclass(frozen=True, eq=False)
class FinerSpace:
    """V_l with n nodes, after V_{l-1} with the first of them.

    `ends` (o,) are the ends of the halved edges, and `P` (k, o) takes values there to those at the k new
    nodes. `smoothed` (s,) are the nodes whose hats changed, `ends` first; `columns` (c,) are the nodes that
    their rows reach, `smoothed` first; `rows` (s, c) are these rows of the matrix. If refinement was uniform,
    `smoothed` and `columns` are None, and the rows are the whole matrix. The last level of a hierarchy has no
    rows, for the hierarchy has its matrix. `step` made the level. `halved` says how often the area of each of
    its new triangles was halved. When a functional goes to the level before, each of its numbers there is a
    sum of at most `met`.
    """

    n: int
    ends: Int32
    P: sp.csr_array
    smoothed: Int32 | None
    columns: Int32 | None
    rows: sp.csr_array | None
    step: Step
    halved: Int16
    met: int

    @property
    def before(self) -> int:
        """The number of nodes of the level before."""
        return self.step.n

    def restrict(self, R: Array) -> None:
        """Turn R (n,) on the hats of this level into R on those of the level before, in place."""
        R[self.ends] += self.P.T @ R[self.before : self.n]

    def prolong(self, v: Array) -> None:
        """Give v, which has values at the nodes of the level before, those at the new nodes, in place."""
        v[self.before : self.n] = self.P @ v[self.ends]

    def sweep_down(self, S: sp.csr_array, r: Array) -> tuple[Array, Array]:
        """x (s,), a forward sweep of Gauss and Seidel from 0 for r (n,), and what is left at its nodes.

        S are the rows of a matrix at the `smoothed` nodes; S x is taken from r.
        """
        if self.smoothed is None:
            x = np.zeros(self.n)
            of = r[: self.n]
            gauss_seidel(S.indptr, S.indices, S.data, x, of, 0, self.n, 1)
            of -= S @ x
            return x, of.copy()
        assert self.columns is not None
        x = np.zeros(S.shape[1])
        k = S.shape[0]
        gauss_seidel(S.indptr, S.indices, S.data, x, r[self.smoothed], 0, k, 1)
        r[self.columns] -= S.T @ x[:k]
        return x[:k], r[self.smoothed]

    def sweep_up(self, S: sp.csr_array, e: Array, x: Array, left: Array) -> None:
        """Add x and a backward sweep for what is left (s,) to e (n,), which comes from coarser levels."""
        if self.smoothed is None:
            below = e[: self.n]
            y = np.zeros(self.n)
            left -= S @ below
            gauss_seidel(S.indptr, S.indices, S.data, y, left, self.n - 1, -1, -1)
            below += x
            below += y
            return
        y = np.zeros(S.shape[1])
        k = S.shape[0]
        left -= S @ e[self.columns]
        gauss_seidel(S.indptr, S.indices, S.data, y, left, k - 1, -1, -1)
        e[self.smoothed] += x + y[:k]

    def with_rows(self, rows: sp.csr_array) -> FinerSpace:
        """This level with the rows (s, n) of its `smoothed` nodes, or with all rows if that is None."""
        if self.smoothed is None:
            return replace(self, rows=rows)
        touched = np.zeros(self.n, dtype=bool)
        touched[rows.indices] = True
        touched[self.smoothed] = False
        columns = np.concatenate([self.smoothed, np.flatnonzero(touched).astype(np.int32)])
        place = np.empty(self.n, dtype=np.int32)
        place[columns] = np.arange(len(columns), dtype=np.int32)
        shape = (len(self.smoothed), len(columns))
        rows = sp.csr_array((rows.data, place[rows.indices], rows.indptr), shape=shape)
        return replace(self, columns=columns, rows=rows)


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The levels 1, ..., L, and A (n, n) on the last one, each row beginning with the diagonal.

    `coarse` is the mesh of level 0, `A_0` its matrix, which `coarsest` factorises. `sums` (n,) are those of
    A's rows, and `mass` (n,) are numbers m_i with sum m_i v_i^2 <= 4 ||v||^2; `boundary` (nb,) and `s` (nb +
    1,) are as in `Mesh`. The last level has the triangles `nodes` (T, 3). They lie in the triangles `root`
    (T,) of level 0, whose areas were halved `halved` (T,) times. The nodes `fixed` (n,) lie on clamped sides.
    """

    coarse: Mesh
    A_0: sp.csr_array
    coarsest: SuperLU
    levels: Sequence[FinerSpace]
    A: sp.csr_array
    sums: Array
    mass: Array
    boundary: Index
    s: Array
    nodes: Int32
    root: Int32
    halved: Int16
    form: Form
    fixed: Mask

    @property
    def n(self) -> int:
        return int(self.A.shape[0])

    @cached_property
    def roundness(self) -> Array:
        """The ratio of the singular values of the map from a right and isosceles triangle, on level 0.

        r + 1/r = |J|^2 / det J for the map J; its columns are the edges at the first node.
        """
        a, b, c = self.coarse.points[self.coarse.triangulation.nodes.T]
        both = (((b - a) ** 2).sum(axis=1) + ((c - a) ** 2).sum(axis=1)) / (2 * self.coarse.areas)
        return np.asarray(2 / (both + np.sqrt(np.maximum(both**2 - 4, 0))))

    @cached_property
    def smoothed(self) -> Int32:
        """The inner nodes whose hats the last level has changed; none on level 0."""
        if not self.levels:
            return np.zeros(0, dtype=np.int32)
        of = self.levels[-1].smoothed
        inside = np.zeros(self.n, dtype=bool)
        inside[slice(None) if of is None else of] = True
        inside[self.boundary] = False
        return np.flatnonzero(inside).astype(np.int32)

    @cached_property
    def coarser(self) -> Hierarchy | None:
        """The hierarchy of the level before, without its triangles.

        None unless the last step was uniform and the matrix before it is whole.
        """
        if not self.levels or any(level.smoothed is not None for level in self.levels[-2:]):
            return None
        *levels, last = self.levels
        n = last.before
        A = levels[-1].rows if levels else self.A_0
        assert A is not None
        kept = np.flatnonzero(self.boundary < n)
        mass = self.mass.copy()
        last.restrict(mass)
        sums = np.asarray(A.sum(axis=1)) if self.form.clamped else mass[:n]
        s = np.append(self.s[kept], self.s[-1])
        of_nodes: dict[str, Any] = {"sums": sums, "mass": mass[:n], "fixed": self.fixed[:n]}
        return replace(self, levels=levels, A=A, boundary=self.boundary[kept], s=s, **of_nodes)


def hierarchy(mesh: Mesh, known: Hierarchy | None = None, form: Form = H1) -> Hierarchy:
    """The levels from the coarse mesh that it was refined from, to the mesh itself.

    Those that are known of a mesh from which this one was refined are taken over.
    """
    found = known or _on_level_0(mesh.coarse or mesh, form)
    steps = mesh.steps[len(found.levels) :]
    if not steps:
        return found
    levels = [*found.levels]
    nodes = found.nodes
    root = found.root
    halved = found.halved
    form = found.form
    fixed = found.form.fixed(mesh)
    if levels:
        smoothed = levels[-1].smoothed
        levels[-1] = levels[-1].with_rows(found.A if smoothed is None else found.A[smoothed])
    for step in steps:
        more = halved[step.parent] + step.halved
        nodes = step.put(nodes, step.nodes)
        root = step.inherited(root)
        halved = step.put(halved, more)
        level = _level(step, more, fixed)
        if step is not steps[-1]:
            level = level.with_rows(_rows(level, mesh.points, nodes, form, fixed))
        levels.append(level)
    of_mesh = _of_mesh(mesh, form)
    return replace(found, levels=levels, nodes=nodes, root=root, halved=halved, **of_mesh)


def _of_mesh(mesh: Mesh, form: Form) -> dict[str, Any]:
    """The fields that belong to the mesh of the last level."""
    fixed = form.fixed(mesh)
    A, sums, mass = matrix(mesh.triangulation, mesh.points, form, fixed)
    mass *= form.coercivity
    return {"A": A, "sums": sums, "mass": mass, "fixed": fixed, "boundary": mesh.boundary, "s": mesh.s}


def _rows(level: FinerSpace, points: Array, nodes: Int32, form: Form, fixed: Mask) -> sp.csr_array:
    """The rows of a level whose triangles have those nodes (T, 3)."""
    fixed = fixed[: level.n]
    if level.step.after:
        return matrix(level.step.after, points, form, fixed)[0]
    assert level.smoothed is not None
    return some_rows(points, nodes, level.smoothed, level.n, form, fixed)


def _on_level_0(mesh: Mesh, form: Form) -> Hierarchy:
    tri = mesh.triangulation
    known = _of_mesh(mesh, form)
    root = np.arange(len(tri.nodes), dtype=np.int32)
    halved = np.zeros(len(tri.nodes), dtype=np.int16)
    level_0 = mesh, known["A"], splu(known["A"].tocsc())
    return Hierarchy(*level_0, [], **known, nodes=tri.nodes, root=root, halved=halved, form=form)


def _level(step: Step, halved: Int16, fixed: Mask) -> FinerSpace:
    """The level that a step makes, without its rows; some of the nodes (n,) are `fixed`."""
    n = step.n
    k = len(step.ends)
    changed = np.zeros(n, dtype=bool)
    changed[step.ends] = True
    ends = np.flatnonzero(changed).astype(np.int32)
    place = np.empty(n, dtype=np.int32)
    place[ends] = np.arange(len(ends), dtype=np.int32)
    start = np.arange(0, 2 * k + 1, 2, dtype=np.int32)
    half = np.where(fixed[step.ends.ravel()], 0.0, 0.5)
    P = sp.csr_array((half, place[step.ends.ravel()], start), shape=(k, len(ends)))
    smoothed = None if step.after else np.concatenate([ends, np.arange(n, n + k, dtype=np.int32)])
    met = 1 + int(np.bincount(P.indices).max())
    return FinerSpace(n + k, ends, P, smoothed, None, None, step, halved, met)
