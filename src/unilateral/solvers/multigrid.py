"""Solves the discrete problem on a refined mesh, in a time that is proportional to its size.

Find u in V_h and lambda_H >= 0, one number per cell, with A u = load + B^T lambda, B u >= d and
lambda . (B u - d) = 0; A is the matrix of the form, B u and d are integrals of u and g over the cells.

A step of the primal-dual active-set method is a run of conjugate gradients for the active cells
(`kernel_cg`). The set is checked after each decade of the error; a changed one ends the run. It is not proved
that the sets settle, but it was always observed. The first step begins with the u and the active cells that
are given. If refinement was uniform it may also begin with those of the level before, found by some steps
there: nested iteration.

The last run ends by a bound that is guaranteed for any u and lambda >= 0, whatever the set
(`multigrid_bounds`). In the cheap bound on the total error its residual R is a part of u_h - f - div q. There
its size is that of (sum R_i^2 / m_i)^{1/2} (`residual_rounding`), which may be larger than ||R|| by
1/h, h the shortest edge. So that has to be small, too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.fem.hierarchy import Hierarchy
from unilateral.fem.nested_cells import LevelCells
from unilateral.fem.residual_rounding import product_root
from unilateral.solvers.kernel_cg import ActiveSetRun, Grid
from unilateral.solvers.multigrid_bounds import multilevel_algebraic_bound

RZ_RATIO_PER_CHECK = 1e-2
"""The active set is checked each time r . z has fallen by this factor; once on coarser levels."""
FIRST_LEVEL_RZ_RATIO = 1e-6
"""On the first level, which starts from 0, r . z has to fall by this factor."""
RESIDUAL_NORM_SHARE = 0.1
"""(sum R_i^2 / m_i)^{1/2} of the residual R may be at most this fraction of the estimated total error."""
BOUND_PER_ROOT_RZ = 6
"""The bound is about this many times (r . z)^{1/2}. It is not computed before it can be small enough."""
MISSED_BOUND_SHARE = 0.7
"""After a bound has missed the tolerance, the run goes on to this fraction of it."""
STAGNATION_RATIO = 0.9
"""If a bound is larger than this fraction of the one before, nothing but rounding is left."""
MIN_RZ_RATIO = 1e-26
"""If r . z is below this fraction of its first value, nothing but rounding is left."""
MIN_TOLERANCE_PER_NORM = 1e-10
"""A tolerance that is not given is at least this fraction of ||u||_1, because the steps are rounded."""
MAX_ACTIVE_SETS = 40


@dataclass(frozen=True, eq=False)
class MultigridResult:
    """u (n,), lambda_H (m,) and which cells are `active` (m,).

    `bound` is a guaranteed bound on ||u - u_h||_1 and on ||lambda_H - exact||_{-1/2,h}. `iteration_counts`
    has the level of every step, and its iterations of conjugate gradients. `cg_coefficients` are those of the
    last `ActiveSetRun`.
    """

    u: Array
    lambda_H: Array
    active: Mask
    bound: float
    iteration_counts: list[tuple[int, int]]
    cg_coefficients: list[tuple[float, float]]
    rz: float
    tolerance: float

    @property
    def converged(self) -> bool:
        """Whether the bound is small enough."""
        return self.bound <= self.tolerance


@dataclass(frozen=True, eq=False)
class Multigrid:
    """The problem on all levels that have cells, from coarse to fine."""

    grids: list[Grid]

    @property
    def finest(self) -> Grid:
        """The problem on the finest level."""
        return self.grids[-1]

    def solve(
        self,
        tolerance: float | None = None,
        start: tuple[Array, Mask] | None = None,
        fraction: float = 0.01,
        max_residual_norm: float = math.inf,
    ) -> MultigridResult:
        """The solution (u_h, lambda_H) on the finest level, with a bound of at most `tolerance`.

        The iteration begins at a `start`, u (n,) and the active cells (m,), or with 0 on the coarsest level.
        If the tolerance or `max_residual_norm` is not given, it is a fraction of an estimate of the
        discretisation error. Rounding, MAX_ACTIVE_SETS or MAX_KERNEL_ITERATIONS may end it before.
        """
        counts: list[tuple[int, int]] = []
        u, active = (start[0].copy(), start[1]) if start else self._nested_iteration(counts)
        criterion = BoundCriterion(tolerance, fraction, max_residual_norm)
        run = settle_active_set(self.finest, u, active, criterion, counts)
        lambda_H = np.maximum(run.lambda_H, 0)
        bound = criterion.bound
        if bound is None:  # the active sets did not settle
            bound = multilevel_algebraic_bound(self.finest, u, lambda_H)
        return MultigridResult(
            u,
            lambda_H,
            active=run.active,
            bound=bound,
            iteration_counts=counts,
            cg_coefficients=run.cg_coefficients,
            rz=run.rz,
            tolerance=criterion.tolerance or 0.0,
        )

    def _nested_iteration(self, counts: list[tuple[int, int]]) -> tuple[Array, Mask]:
        """u (n,) and the active cells (m,) with which to begin on the finest level."""
        first = self.grids[0]
        share = FIRST_LEVEL_RZ_RATIO
        u = np.zeros(len(first.load))
        active = np.ones(len(first.d), dtype=bool)
        for coarse, fine in itertools.pairwise(self.grids):
            active = settle_active_set(coarse, u, active, ReductionCriterion(share), counts).active
            # u and the active cells of the coarse level begin the next one
            u = np.append(u, np.empty(fine.hierarchy.n - len(u)))
            active = active[fine.cells.parent]
            share = RZ_RATIO_PER_CHECK
            fine.hierarchy.levels[-1].prolong(u)
        return u, active


def build_multigrid(
    hierarchy: Hierarchy, level_cells: Sequence[LevelCells], load: Array, d: Array
) -> Multigrid:
    """The problem with load (n,) and d (m,) on the last level; `level_cells` are those of the last levels."""
    grids = [Grid(hierarchy, level_cells[-1], load, d)]
    for finer, coarser in zip(level_cells[:0:-1], level_cells[-2::-1], strict=True):
        assert hierarchy.coarser is not None
        assert finer.parent is not None
        # restricted: the load of coarse hats, and integrals of g over unions of cells
        load = load.copy()
        hierarchy.levels[-1].restrict(load)
        load = load[: hierarchy.coarser.n]
        d = np.bincount(finer.parent, d).astype(float)
        hierarchy = hierarchy.coarser
        grids.insert(0, Grid(hierarchy, coarser, load, d))
    return Multigrid(grids)


def settle_active_set(
    grid: Grid, u: Array, active: Mask, criterion: Criterion, counts: list[tuple[int, int]]
) -> ActiveSetRun:
    """The run whose set stays the same, or the last of MAX_ACTIVE_SETS; u (n,) changes in place."""
    steps = 0
    while True:
        if grid.is_coarsest:
            u[:] = 0  # whose residual is the load itself, however small
        run = ActiveSetRun(grid, active, u)
        steps += 1
        next_active = _run_until_set_changes(run, criterion)
        counts.append((len(grid.hierarchy.levels), len(run.cg_coefficients)))
        if np.array_equal(next_active, active) or steps == MAX_ACTIVE_SETS:
            return run
        active = next_active
        del run  # its memory is needed for the next one


def _run_until_set_changes(run: ActiveSetRun, criterion: Criterion) -> Mask:
    """The active set (m,) after the run has ended, or as soon as it has changed."""
    max_rz = criterion.first_check(run)
    while True:
        run.descend(max_rz)
        next_active = run.choose_next_set()
        next_max_rz = criterion(run) if np.array_equal(next_active, run.active) else None
        if next_max_rz is None:
            return next_active
        max_rz = next_max_rz


@dataclass(frozen=True)
class ReductionCriterion:
    """Ends a run when r . z is at most `max_rz_ratio` times its first value."""

    max_rz_ratio: float

    def first_check(self, run: ActiveSetRun) -> float:
        """The r . z at which to look at the set."""
        return run.rz if run.grid.is_coarsest else RZ_RATIO_PER_CHECK * run.rz

    def __call__(self, run: ActiveSetRun) -> float | None:
        """The r . z at which to look again, None to end."""
        done = run.grid.is_coarsest or run.is_exhausted or run.rz <= self.max_rz_ratio * run.first_rz
        return None if done else RZ_RATIO_PER_CHECK * run.rz


@dataclass(eq=False)
class BoundCriterion:
    """Ends a run when its `bound` and its residual are small enough, or fall no further.

    The bound has to be at most the tolerance, the norm of R at most `max_residual_norm`. If these two are not
    given, the first run sets them to fractions of an estimate of ||u - u_h||_1. That run begins at u_2h, the
    solution on the mesh twice as coarse, and (r . z)^{1/2} is about ||u_h - u_2h||_1. Where errors are like
    h, and u_h - u_2h is nearly orthogonal to u - u_h, that is 3^{1/2} ||u - u_h||_1. Where u_2h is u_h up to
    rounding, the tolerance is MIN_TOLERANCE_PER_NORM times ||u||_1.
    """

    tolerance: float | None
    fraction: float
    max_residual_norm: float
    bound: float | None = None
    last_bound: float = math.inf

    def first_check(self, run: ActiveSetRun) -> float:
        """The r . z at which to look at the set."""
        # ||u - u_h||_1 from (r . z)^{1/2}, about ||u_h - u_2h||_1 = 3^{1/2} ||u - u_h||_1
        estimate = math.sqrt(max(run.first_rz, 0.0) / 3)
        if self.tolerance is None:
            min_tolerance = MIN_TOLERANCE_PER_NORM * product_root(run.u, run.grid.hierarchy.A @ run.u)
            self.tolerance = max(self.fraction * estimate, min_tolerance)
        if self.max_residual_norm == math.inf:
            self.max_residual_norm = RESIDUAL_NORM_SHARE * estimate
        return max(RZ_RATIO_PER_CHECK * run.rz, self._max_rz_for_bound(run, self.tolerance))

    def __call__(self, run: ActiveSetRun) -> float | None:
        """The r . z at which to look again, None to end."""
        tolerance = self.tolerance or 0.0
        min_rz = MIN_RZ_RATIO * run.first_rz
        if run.rz > self._max_rz_for_bound(run, tolerance) and not run.is_exhausted:
            return self.first_check(run)
        # the residual is still too large: go on by the factor that it misses, squared as r . z is
        if run.rz > min_rz and not run.is_exhausted and run.residual_norm > self.max_residual_norm:
            miss = MISSED_BOUND_SHARE * self.max_residual_norm / run.residual_norm
            return max(run.rz * max(RZ_RATIO_PER_CHECK, miss**2), min_rz)
        # the bound is computed last, for it takes as long as several steps
        bound = multilevel_algebraic_bound(run.grid, run.u, np.maximum(run.lambda_H, 0))
        if bound <= tolerance or bound > STAGNATION_RATIO * self.last_bound or run.is_exhausted:
            self.bound = bound
            return None
        self.last_bound = bound
        return run.rz * max(RZ_RATIO_PER_CHECK, (MISSED_BOUND_SHARE * tolerance / bound) ** 2)

    @staticmethod
    def _max_rz_for_bound(run: ActiveSetRun, tolerance: float) -> float:
        """The r . z above which the bound is expected to be larger than the tolerance."""
        return max((tolerance / BOUND_PER_ROOT_RZ) ** 2, MIN_RZ_RATIO * run.first_rz)


Criterion = ReductionCriterion | BoundCriterion
