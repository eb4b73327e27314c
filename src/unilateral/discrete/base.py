"""The discrete problem (P_h*), and its solution with what is known of its errors."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.boundary_flux import Given, edge_flux, given
from unilateral.bounds.flux_residuals import SUMS
from unilateral.bounds.forces import balance
from unilateral.bounds.local_bounds import LocalBound, flux_of, local_bound
from unilateral.bounds.sharp_bounds import SharpBound, sharp_bound
from unilateral.bounds.source import Source, source_of
from unilateral.errors import InputError
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import coupling, h1_norm, of_rest
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import ExactErrors
from unilateral.problems.obstacle_and_flux import Obstacle
from unilateral.problems.scaled import Data
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

KEPT = "a copy of a solution, or one from a file, is not iterated on; solve its problem again"
NO_LOAD = np.full(1, math.nan)
"""In place of a load that is not kept: what is computed from it is NaN."""
NOTHING = np.zeros(1)
AIM = 0.5
"""After an iteration has missed a tolerance that follows from bounds, it goes on to this fraction of it."""


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteProblem(ABC):
    """(P_h*) on a mesh and a partition, with the `load` (n,) of f and q, and the `g_means` (all cells,) of g.

    Multipliers are on the `cells` (m,) of the partition. The errors are bounded where the `data` f, g and q
    are formulas. `source` is the enclosure of f, if there is one, because the load may be made of it. On the
    sides that the `form` clamps u_h has the values `held` (n,), a function of V_h.
    """

    mesh: Mesh
    partition: Partition
    cells: Index
    load: Array
    g_means: Array
    data: Data | None = field(default=None, kw_only=True)
    source: Source | None = field(default=None, kw_only=True)
    form: Form = field(default=H1, kw_only=True)
    held: Array = field(default_factory=lambda: NOTHING, kw_only=True)

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

    def solved(self, stop: Stop) -> DiscreteSolution:
        """(u_h, lambda_H) with an algebraic bound up to `stop.tolerance`, else a fraction of other errors.

        This, `iterated` and `continued` raise InputError for what is kept of a problem, see `KeptProblem`.
        """
        raise InputError(KEPT)

    def iterated(
        self, tolerance: float | None, stop: Stop, start: Array | None = None, total: float = math.inf
    ) -> DiscreteSolution:
        """The solution up to a tolerance, from lambda_H = start (m,).

        `total` predicts the bound on its total error.
        """
        raise InputError(KEPT)

    def continued(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        """The solution, iterated on to a smaller tolerance."""
        raise InputError(KEPT)

    def errors(self, lambda_H: Array) -> ExactErrors | None:
        """The true errors of lambda_H (m,) and its u_h, where the exact solution is known on these spaces."""
        return None

    def forget(self) -> None:
        """Frees what is large and quickly made again; by default there is nothing."""
        return

    @cached_property
    def of_rest(self) -> tuple[Array, Array]:
        """The load (n,) and the means (cells,) of g for u_h - held, which vanishes on clamped sides."""
        if not self.form.clamped:
            return self.load, self.g_means
        means = coupling(self.mesh, self.partition) @ self.held[self.mesh.boundary] / self.partition.lengths
        return of_rest(self.mesh, self.form, self.load, self.held), self.g_means - means


class Facts(NamedTuple):
    """What was found out when a problem was solved: see the properties of `DiscreteProblem`."""

    unique: bool
    beta: float
    lambda_norm: float


@dataclass(frozen=True, eq=False, repr=False)
class KeptProblem(DiscreteProblem):
    """(P_h*) as copies and files of its solution keep it: with what bounds need, but not to be solved."""

    facts: Facts

    @property
    def unique(self) -> bool:
        return self.facts.unique

    @property
    def beta(self) -> float:
        return self.facts.beta

    def lambda_norm(self, lambda_H: Array) -> float:
        """That of the solution."""
        return self.facts.lambda_norm


@dataclass(frozen=True, eq=False)
class DiscreteSolution:
    """u_h, and lambda_H on all cells; `result` is what the iteration found, with its algebraic bound.

    If u_h is of another program, the `potential` (n,) solves the discrete equation with lambda_H, and the
    bounds on the errors of u_h make their flux from it. Else it is None.
    """

    discrete: DiscreteProblem
    result: DualResult
    tolerance: float
    lambda_H: Array
    u_h: Array
    potential: Array | None = None

    def __repr__(self) -> str:
        return f"DiscreteSolution of {self.discrete!r}"

    @cached_property
    def errors(self) -> ExactErrors | None:
        """The true errors, where the exact solution is known on these spaces."""
        return self.discrete.errors(self.result.lambda_H)

    @cached_property
    def gap(self) -> Array:
        """(cells,) the means of u_h - g, NaN on free sides."""
        mesh, cells = self.discrete.mesh, self.discrete.partition
        gap = coupling(mesh, cells) @ self.u_h[mesh.boundary] / cells.lengths - self.discrete.g_means
        gap[np.setdiff1d(np.arange(cells.n_cells), self.discrete.cells)] = math.nan
        return gap

    def bound(self, sharp: bool = False) -> LocalBound | SharpBound | None:
        """The guaranteed bounds on the errors, where f, g and q are formulas; sharp ones take more time."""
        return self._sharp_bound if sharp else self._local_bound

    def known(self, sharp: bool = False) -> bool:
        """Whether the bounds are already computed."""
        return ("_sharp_bound" if sharp else "_local_bound") in vars(self)

    @cached_property
    def flux(self) -> Array | None:
        """(2, E) the flux of the cheap bound, as `equilibrated` gives it, where f, g and q are formulas."""
        if self._given is None:
            return None
        source, _, cells, u_h, lambda_H, tau, form = self._given
        potential = u_h if self.potential is None else self.potential
        return flux_of(source, potential, edge_flux(source.mesh, cells, lambda_H).ends + tau.ends, form)

    @property
    def foreign(self) -> bool:
        """Whether u_h is of another program."""
        return self.potential is not None

    @property
    def source(self) -> Source | None:
        """The enclosure of f, where f, g and q are formulas."""
        return self._given[0] if self._given else None

    @property
    def facts(self) -> Facts:
        """What was found out when the problem was solved."""
        return Facts(self.discrete.unique, self.discrete.beta, self.lambda_norm)

    def kept(self, believed: bool = True) -> DiscreteSolution:
        """The same without what solved it, and with the bounds that are already computed.

        It has none if these are not `believed`.
        """
        of = self.discrete
        data = of.data if believed else None
        spaces = of.mesh, of.partition, of.cells
        problem = KeptProblem(*spaces, NO_LOAD, of.g_means, self.facts, data=data, form=of.form)
        found = replace(self, discrete=problem)
        bounds = ("_local_bound", "_sharp_bound")
        if believed:
            vars(found).update({name: bound for name, bound in vars(self).items() if name in bounds})
        return found

    @property
    def shares(self) -> Array:
        """(m,) each triangle's part of the square of the cheap bound on ||u - u_h||_1; 0 if it is unknown."""
        bound = self._local_bound
        return bound.shares if bound else np.zeros(len(self.discrete.mesh.triangles))

    @cached_property
    def _local_bound(self) -> LocalBound | None:
        return local_bound(*self._given, self.potential) if self._given else None

    @cached_property
    def _sharp_bound(self) -> SharpBound | None:
        return sharp_bound(*self._given, self.potential) if self._given else None

    @cached_property
    def _given(self) -> tuple[Source, Obstacle, Partition, Array, Array, Given, Form] | None:
        """The arguments of both bounds; None where f, g and q are no formulas."""
        discrete, data = self.discrete, self.discrete.data
        if data is None:
            return None
        source = discrete.source or source_of(discrete.mesh, data)
        pair = discrete.partition, self.u_h, self.lambda_H
        flux = given(data.enclosed_flux, discrete.mesh, discrete.form)
        return source, data.enclosed_obstacle, *pair, flux, discrete.form

    @cached_property
    def force_balance(self) -> tuple[float, float] | None:
        """Two numbers between which the sum of all forces and reactions lies.

        None if c > 0, or where f and q are no formulas.
        """
        if self._given is None or self.discrete.form.reaction:
            return None
        source, *_ = self._given
        assert self.discrete.data is not None  # or nothing were given
        return balance(source, self.discrete.data.enclosed_flux)

    @cached_property
    def u_norm(self) -> float:
        """||u_h||."""
        return h1_norm(self.discrete.mesh, self.u_h, self.discrete.form.reaction)

    @cached_property
    def lambda_norm(self) -> float:
        """||lambda_H||_{-1/2,h}, which is at most ||lambda_H||_{-1/2}."""
        return self.discrete.lambda_norm(self.result.lambda_H)

    def forget(self) -> None:
        """Frees what is large and quickly made again.

        The norm of lambda_H, which needs it, is computed before and kept.
        """
        self.lambda_norm  # noqa: B018
        self.discrete.forget()

    @cached_property
    def u_integral(self) -> float:
        mesh = self.discrete.mesh
        return float(mesh.areas @ self.u_h[mesh.triangles].mean(axis=1))

    @cached_property
    def force(self) -> float:
        """The integral of lambda_H."""
        return float(self.discrete.partition.lengths @ self.lambda_H)

    @property
    def balance(self) -> float:
        """|int u_h - int f - int lambda_H|, by (2.1) with v = 1.

        It is 0 up to rounding, or by multigrid up to its stop. Beside clamped sides it is NaN: v = 1 does not
        vanish there.
        """
        if self.discrete.form.clamped:
            return math.nan
        return float(abs(self.u_integral - self.discrete.load.sum() - self.force))

    def total(self, norm: str, sharp: bool = False) -> float:
        """The bound on ||u - u_h||_1 ("h1") or ||lambda - lambda_H||_{-1/2} ("hm12"), infinite if unknown."""
        bound = self.bound(sharp)
        if bound is None:
            return math.inf
        return bound.u if norm == "h1" else bound.lambda_

    def algebraic(self, norm: str) -> float:
        """The bound on the iteration's part of that error; for lambda it is divided by beta.

        It says when to stop. `total` includes the error of the iteration, and does not rest on this bound.
        """
        if norm == "hm12" and len(self.discrete.cells) == 0:
            return 0.0
        beta = 1.0 if norm == "h1" else self.discrete.beta
        return self.result.bound / beta if beta > 0 else math.inf

    def size(self, norm: str, sharp: bool = False) -> float:
        """A lower bound on the norm of the exact solution, from that of the discrete one."""
        of_discrete = self.u_norm if norm == "h1" else self.lambda_norm
        return max((1 - SUMS) * of_discrete / self.discrete.mesh.growth - self.total(norm, sharp), 0.0)

    def improved(self, tolerance: float, stop: Stop, aim: float = AIM) -> DiscreteSolution:
        """The solution, iterated on to `aim` times the `tolerance` if the algebraic bound misses it.

        It stays as it is where half of the bound or more is rounding, which no step takes away.
        """
        enough = max(tolerance, 2 * self.result.rounding)
        if self.result.bound <= enough or not self.result.converged:
            return self
        return self.discrete.continued(self, aim * tolerance, stop)

    def within(self, stop: Stop) -> DiscreteSolution:
        """The solution, iterated on until the algebraic bound is at most a fraction of that on ||u - u_h||_1.

        The fraction is `stop.fraction`. The bound on ||u - u_h||_1 is computed again each time, because it
        falls, too, where most of it was algebraic. Rounding may end the iteration before.
        """
        solution = self
        while (better := solution.improved(stop.fraction * solution.total("h1"), stop)) is not solution:
            solution = better
        return solution
