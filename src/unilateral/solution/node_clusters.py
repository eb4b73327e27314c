"""A coarser surface of a solution, for what cannot show as many triangles as its mesh has."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Index
from unilateral.geometry.mesh import Mesh


def cluster_nodes(mesh: Mesh, max_triangles: int) -> tuple[Index, Index]:
    """Some nodes (k,) of a mesh, and triangles (j, 3) between them: at most about `max_triangles`.

    The nodes in a square of a grid become one of them, if possible one on the boundary, and best a vertex of
    the polygon. Triangles that are no longer any are left out. These are Rossignac and Borrel's clusters
    (Multi-resolution 3D approximations for rendering complex scenes, 1993).
    """
    if len(mesh.triangles) <= max_triangles:
        return np.arange(mesh.n_nodes), mesh.triangles
    size = np.sqrt(2 * mesh.polygon.area / max_triangles)  # a square has two triangles
    column, row = np.floor((mesh.points - mesh.points.min(axis=0)) / size).astype(np.int64).T
    rank = np.full(mesh.n_nodes, 2)
    rank[mesh.boundary] = 1
    rank[mesh.boundary[np.isin(mesh.s[:-1], mesh.polygon.starts)]] = 0
    order = np.lexsort([rank, row, column])
    new = (np.diff(column[order], prepend=-1) != 0) | (np.diff(row[order], prepend=-1) != 0)
    representatives = order[new]
    cluster = np.empty(mesh.n_nodes, dtype=np.intp)
    cluster[order] = np.cumsum(new) - 1
    corners = cluster[mesh.triangles]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    first = corners[proper].argmin(axis=1)[:, None]  # the same corners in the same order count once
    turned = np.take_along_axis(corners[proper], (first + np.arange(3)) % 3, axis=1)
    return representatives, np.unique(turned, axis=0)
