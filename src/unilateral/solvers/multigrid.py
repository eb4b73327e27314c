"""The discrete problem on a uniformly refined mesh, in a time that is proportional to its size.

Find u in V_h and lambda_H >= 0, one number per cell, with A u = load + B^T lambda, B u >= d and
lambda . (B u - d) = 0; A is the matrix of (., .)_1, B u and d are integrals of u and g over the cells.

Nested iteration: on every level that has cells some steps of the primal-dual active-set method, from
the u and the active cells of the level before. A step is a run of conjugate gradients for the active
cells (`kernel_cg`). The set is looked at after each decade of the error; a changed one ends the run.
That the sets settle is not proved, and always seen.

The last run ends by a guaranteed bound, for any u and lambda >= 0, whatever the set. Let w be the sum
of hats at nodes inside the cells with which v = u - w fulfils B v >= d and lambda . (B v - d) = 0. Two
pairs that fulfil both have (B v - B u_h) . (lambda - lambda_H) <= 0. So with R = A v - load - B^T lambda,
||.|| its dual norm on V_h, and A (v - u_h) - R = B^T (lambda - lambda_H),

    ||v - u_h||_1^2 + ||lambda - lambda_H||_{-1/2,h}^2
        = ||R||^2 + 2 (B v - B u_h) . (lambda - lambda_H) <= ||R||^2,

so that ||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h} are at most ||R|| + ||w||_1. For ||R|| see
`fem.residual`, for w `feasible`; the rounding of both is in the bound.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import SuperLU, splu

from unilateral.arrays import Array, Mask
from unilateral.fem import rounded
from unilateral.fem.hierarchy import Level
from unilateral.fem.nested_cells import Cells
from unilateral.fem.residual import downwards, dual_norm
from unilateral.solvers.feasible import feasible
from unilateral.solvers.kernel_cg import Grid, Run, grid

DECADE = 1e-2
"""Of r . z, after which the active set is looked at; enough on coarser levels."""
AT_FIRST = 1e-6
"""Of r . z, on the first level, which starts from 0."""
INDEX = 6
"""The bound over (r . z)^{1/2}, about: before it can be small enough it is not computed."""
AIM = 0.7
"""Of the tolerance, after a bound missed it."""
STAGNANT = 0.9
"""Of the bound before: if the next one is larger, nothing but rounding is left."""
LEAST = 1e-26
"""Of r . z in the beginning: below it, too, nothing but rounding is left."""
MOST_STEPS = 40


@dataclass(frozen=True, eq=False)
class Found:
    """u (n,), lambda_H (m,) and which cells are `active` (m,).

    `bound` is guaranteed, for ||u - u_h||_1 and for ||lambda_H - exact||_{-1/2,h}. `counts` has the level
    of every step, and its iterations of conjugate gradients. `ritz` are the last run's Ritz values.
    """

    u: Array
    lambda_H: Array
    active: Mask
    bound: float
    converged: bool
    counts: list[tuple[int, int]]
    ritz: Array
    rz: float
    tolerance: float

    @property
    def estimate(self) -> float:
        """Of ||u - u_h||_1, not guaranteed: the least eigenvalue may lie below the least Ritz value."""
        return math.sqrt(self.rz / self.ritz[0]) if len(self.ritz) else math.nan


@dataclass(frozen=True, eq=False)
class Multigrid:
    """The problem on all levels that have cells; `coarsest` factorises level 0."""

    grids: list[Grid]
    coarsest: SuperLU

    def solve(
        self,
        tolerance: float | None,
        start: tuple[Array, Mask] | None = None,
        fraction: float = 0.01,
    ) -> Found:
        """(u_h, lambda_H) with a bound of at most the tolerance, from 0, or from u (n,) and a set (m,).

        Without a tolerance it is that fraction of an estimate of the discretisation error. If rounding,
        MOST_STEPS or MOST_ITERATIONS end it before, converged is False.
        """
        counts: list[tuple[int, int]] = []
        u, active = (start[0].copy(), start[1]) if start else self._nested_iteration(counts)
        ends = Bounded(self, tolerance, fraction)
        run = settled(self.grids[-1], u, active, ends, counts)
        lambda_H = np.maximum(run.lambda_H, 0)
        bound = self.bound(u, lambda_H) if ends.bound is None else ends.bound
        wanted = ends.tolerance or 0.0
        return Found(u, lambda_H, run.active, bound, bound <= wanted, counts, run.ritz(), run.rz, wanted)

    def dual_norm_below(self, lambda_H: Array) -> float:
        """A lower bound of ||lambda_H||_{-1/2,h} for lambda_H (m,): <lambda_H, v> / ||v||_1 for one v."""
        finest, mass = self.grids[-1], self.grids[-1].levels[-1].mass
        R = finest.cells.B.T @ lambda_H
        v = downwards(finest.levels, self.coarsest, R)
        A_v = rounded.product(finest.A, mass, v)
        norm = rounded.SLACK * rounded.root(v, A_v.values) + rounded.dual_norm(A_v.doubt, mass)
        return max(float(R @ v), 0.0) / norm if norm > 0 else 0.0

    def bound(self, u: Array, lambda_H: Array) -> float:
        """Guaranteed, of both errors, for any u (n,) and lambda_H (m,) >= 0."""
        finest, levels = self.grids[-1], self.grids[-1].levels
        cells, mass = finest.cells, levels[-1].mass
        R, norm = feasible(finest.A, mass, finest.load, cells.B, finest.d, cells.inside, u, lambda_H)
        return dual_norm(levels, self.coarsest, *R) + norm

    def _nested_iteration(self, counts: list[tuple[int, int]]) -> tuple[Array, Mask]:
        """u (n,) and the active cells (m,) with which to begin on the finest level."""
        first, share = self.grids[0], AT_FIRST
        u, active = np.zeros(len(first.load)), np.ones(len(first.d), dtype=bool)
        for coarse, fine in itertools.pairwise(self.grids):
            active = settled(coarse, u, active, Reduced(share), counts).active
            u, active, share = fine.levels[-1].P @ u, active[fine.cells.parent], DECADE
        return u, active


def multigrid(levels: Sequence[Level], cells: Sequence[Cells], load: Array, d: Array) -> Multigrid:
    """The problem with load (n,) and d (m,) on the finest level; `cells` are those of the last levels."""
    grids: list[Grid] = []
    for k, of_level in enumerate(reversed(cells)):
        upto = levels[: len(levels) - k]
        grids.insert(0, grid(upto, of_level, load, d))
        if of_level.parent is not None:
            load = upto[-1].P.T @ load
            d = np.bincount(of_level.parent, d).astype(float)
    return Multigrid(grids, splu(levels[0].A.tocsc()))


def settled(on: Grid, u: Array, active: Mask, ends: Reduced | Bounded, counts: list[tuple[int, int]]) -> Run:
    """The run whose set stays the same, or the last of MOST_STEPS; u (n,) changes in place."""
    steps = 0
    while True:
        run, steps = Run(on, active, u), steps + 1
        after = _after(run, ends)
        counts.append((len(on.levels) - 1, len(run.steps)))
        if np.array_equal(after, active) or steps == MOST_STEPS:
            return run
        active = after
        del run  # its memory is needed for the next one


def _after(run: Run, ends: Reduced | Bounded) -> Mask:
    """The set (m,) after the run has ended, or has met another one."""
    look: float | None = ends.first_look(run)
    while look is not None:
        run.descend(look)
        after = run.next_set()
        look = ends(run) if np.array_equal(after, run.active) else None
    return after


@dataclass(frozen=True)
class Reduced:
    """Ends a run when r . z is a share of what it was."""

    share: float

    def first_look(self, run: Run) -> float:
        """The r . z at which to look at the set."""
        return run.rz if run.grid.exact else DECADE * run.rz

    def __call__(self, run: Run) -> float | None:
        """The r . z at which to look again, None to end."""
        done = run.grid.exact or run.exhausted or run.rz <= self.share * run.first_rz
        return None if done else DECADE * run.rz


@dataclass(eq=False)
class Bounded:
    """Ends a run when its `bound` is at most the tolerance, or falls no more.

    Without a tolerance the first run sets it, to a fraction of an estimate of ||u - u_h||_1. That run begins
    at u_2h, the solution on the mesh twice as coarse, and (r . z)^{1/2} is about ||u_h - u_2h||_1. Where
    errors are like h, and u_h - u_2h is nearly orthogonal to u - u_h, that is 3^{1/2} ||u - u_h||_1.
    """

    problem: Multigrid
    tolerance: float | None
    fraction: float
    bound: float | None = None
    before: float = math.inf

    def first_look(self, run: Run) -> float:
        """The r . z at which to look at the set."""
        if self.tolerance is None:
            self.tolerance = self.fraction * math.sqrt(run.first_rz / 3)
        return max(DECADE * run.rz, self._worth_a_bound(run, self.tolerance))

    def __call__(self, run: Run) -> float | None:
        """The r . z at which to look again, None to end."""
        tolerance = self.tolerance or 0.0
        if run.rz > self._worth_a_bound(run, tolerance) and not run.exhausted:
            return self.first_look(run)
        bound = self.problem.bound(run.u, np.maximum(run.lambda_H, 0))
        if bound <= tolerance or bound > STAGNANT * self.before or run.exhausted:
            self.bound = bound
            return None
        self.before = bound
        return run.rz * max(DECADE, (AIM * tolerance / bound) ** 2)

    @staticmethod
    def _worth_a_bound(run: Run, tolerance: float) -> float:
        """The r . z above which the bound is expected to be larger than the tolerance."""
        return max((tolerance / INDEX) ** 2, LEAST * run.first_rz)
