"""The pairing in the proof of Theorem 5: P0(T_H) with functions that are linear between inner nodes.

One node in each cell is kept, that of `inner_nodes`. V holds the continuous functions on the boundary that
are linear in arc length from one kept node to the next; they are traces of functions in V_h.
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array
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


def least_pairing_constant(delta: Array, alpha_1: Array) -> Array:
    """(...) the bound of Theorem 5's proof, m^{3/2} with m = 2 delta / (1 + alpha_1).

    Rows of M are diagonally dominant by at least m. So M = E (1 - N), E diagonal and at least (1 + m)/2, N
    with two cyclic off-diagonals and row sums at most q = (1 - m)/(1 + m); element i, j of M^{-1} is at most
    q^|i-j| / m, its row sums 1/m and its column sums 1/m^2.
    """
    return (2 * delta / (1 + alpha_1)) ** 1.5
