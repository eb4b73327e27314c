"""The cells of T_H, the multiplier's partition of the boundary, on meshes refined where it is needed.

Places on the boundary are whole numbers: every edge of the first mesh is UNIT long, and edges 0 and 1, 2 and
3, .. of it lie in one cell. So an edge of any later mesh is a dyadic interval. It asks for its parent, which
is twice as long; of nested parents the largest is a cell of T_H. Every edge that meets a cell is then at most
half of it, which keeps the pair of spaces stable. Where an edge is shorter than a quarter of its cell, the
cell's longest edges are halved, too; else edges in geometric progression would be one cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.mesh import ROUNDED, Mesh, halved, refine_some
from unilateral.geometry.partition import Partition

UNIT = 2**44
"""The length of an edge of the first mesh; 2^19 such edges reach the limit of 64-bit integers.

Rounding ends the halving of an edge before its length is 1.
"""
SHORTEST = 4
"""A cell may be at most this many times as long as its shortest edge."""
BULK = 0.5
"""The shares of the marked triangles are to be at least this part of the sum of all shares."""


@dataclass(frozen=True, eq=False)
class AdaptedMesh:
    """A mesh whose boundary edge k lies between the places at[k] and at[k + 1], `at` (nb + 1,)."""

    mesh: Mesh
    at: Index

    @cached_property
    def cell(self) -> Index:
        """(nb,) the cell of each boundary edge."""
        length = np.diff(self.at)
        begin = self.at[:-1] // (2 * length) * (2 * length)
        order = np.lexsort([-length, begin])
        reach = np.maximum.accumulate((begin + 2 * length)[order])
        cell = np.empty(len(order), dtype=np.intp)
        cell[order] = np.cumsum(np.append(True, begin[order][1:] >= reach[:-1])) - 1
        return cell

    @cached_property
    def partition(self) -> Partition:
        first = np.flatnonzero(np.append(True, np.diff(self.cell) > 0))
        return Partition(self.mesh.polygon, self.mesh.s[np.append(first, -1)])

    @property
    def unbalanced(self) -> Index:
        """The triangles at boundary edges that are too long beside a shorter edge of the same cell."""
        length = np.diff(self.at)
        total, shortest = np.zeros((2, self.cell[-1] + 1), dtype=np.int64)
        np.add.at(total, self.cell, length)
        shortest[:] = total
        np.minimum.at(shortest, self.cell, length)
        long = (2 * length >= total[self.cell]) & (total > SHORTEST * shortest)[self.cell]
        return self.mesh.boundary_triangles[long]


def adapted(mesh: Mesh) -> AdaptedMesh:
    """The first mesh: its boundary edges 0 and 1, 2 and 3, .., each pair of one length, make the cells."""
    return AdaptedMesh(mesh, UNIT * np.arange(len(mesh.s), dtype=np.int64))


def marked(mesh: Mesh, shares: Array) -> Index:
    """The fewest triangles with the part BULK of the sum of all shares (m,) (Doerfler, SINUM 33, 1996).

    Triangles whose edges are as short as rounding are left out. Raises InputError if none remains.
    """
    shortest = float(np.spacing(mesh.polygon.largest)) / ROUNDED
    order = np.argsort(-shares, kind="stable")
    largest = order[: np.searchsorted(np.cumsum(shares[order]), BULK * shares.sum()) + 1]
    largest = largest[mesh.longest_edges[largest] > shortest]
    if largest.size == 0:
        raise InputError(
            f"the triangles of '{mesh.polygon.name}' from which most of the bound comes have edges of "
            f"{shortest:.2g}, as short as rounding allows; take a larger accuracy"
        )
    return largest


def divided(of: AdaptedMesh, halvings: Index) -> AdaptedMesh:
    """The mesh with the edges of each triangle halved `halvings` (m,) times, and others as that needs."""
    wanted = halvings
    while (chosen := np.flatnonzero(wanted > 0)).size:
        before = len(of.mesh.steps)
        of = _refined(of, chosen)
        (step,) = of.mesh.steps[before:]
        wanted = step.put(wanted, wanted[step.parent] - 1)
    return refined(of, of.unbalanced)


def refined(of: AdaptedMesh, chosen: Index) -> AdaptedMesh:
    """The mesh with the chosen triangles cut in four, and others as that needs. Raises as `refine_some`."""
    while chosen.size:
        of = _refined(of, chosen)
        chosen = of.unbalanced
    return of


def _refined(of: AdaptedMesh, chosen: Index) -> AdaptedMesh:
    mesh = refine_some(of.mesh, chosen)
    before = halved(mesh.boundary, of.mesh.n_nodes)
    return AdaptedMesh(mesh, np.insert(of.at, before + 1, (of.at[before] + of.at[before + 1]) // 2))
