"""The spokes of the nodes of a mesh: from each along all of its edges, anticlockwise.

Spoke 2 e + i goes from end i of edge e to the other one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from unilateral.arrays import Int32
from unilateral.geometry.mesh import Mesh

CHUNK = 4096
"""Patches, or twice as many triangles, at a time: their numbers fit into a processor's cache."""


def around(mesh: Mesh) -> tuple[Int32, Int32]:
    """Of spokes (2 E,) the corner to the left of each, and the next spoke anticlockwise.

    Corner 3 t + i is that of triangle t at its node i. There is no triangle to the left of spokes that run
    back along the boundary.
    """
    ends = mesh.triangulation.ends
    corner, after = np.zeros((2, 2 * len(ends)), dtype=np.int32)
    for begin in range(0, len(mesh.triangles), 2 * CHUNK):
        node, edge = (each[begin : begin + 2 * CHUNK].T for each in (mesh.triangles, mesh.opposite_edges))
        spokes = [2 * e + (ends[e, 0] != a) for e, a in zip(edge[[2, 0, 1]], node, strict=True)]
        for i, spoke in enumerate(spokes):
            corner[spoke] = np.arange(3 * begin + i, 3 * (begin + len(spoke)), 3)
            after[spoke] = spokes[i - 1] ^ 1
    return corner, after


def fans(mesh: Mesh, after: Int32) -> Iterator[tuple[Int32, Int32]]:
    """Of p nodes with k triangles around each the spokes (k + 1, p), anticlockwise, a chunk after the other.

    The last spoke of a node inside is its first one again. With them the numbers (p,) of nodes along the
    boundary, or none (0,).
    """
    ends, n, nb = mesh.triangulation.ends.ravel(), mesh.n_nodes, len(mesh.boundary)
    first, number, kind = *np.empty((2, n), dtype=np.int32), 2 * np.bincount(ends, minlength=n)
    first[ends] = np.arange(len(ends), dtype=np.int32)
    first[mesh.boundary], number[mesh.boundary] = 2 * mesh.triangulation.boundary, np.arange(nb)
    kind[mesh.boundary] -= 1
    for which in np.flatnonzero(np.bincount(kind)):
        nodes, k = np.flatnonzero(kind == which), which // 2
        for begin in range(0, len(nodes), CHUNK):
            part = nodes[begin : begin + CHUNK]
            fan = np.empty((k + 1, len(part)), dtype=np.int32)
            fan[0] = first[part]
            for j in range(k):
                fan[j + 1] = after.take(fan[j])
            yield number[part[: len(part) * (which % 2)]], fan
