"""Nodal averages of functions that are linear on each triangle and have one mean on each edge.

These are the functions of Crouzeix and Raviart (1973). Let w be one, w_T its linear function on the triangle
T. The average Aw in V_h has at an inner node the mean of w_T over the triangles T there. At a boundary node
it has half of the sum of the means w_e over the two boundary edges there; if one of these is clamped, and the
other is not, it has the mean over that one, which is 0.

Across an edge e from a to b, run along with T on the left and T' on the right, w jumps at a and at b by

    J_e = w_T - w_T' at a = w_T' - w_T at b = (b - a) . (grad w_T' - grad w_T) / 2,

for w_T and w_T' have the same mean. At a boundary edge let w_T' be the mean w_e, and its gradient 0. So
everything that Aw differs from w by is a sum of these jumps over the edges at a node.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh


def rings(mesh: Mesh) -> tuple[Index, Index]:
    """The triangles around all nodes, those of a node one after another, anticlockwise.

    They are told by corners: corner 3 t + k is node k of triangle t. Of the corners (3m,) the ring of node a
    has those from `start[a]` to `start[a + 1]`. At a boundary node they begin with the one at the boundary
    edge that starts there. Found by the directions in which edges leave the nodes.
    """
    node = mesh.triangles.ravel()
    following = np.roll(mesh.triangles, -1, axis=1).ravel()
    first = np.full(mesh.n_nodes, -1)
    first[mesh.boundary] = np.roll(mesh.boundary, -1)
    first_angle = _edge_directions(mesh, np.arange(mesh.n_nodes), first)[node]
    angle = _edge_directions(mesh, node, following) - first_angle
    # the first edge itself has the angle 0, not 2 pi by rounding
    turned = np.where(following == first[node], 0.0, np.mod(angle, 2 * np.pi))
    corner = np.lexsort([turned, node])
    start = np.concatenate([[0], np.cumsum(np.bincount(node, minlength=mesh.n_nodes))])
    return corner, start


def _edge_directions(mesh: Mesh, start: Index, end: Index) -> Array:
    """The directions from nodes to other nodes, as angles, (k,)."""
    x, y = (mesh.points[end] - mesh.points[start]).T
    return np.arctan2(y, x)


def jump_matrix(mesh: Mesh) -> sp.csr_array:
    """The matrix from |T|^{1/2} grad w_T to all jumps J_e, (edges, 2m)."""
    # J_e = (b - a) . (grad w_T' - grad w_T) / 2: each triangle adds its part, with T on the left
    start = mesh.points[np.roll(mesh.triangles, -1, 1)]
    end = mesh.points[np.roll(mesh.triangles, -2, 1)]
    entries = (start - end) / (2 * np.sqrt(mesh.areas))[:, None, None]
    edges = mesh.opposite_edges
    components = 2 * np.arange(len(mesh.triangles))[:, None]
    rows = np.concatenate([edges, edges]).ravel()
    columns = np.concatenate([components + 0 * edges, components + 1 + 0 * edges]).ravel()
    values = np.concatenate([entries[..., 0], entries[..., 1]]).ravel()
    return sp.coo_array((values, (rows, columns))).tocsr()


def deviation_matrix(mesh: Mesh, form: Form = H1) -> sp.csr_array:
    """The matrix from |T|^{1/2} grad w_T to the values of Aw - w_T at the corners of all T, (3m, 2m)."""
    # the share s in Aw of the edge that begins at a node: 1/2, but 1 if that is clamped and the other edge is
    # not, and 0 if only the other one is
    shares = np.full(mesh.n_nodes, 0.5)
    clamped = form.clamped_edges(mesh).astype(float)
    shares[mesh.boundary] += 0.5 * (clamped - np.roll(clamped, 1))
    corner, start = rings(mesh)
    return _deviations_from_jumps(mesh, corner, start, shares) @ jump_matrix(mesh)


def _deviations_from_jumps(mesh: Mesh, corner: Index, start: Index, shares: Array) -> sp.csr_array:
    """The matrix from the jumps to the values of Aw - w_T at the corners of all T, (3m, edges).

    Let J_1, ..., J_k be the jumps on the way round an inner node, from T to T. Their sum is 0, and Aw - w_T
    is the sum of (k + 1 - 2 l) / (2 k) J_l. At a boundary node J_0, ..., J_k are those from the first edge to
    the last one. If the first one has a share s of Aw, Aw - w_T is 1 - s times the sum of those after T, less
    s times the sum of those before it.
    """
    node = mesh.triangles.ravel()[corner]
    k = np.diff(start)[node]
    place = np.arange(len(node)) - start[node]
    outer = np.isin(node, mesh.boundary)
    # a row for each corner T in its ring, with an entry for each edge l at its node: k, or k + 1 if outer
    counts = k + outer
    ends = np.concatenate([[0], np.cumsum(counts)])
    l = np.arange(ends[-1]) - np.repeat(ends[:-1], counts)  # noqa: E741
    k = np.repeat(k, counts)
    place = np.repeat(place, counts)
    outer = np.repeat(outer, counts)
    node = np.repeat(node, counts)
    # the ring's corner whose edge l is: inside counted from T on, at the boundary from the first corner
    entry = start[node] + np.where(outer, np.maximum(l - 1, 0), (place + l) % k)
    # inside (k + 1 - 2 l) / (2 k) with l from 1; at the boundary 1 - s for jumps after T, -s for those before
    values = np.where(outer, np.where(l <= place, 0.0, 1.0) - shares[node], (k - 1 - 2 * l) / (2 * k))
    # the edge that ends at the corner of its triangle; at the boundary J_0 is on the edge that starts there
    triangle, vertex = np.divmod(corner[entry], 3)
    edges = mesh.opposite_edges[triangle, (vertex + np.where(outer & (l == 0), 2, 1)) % 3].astype(np.intp)
    in_order = np.empty(len(corner), dtype=np.intp)
    shape = (len(corner), len(mesh.triangulation.ends))
    in_order[corner] = np.arange(len(corner))
    return sp.csr_array((values, edges, ends), shape=shape)[in_order]
