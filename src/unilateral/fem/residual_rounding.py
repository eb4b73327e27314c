"""Residuals of A u = load with a bound on their rounding, and what that can do in the dual norm of V_h.

A, the matrix of a form (`form`), is given by its entries off the diagonal and the sums s_i of its rows:

    (A u)_i = s_i u_i + sum_j A_ij (u_j - u_i).

Where u is nearly a constant, however large, little is then lost. A sum of k products, one factor of each a
difference, is off by at most k + 2 units of rounding of the sum of their absolute values (N. J. Higham,
Accuracy and Stability of Numerical Algorithms, 2002, chapter 3).

On any mesh, for R on V_h, let m_i be thirds of the areas of the triangles at each node. Then

    R . x <= (sum R_i^2 / m_i)^{1/2} (sum m_i x_i^2)^{1/2},     sum m_i x_i^2 <= 4 ||x||_0^2,

the second since on every triangle the lumped mass, 1/3, is at most 4 times the least eigenvalue of the mass,
1/12. With m ||x||_0^2 <= ||x||^2, and m m_i in place of m_i, ||R|| <= 2 (sum R_i^2 / m_i)^{1/2}. That is
too large by up to 1/h, h the shortest edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array, row_blocks
from unilateral.formulas.taylor import EPS

PRODUCT_ROWS_PER_BLOCK = 1 << 15
"""This many rows are treated at a time: their numbers fit into a processor's cache."""
UNIT_ROUNDOFF = EPS / 2
"""The rounding of a number is at most this fraction of it; bounds have two units more for their own."""
NORM_ROUNDING_FACTOR = 1 + 1e-9
"""A norm that is computed from A x is multiplied by this for its rounding, except for that of A x."""


class Rounded(NamedTuple):
    """Numbers (k,), and bounds (k,) of what rounding has done to them."""

    values: Array
    rounding: Array


def max_row_entries(matrix: sp.csr_array) -> int:
    """The largest number of entries in a row."""
    return int(np.diff(matrix.indptr).max(initial=0))


def product_with_rounding(A: sp.csr_array, row_sums: Array, u: Array) -> Rounded:
    """A u (n,), for A (n, n) whose rows have those `row_sums` (n,) and an entry each."""
    # (A u)_i = s_i u_i + sum_j A_ij (u_j - u_i), and the sum of the terms' absolute values
    values = row_sums * u
    sizes = np.abs(row_sums * u)
    for rows in row_blocks(len(u), PRODUCT_ROWS_PER_BLOCK):
        start = A.indptr[rows.start : rows.stop + 1]
        entries = slice(start[0], start[-1])
        terms = A.data[entries] * (u[A.indices[entries]] - np.repeat(u[rows], np.diff(start)))
        values[rows] += np.add.reduceat(terms, start[:-1] - start[0])
        sizes[rows] += np.add.reduceat(np.abs(terms), start[:-1] - start[0])
    return Rounded(values, UNIT_ROUNDOFF * (max_row_entries(A) + 4) * sizes)


def gap_with_rounding(B: sp.csr_array, u: Array, d: Array, lengths: Array | float = 1.0) -> Rounded:
    """B u / lengths - d (m,), for B (m, n) without negative entries: integrals over cells, or means."""
    values = B @ u / lengths - d
    sizes = B @ np.abs(u) / lengths + np.abs(d)
    return Rounded(values, UNIT_ROUNDOFF * (max_row_entries(B) + 4) * sizes)


def load_with_rounding(load: Array, B: sp.csr_array, lambda_H: Array) -> Rounded:
    """load + B^T lambda_H (n,), for B (m, n) without negative entries and lambda_H (m,) >= 0."""
    pull = B.T @ lambda_H
    max_cells = int(np.bincount(B.indices).max(initial=0))
    return Rounded(load + pull, UNIT_ROUNDOFF * (max_cells + 4) * (np.abs(load) + pull))


def residual_with_rounding(A: sp.csr_array, row_sums: Array, u: Array, load: Rounded) -> Rounded:
    """The residual load - A u (n,), for A (n, n) with the sums (n,) of its rows."""
    A_u = product_with_rounding(A, row_sums, u)
    values = load.values - A_u.values
    return Rounded(values, load.rounding + A_u.rounding + UNIT_ROUNDOFF * np.abs(values))


def lumped_dual_norm_bound(R: Array, nodal_weights: Array) -> float:
    """The bound 2 (sum R_i^2 / m_i)^{1/2} on the dual norm of R (n,) on V_h, with the nodal weights m_i."""
    return NORM_ROUNDING_FACTOR * 2 * float(dnrm2(R / np.sqrt(nodal_weights)))


def product_root(x: Array, y: Array) -> float:
    """The root (x . y)^{1/2} for numbers of one size, 0 if x . y < 0, in units of the largest number."""
    unit = max(float(np.max(np.abs(numbers), initial=0.0)) for numbers in (x, y))
    return unit * max(float(x / unit @ (y / unit)), 0.0) ** 0.5 if unit > 0 else 0.0
