"""Numbers of floating-point operations, by formulas, which do not depend on the computer.

A multiplication, addition, subtraction, division or root counts 1, a comparison or a copy 0. m is the
number of cells of T_H, nb that of boundary nodes, B (m, nb) the coupling.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

STEP_OPERATIONS_PER_CELL = {"uzawa": 1, "nesterov": 12, "barzilai_borwein": 17, "newton": 1}
"""A step takes at most so many operations per cell beyond its residual; Newton's solve is counted besides."""


class FactorCounts(NamedTuple):
    """The sparse LU factors of A: their nonzeros, and the operations to find and to apply them."""

    nonzeros: int
    factorise: int
    solve: int


def count_factors(lu: SuperLU) -> FactorCounts:
    """The counts for right-looking elimination on the pattern that was found.

    To find the factors takes the sum of l + 2 l u over the pivots, where l and u are the nonzeros below and
    to the right of a pivot; L has ones on its diagonal.
    """
    n = lu.shape[0]
    # l by column of L, u by row of U, without the diagonals
    lower = np.diff(sp.csc_array(lu.L).indptr.astype(np.int64)) - 1
    upper = np.diff(sp.csr_array(lu.U).indptr.astype(np.int64)) - 1
    nonzeros = int(lower.sum() + upper.sum()) + 2 * n
    # A solve: a multiplication and a subtraction per nonzero beside the diagonals, n divisions by U's
    return FactorCounts(nonzeros, int(lower.sum() + 2 * (lower @ upper)), 2 * nonzeros - 3 * n)


def count_cholesky(k: int) -> int:
    """Cholesky of a dense matrix (k, k): k roots, k (k - 1) / 2 divisions, (k^3 - k) / 3 updates."""
    return k + k * (k - 1) // 2 + (k**3 - k) // 3


def count_triangular_solve(k: int) -> int:
    """A solve with a dense triangle (k, k)."""
    return k * k


def count_product_by_S(m: int) -> int:
    """The product y -> S y, S stored as a full matrix."""
    return m * (2 * m - 1)


def count_product_by_A_3(m: int, nb: int, coupling_nonzeros: int) -> int:
    """The product y -> S y by both triangles of A_3, B, B^T and the weights H_i^{-1/2}."""
    return 2 * count_triangular_solve(nb) + _count_couplings(m, nb, coupling_nonzeros)


def count_product_by_A(m: int, nb: int, coupling_nonzeros: int, factors: FactorCounts) -> int:
    """The product y -> S y by both sparse triangles of A, B, B^T and the weights H_i^{-1/2}."""
    return factors.solve + _count_couplings(m, nb, coupling_nonzeros)


def _count_couplings(m: int, nb: int, coupling_nonzeros: int) -> int:
    # B^T y, B u and twice the weights
    return (2 * coupling_nonzeros - nb) + (2 * coupling_nonzeros - m) + 2 * m


def count_newton_solve(contact: int) -> int:
    """Newton's solve: the factorisation of S on the cells in contact, and solves with both triangles."""
    return count_cholesky(contact) + 2 * count_triangular_solve(contact)


def count_scaling_of_A_3(nb: int) -> int:
    """R of A_3 = R^T R from the last block of U, whose rows are divided by the pivots' roots."""
    return nb + nb * (nb + 1) // 2


def count_forming_S(m: int, nb: int) -> int:
    """S from the last block of U: R, R^{-T} B^T, half of the symmetric product D, and the weights."""
    return (
        count_scaling_of_A_3(nb)
        + m * count_triangular_solve(nb)
        + m * (m + 1) // 2 * (2 * nb - 1)
        + 2 * m * m
    )


def count_spectrum(m: int) -> int:
    """lambda_min and lambda_max of S: 4 m^3 / 3 for the tridiagonal form, lower orders left out.

    G. Golub, C. Van Loan, Matrix Computations, 4th ed., section 8.3.1.
    """
    return 4 * m**3 // 3
