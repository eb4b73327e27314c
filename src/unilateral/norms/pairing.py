"""The pairing in the proof of Theorem 5: P0(T_H) with functions that are linear between inner nodes.

One node in each cell is kept, that of `inner_nodes`. V holds the continuous functions on the boundary that
are linear in arc length from one kept node to the next; they are traces of functions in V_h.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from unilateral.arrays import Array
from unilateral.fem.condense import matrix
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.resolution import inner_nodes


def pairing(nodes: Array, partition: Partition) -> Array:
    """(m, m) M with <mu, v> = sum_i H_i mu_i (M y)_i for v in V with the values y (m,) at nodes (m,).

    M = diag(H_i)^{-1} B, B the integrals of V's hats over the cells; node i lies inside cell i.
    """
    before, after = nodes - partition.points[:-1], partition.points[1:] - nodes
    between = after + np.roll(before, -1)
    next_one = after**2 / (2 * between * partition.lengths)
    last_one = before**2 / (2 * np.roll(between, 1) * partition.lengths)
    one = np.eye(len(nodes))
    return (
        np.diag(1 - next_one - last_one)
        + next_one[:, None] * np.roll(one, 1, axis=1)
        + last_one[:, None] * np.roll(one, -1, axis=1)
    )


def pairing_constant(s: Array, partition: Partition) -> float:
    """The smallest singular value of M for mesh nodes s (nb + 1,); NaN where a cell has none inside."""
    nodes, deltas = inner_nodes(s, partition)
    if not deltas.all():
        return math.nan
    return float(np.linalg.svd(pairing(nodes, partition), compute_uv=False)[-1])


def least_pairing_constant(delta: Array) -> Array:
    """(...) the bound delta/4 of the proof of Theorem 5, (6), whatever the lengths of the cells.

    The values w of v at the cells' ends solve K w = 2 (q_i m_i + p_i m_{i+1}), m the means M y. K is
    diagonally dominant by 2 delta in rows and by delta in columns.
    """
    return 0.25 * delta


def certified_cellwise(mesh: Mesh, partition: Partition) -> float:
    """A guaranteed lower bound on `infsup.cellwise`, without a solution; 0 where a cell has no node inside.

    For mu let y = M^{-1} z, z_i = H_i mu_i, and v = W y in V_h. Then <mu, v> = |z|^2, |y| <= |z| / sigma with
    the pairing constant sigma, and ||v||_1^2 = y . W^T A W y <= E |y|^2 with E the largest row sum of
    |W^T A W|. So the supremum is at least sigma |z| / E^{1/2}, whatever `extended` is.
    """
    sigma = pairing_constant(mesh.s, partition)
    if math.isnan(sigma):
        return 0.0
    W = extended(mesh, inner_nodes(mesh.s, partition)[0])
    return sigma / math.sqrt(abs(W.T @ matrix(mesh) @ W).sum(axis=1).max())


def extended(mesh: Mesh, nodes: Array) -> sp.csr_array:
    """W (n, m): nodal values of functions in V_h whose traces are the hats of V at the boundary nodes (m,).

    From every boundary node they fall linearly, by 1 over the shorter half of the hat's support.
    """
    widths = np.diff(nodes, append=nodes[0] + mesh.polygon.perimeter)
    before = (np.searchsorted(nodes, mesh.s[:-1], side="right") - 1) % len(nodes)
    t = (mesh.s[:-1] - nodes[before]) % mesh.polygon.perimeter / widths[before]
    at, values = np.tile(mesh.boundary, 2), np.concatenate([1 - t, t])
    hat = np.concatenate([before, (before + 1) % len(nodes)])
    reach = np.minimum(widths, np.roll(widths, 1))[hat]
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    near = cKDTree(mesh.points[inside]).query_ball_point(mesh.points[at], reach * values)
    of = np.repeat(np.arange(len(at)), [len(each) for each in near])
    to = inside[np.concatenate([*near, []]).astype(np.intp)]
    left = values[of] - np.linalg.norm(mesh.points[to] - mesh.points[at[of]], axis=1) / reach[of]
    places, which = np.unique(to * len(nodes) + hat[of], return_inverse=True)
    most = np.zeros(len(places))
    np.maximum.at(most, which, left)
    rows, columns = np.append(at, places // len(nodes)), np.append(hat, places % len(nodes))
    return sp.coo_array((np.append(values, most), (rows, columns)), (mesh.n_nodes, len(nodes))).tocsr()
