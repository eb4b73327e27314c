"""f enclosed on a mesh that shares triangles with one on which it is already: only on the others anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.source import Source, enclosed
from unilateral.geometry.mesh import Mesh
from unilateral.problems.data import Data


def kept(before: Source, mesh: Mesh, data: Data) -> Source:
    """f on the mesh, whose nodes are those of the one before, with their numbers, and new ones."""
    (old, of_old), (new, of_new) = (_sorted(each.triangles, mesh.n_nodes) for each in (before.mesh, mesh))
    _, from_old, to_new = np.intersect1d(old, new, assume_unique=True, return_indices=True)
    anew = np.setdiff1d(np.arange(len(new)), to_new)
    if anew.size == 0:
        return before
    part = replace(mesh, triangles=mesh.triangles[anew], coarse=None, halvings=0)
    fresh = enclosed(part, data)

    def joined(of_before: Array, of_fresh: Array) -> Array:
        found = np.empty((len(new), *of_fresh.shape[1:]))
        found[anew], found[to_new] = of_fresh, of_before[from_old]
        return found

    def at_corners(of_before: Array, of_fresh: Array) -> Array:
        in_order = (np.take_along_axis(of_before, of_old, 1), np.take_along_axis(of_fresh, of_new[anew], 1))
        found = np.empty((len(new), 3))
        np.put_along_axis(found, of_new, joined(*in_order), axis=1)
        return found

    return Source(
        mesh,
        at_corners(before.f_h, fresh.f_h),
        at_corners(before.moments, fresh.moments),
        joined(before.oscillation, fresh.oscillation),
        joined(before.rest, fresh.rest),
        before.resolved and fresh.resolved,
    )


def _sorted(triangles: Index, n: int) -> tuple[Index, Index]:
    """(m,) a number for the three nodes of each triangle, and (m, 3) their order."""
    order = np.argsort(triangles, axis=1)
    a, b, c = np.take_along_axis(triangles, order, axis=1).T.astype(np.int64)
    return (a * n + b) * n + c, order
