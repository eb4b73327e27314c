"""The spokes of the nodes of a mesh: from each along all of its edges, anticlockwise.

Spoke 2 e + i goes from end i of edge e to the other one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from unilateral.arrays import Array, Int32, blocks
from unilateral.geometry.mesh import Mesh

CHUNK = 4096
"""This many patches, or twice as many triangles, are treated together.

Their numbers fit into a processor's cache.
"""


def around(mesh: Mesh, of_corners: Callable[[slice], Array]) -> tuple[Int32, Array]:
    """(2 E,), (2 E,) for each spoke the next one anticlockwise and `of_corners` (k, 3) at the corner between.

    Behind spokes that run back along the boundary there is neither: both are 0.
    """
    ends = mesh.triangulation.ends
    after, found = np.zeros(2 * len(ends), dtype=np.int32), np.zeros(2 * len(ends))
    for of in blocks(len(mesh.triangles), 2 * CHUNK):
        node, edge, values = mesh.triangles[of].T, mesh.opposite_edges[of].T, of_corners(of).T
        spokes = [2 * e + (ends[e, 0] != a) for e, a in zip(edge[[2, 0, 1]], node, strict=True)]
        for i, spoke in enumerate(spokes):
            found[spoke] = values[i]
            after[spoke] = spokes[i - 1] ^ 1
    return after, found


def fans(mesh: Mesh, after: Int32) -> Iterator[tuple[Int32, Int32]]:
    """The spokes (k + 1, p) of p nodes with k triangles around each, anticlockwise, one chunk after another.

    The last spoke of a node inside is its first one again. Before the spokes come the numbers (p,) of the
    nodes along the boundary, or none (0,) for nodes inside.
    """
    ends, n, nb = mesh.triangulation.ends.ravel(), mesh.n_nodes, len(mesh.boundary)
    first, number, kind = *np.empty((2, n), dtype=np.int32), 2 * np.bincount(ends, minlength=n)
    first[ends] = np.arange(len(ends), dtype=np.int32)
    first[mesh.boundary], number[mesh.boundary] = 2 * mesh.triangulation.boundary, np.arange(nb)
    kind[mesh.boundary] -= 1
    for which in np.flatnonzero(np.bincount(kind)):
        nodes, k = np.flatnonzero(kind == which), which // 2
        for part in (nodes[of] for of in blocks(len(nodes), CHUNK)):
            fan = np.empty((k + 1, len(part)), dtype=np.int32)
            fan[0] = first[part]
            for j in range(k):
                fan[j + 1] = after.take(fan[j])
            yield number[part[: len(part) * (which % 2)]], fan
