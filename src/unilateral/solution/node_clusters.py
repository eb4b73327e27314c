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
    # each node's square of a grid, and its rank among the nodes there: vertex, boundary, inside
    column, row = np.floor((mesh.points - mesh.points.min(axis=0)) / size).astype(np.int64).T
    rank = np.full(mesh.n_nodes, 2)
    rank[mesh.boundary] = 1
    rank[mesh.boundary[np.isin(mesh.s[:-1], mesh.polygon.starts)]] = 0
    # the first node of each square, in the order of rank, stands for all of them
    order = np.lexsort([rank, row, column])
    is_first = (np.diff(column[order], prepend=-1) != 0) | (np.diff(row[order], prepend=-1) != 0)
    representatives = order[is_first]
    cluster = np.empty(mesh.n_nodes, dtype=np.intp)
    cluster[order] = np.cumsum(is_first) - 1
    corners = cluster[mesh.triangles]
    proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    first = corners[proper].argmin(axis=1)[:, None]  # the same corners in the same order count once
    turned = np.take_along_axis(corners[proper], (first + np.arange(3)) % 3, axis=1)
    return representatives, np.unique(turned, axis=0)
