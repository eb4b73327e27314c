"""One recorded run of `uzawa`'s loop from which every stopping level is read off, and the ways to S y."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dnrm2

from study.experiments.cost.variants import REFRESH
from study.operations import newton_solve
from unilateral.arrays import Array
from unilateral.fem.linear_systems import Sparse
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.solvers.uzawa import Apply, energy_norm


class Reached(NamedTuple):
    """What a run that stops at a level has done: lambda^n (m,), n, applications of S, seconds, and so on.

    `bound` is guaranteed, in double precision; `checks` are the applications that it took, and
    `solving` the operations of Newton's own solves.
    """

    lambda_H: Array
    steps: int
    applications: int
    checks: int
    bound: float
    solving: int
    seconds: float


class History:
    """Observes the loop: `reached` has an entry for each of the falling `tolerances` that was met.

    A step is checked as the loop does: by its residual, and by the bound where that is small enough.
    """

    def __init__(
        self, operator: DualOperator, offset: Array, rho: float, tolerances: Sequence[float]
    ) -> None:
        self.operator, self.offset, self.rho, self.tolerances = operator, offset, rho, tolerances
        self.root = np.sqrt(operator.H_i)
        self.per_residual = 1 / (rho * np.sqrt(operator.lambda_min))
        self.reached: list[Reached] = []
        self.steps, self.checks, self.solving, self.aside = -1, 0, 0, 0.0
        self.begin = time.perf_counter()

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        self.steps += 1
        small = dnrm2(R) * self.per_residual
        if len(self.reached) < len(self.tolerances) and small <= self.tolerances[len(self.reached)]:
            now = time.perf_counter()
            self._record(y, small, now - self.begin - self.aside)
            self.aside += time.perf_counter() - now

    def _record(self, y: Array, small: float, seconds: float) -> None:
        bound = self._bound(y)
        for tolerance in self.tolerances[len(self.reached) :]:
            if small > tolerance:
                return
            self.checks += 1
            if bound > tolerance:
                return
            counts = (self.steps, self.steps + 1 + self.checks, self.checks)
            self.reached.append(Reached(y / self.root, *counts, bound, self.solving, seconds))
            self.checks = 0

    def _bound(self, y: Array) -> float:
        """The bound of `residual_bound`, in double precision whatever the loop's own is."""
        S = self.operator.S
        R = np.minimum(y, self.rho * (S @ y + self.root * self.offset))
        size = dnrm2(R)
        return energy_norm(S, R, size) + size * self.per_residual

    def with_solves(self, y: Array, F: Array, R: Array) -> None:
        """Observe a step as the history itself does, and count the solve on the cells in contact, y > R."""
        self(y, F, R)
        self.solving += newton_solve(int(np.count_nonzero(y > R)))


def by_A(factors: Sparse, spaces: MixedSpaces) -> Apply:
    """y -> S y with a solve on all nodes: u of (5.1) without the partial elimination."""
    root, boundary = np.sqrt(spaces.operator.H_i), spaces.mesh.boundary
    load = np.zeros(spaces.mesh.n_nodes)

    def apply(y: Array, out: Array) -> None:
        load[boundary] = spaces.B.T @ (y / root)
        np.divide(spaces.B @ factors.solve(load)[boundary], root, out=out)

    return apply


def by_A_3(spaces: MixedSpaces) -> Apply:
    """y -> S y with a solve on the boundary nodes: A_3 c'' = g'' of section 5."""
    root = np.sqrt(spaces.operator.H_i)

    def apply(y: Array, out: Array) -> None:
        np.divide(spaces.B @ spaces.condensed.solve_boundary(spaces.B.T @ (y / root)), root, out=out)

    return apply


def by_S(operator: DualOperator) -> Apply:
    """y -> S y by all of S, which is what `operations` counts; the loop's own way leaves columns out."""
    return lambda y, out: np.dot(operator.S, y, out=out)


def by_S32(operator: DualOperator) -> Apply:
    """y -> S y in single precision, S and y rounded to it."""
    S = operator.S.astype(np.float32)

    def apply(y: Array, out: Array) -> None:
        out[:] = S @ y.astype(np.float32)

    return apply


def refined(operator: DualOperator) -> Apply:
    """y -> S y_0 + S (y - y_0), the increment in single precision; every REFRESH products y_0 = y, in double.

    Iterative refinement, see N. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., chapter 12.
    """
    S, single = operator.S, by_S32(operator)
    anchor, product = np.zeros(len(S)), np.zeros(len(S))
    count = 0

    def apply(y: Array, out: Array) -> None:
        nonlocal count
        if count % REFRESH == 0:
            np.copyto(anchor, y)
            np.dot(S, y, out=product)
        single(y - anchor, out)
        np.add(out, product, out=out)
        count += 1

    return apply
