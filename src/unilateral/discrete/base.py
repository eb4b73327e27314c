"""The discrete problem (P_h*): what both ways to solve it have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import coupling, subtract_lift_from_load
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

NO_LIFT = np.zeros(1)
"""The Dirichlet lift 0, which broadcasts."""
RETRY_TOLERANCE_SHARE = 0.5
"""After an iteration has missed a tolerance that follows from bounds, it goes on to this fraction of it."""


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteProblem(ABC):
    """(P_h*) on a mesh and a partition, with the `load` (n,) of f and q, and the `g_means` (all cells,) of g.

    Multipliers are on the `cells` (m,) of the partition. The errors are bounded where the `data` on the mesh
    are known. On the sides that the `form` clamps u_h has the values `dirichlet_lift` (n,), a function of
    V_h.
    """

    mesh: Mesh
    partition: Partition
    cells: Index
    load: Array
    g_means: Array
    data: EnclosedData | None = field(default=None, kw_only=True)
    form: Form = field(default=H1, kw_only=True)
    dirichlet_lift: Array = field(default_factory=lambda: NO_LIFT, kw_only=True)

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self.mesh.n_nodes} unknowns, {len(self.cells)} multipliers"

    @property
    @abstractmethod
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one."""

    @property
    @abstractmethod
    def beta(self) -> float:
        """The number that serves as beta of (3.4)."""

    @abstractmethod
    def lambda_norm(self, lambda_H: Array) -> float:
        """A lower bound on ||lambda_H||_{-1/2,h}, lambda_H (m,), which is at most ||lambda_H||_{-1/2}."""

    @abstractmethod
    def solve(self, stop: Stop) -> DiscreteSolution:
        """A solution with an algebraic bound up to the tolerance of `stop`, or a fraction of other errors."""

    @abstractmethod
    def iterate(
        self,
        tolerance: float | None,
        stop: Stop,
        start: Array | None = None,
        predicted_total: float = math.inf,
    ) -> DiscreteSolution:
        """The solution up to a tolerance, from lambda_H = start (m,).

        `predicted_total` predicts the bound on its total error.
        """

    @abstractmethod
    def iterate_further(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        """The solution, iterated on to a smaller tolerance."""

    def improve(
        self,
        solution: DiscreteSolution,
        tolerance: float,
        stop: Stop,
        tolerance_share: float = RETRY_TOLERANCE_SHARE,
    ) -> DiscreteSolution:
        """The solution, iterated further if its algebraic bound misses the tolerance.

        It stays as it is where half of the bound or more is rounding, which no step takes away.
        """
        max_bound = max(tolerance, 2 * solution.result.rounding)
        if solution.result.bound <= max_bound or not solution.result.converged:
            return solution
        return self.iterate_further(solution, tolerance_share * tolerance, stop)

    def improve_to_fraction(self, solution: DiscreteSolution, stop: Stop) -> DiscreteSolution:
        """The solution, iterated on until the algebraic bound is at most a fraction of that on ||u - u_h||_1.

        The fraction is `stop.fraction`. The bound on ||u - u_h||_1 is computed again each time, because it
        falls, too, where most of it was algebraic. Rounding may end the iteration before.
        """
        while True:
            better = self.improve(solution, stop.fraction * solution.total_bound("h1"), stop)
            if better is solution:
                return solution
            solution = better

    def make_solution(self, result: DualResult, tolerance: float, u_h: Array) -> DiscreteSolution:
        """The solution u_h (n,) with the multipliers of a `result`."""
        lambda_H = np.zeros(self.partition.n_cells)
        lambda_H[self.cells] = result.lambda_H
        return DiscreteSolution(
            data=self.data,
            mesh=self.mesh,
            partition=self.partition,
            form=self.form,
            cells=self.cells,
            g_means=self.g_means,
            u_h=u_h,
            lambda_H=lambda_H,
            result=result,
            tolerance=tolerance,
            beta=self.beta,
            unique=self.unique,
            lambda_norm=self.lambda_norm(result.lambda_H),
        )

    def balance(self, solution: DiscreteSolution) -> float:
        """|int u_h - int f - int lambda_H|, by (2.1) with v = 1.

        It is 0 up to rounding, or by multigrid up to its stop. Beside clamped sides it is NaN: v = 1 does not
        vanish there.
        """
        if self.form.clamped:
            return math.nan
        return float(abs(solution.u_integral - self.load.sum() - solution.force))

    @cached_property
    def homogeneous_data(self) -> tuple[Array, Array]:
        """The load (n,) and the means (cells,) of g for u_h - u_D, which vanishes on clamped sides."""
        if not self.form.clamped:
            return self.load, self.g_means
        # u_h - u_D has to be above g - u_D in the mean
        B = coupling(self.mesh, self.partition)
        lift_means = B @ self.dirichlet_lift[self.mesh.boundary] / self.partition.lengths
        load = subtract_lift_from_load(self.mesh, self.form, self.load, self.dirichlet_lift)
        return load, self.g_means - lift_means
