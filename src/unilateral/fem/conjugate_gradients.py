"""Preconditioned conjugate gradients, one step at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array
from unilateral.fem.nested_dissection import dissected

DIRECT = 10_000
"""A matrix with at most this many unknowns is factorised."""
SMOOTHING = ("jacobi", {"omega": 4 / 3, "weighting": "local"})
"""How PyAMG smooths prolongations; its default begins with random numbers."""
MOST_STEPS = 200


class Descent:
    """An iterate x (n,) for A x = b, with a positive definite A (n, n), and its residual r (n,).

    `precondition` takes r to z; it is symmetric and positive definite. `rz` is r . z.
    """

    def __init__(self, A: sp.csr_array, b: Array, x: Array, precondition: Callable[[Array], Array]) -> None:
        self.A, self.x, self.precondition = A, x, precondition
        self.r = b - A @ x
        self.p = precondition(self.r)
        self.rz = float(self.r @ self.p)

    def step(self) -> float:
        """Makes a step. Returns the decrease of x . A x - 2 b . x, which has its minimum where A x = b."""
        if not self.rz > 0:
            return 0.0
        A_p, old = self.A @ self.p, self.rz
        curvature = float(self.p @ A_p)
        if not curvature > 0:  # rounding hides it, as on domains far smaller than 1
            self.rz = 0.0
            return 0.0
        alpha = old / curvature
        self.x, self.r = self.x + alpha * self.p, self.r - alpha * A_p
        z = self.precondition(self.r)
        self.rz = float(self.r @ z)
        self.p = z + self.rz / old * self.p
        return alpha * old


def rough_inverse(A: sp.csr_array) -> Callable[[Array], Array]:
    """A^{-1} (n, n) itself where that is cheap, else a symmetric cycle of algebraic multigrid."""
    if A.shape[0] <= DIRECT:
        return dissected(A).solve if A.shape[0] else np.copy
    import pyamg  # whose import takes longer than small systems

    levels = pyamg.smoothed_aggregation_solver(sp.csr_matrix(A), smooth=SMOOTHING)
    return levels.aspreconditioner().matvec  # type: ignore[no-any-return]


def solved(A: sp.csr_array, b: Array, x: Array, mass: Array, least: float) -> tuple[Array, int]:
    """x (n,) with A x = b, and the number of steps.

    They begin at the given x (n,) and end when sum r_i^2 / mass_i is at most `least`.
    """
    if len(b) <= DIRECT:
        return dissected(A).solve(b), 1
    run, steps = Descent(A, b, x, rough_inverse(A)), 0
    while run.r @ (run.r / mass) > least and steps < MOST_STEPS and run.rz > 0:
        run.step()
        steps += 1
    return run.x, steps
