"""One run of Uzawa's loop from which every stopping level is read off, and the operations that it takes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dnrm2

from study import operations
from study.experiments.cost.products import PRODUCTS_PER_REFRESH, make_product
from study.stability_constants import bound_multiplier_error
from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem
from unilateral.fem.linear_systems import SparseFactors
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.norms.dual import Gram
from unilateral.norms.exact_errors import CaseProjections
from unilateral.solvers.uzawa import scaled_matrix_norm, uzawa
from unilateral.solvers.uzawa_steps import STEP_METHODS, UZAWA_STEP_FACTOR

DISCRETE_TOLERANCE_SHARE = 1e-10
"""The tolerance, as a share of ||u - z_h||_1, of the discrete solution that the levels refer to."""
MAX_NEWTON_STEPS = 100
FourErrors = tuple[float, float, float, float]


class Variant(NamedTuple):
    """One configuration. `algebra` is the matrix that a step solves with (A, A_3) or multiplies by (S)."""

    scene: str
    case: str
    H_over_h: float
    algorithm: str
    algebra: str
    precision: str


@dataclass(frozen=True, eq=False)
class PosedCase:
    """A case on a mesh and a partition, with the dual norm's forms there.

    In these it has the number `case_index`. `factors` are those of A for steps without elimination of the
    interior; `counts` has the counts of A's factors, by the matrix of a step.
    """

    exact: CaseProjections
    discrete: CondensedProblem
    form: Gram
    case_index: int
    factors: SparseFactors
    counts: Mapping[str, operations.FactorCounts]

    @property
    def spaces(self) -> MixedSpaces:
        """The spaces of the discrete problem."""
        return self.discrete.spaces

    @cached_property
    def discrete_errors(self) -> FourErrors:
        """`errors` of the discrete solution (u_h, lambda_H)."""
        tolerance = DISCRETE_TOLERANCE_SHARE * self.exact.ritz.ritz_error
        solution = uzawa(
            self.spaces.operator, self.discrete.offset, tolerance, max_steps=MAX_NEWTON_STEPS, method="newton"
        )
        return self.errors(solution.lambda_H)

    @cached_property
    def exact_norms(self) -> FourErrors:
        """||u||_1, the bounds on ||lambda||_{-1/2} and ||lambda||_0."""
        return (self.exact.ritz.u_norm, *self.errors(np.zeros(self.spaces.partition.n_cells))[1:])

    def errors(self, mu: Array) -> FourErrors:
        """||u - u(mu)||_1, the bounds on ||lambda - mu||_{-1/2} and ||lambda - mu||_0, for mu (m,)."""
        errors = self.exact.errors(self.spaces, mu)
        mean_errors = self.exact.cell_means.lambda_means - mu
        lower, upper = bound_multiplier_error(self.form, self.case_index, mean_errors, errors.hm12_discrete)
        return errors.h1, lower, upper, errors.l2


class ReachedLevel(NamedTuple):
    """What a run that stops at a level has done.

    `lambda_H` (m,) is lambda^n of n = `steps`. `bound` is guaranteed, in double precision; `checks` are the
    products S y that it took, and `newton_operations` the operations of Newton's own solves.
    """

    lambda_H: Array
    steps: int
    checks: int
    bound: float
    newton_operations: int

    @property
    def applications(self) -> int:
        """Products S y, those of the checks included."""
        return self.steps + 1 + self.checks


class History:
    """Observes the loop: `reached_levels` has an entry for each of the falling `tolerances` that was met.

    A step is checked as the loop does: by its residual, and by the bound where that is small enough.
    """

    def __init__(
        self, operator: DualOperator, offset: Array, method: str, rho: float, tolerances: Sequence[float]
    ) -> None:
        self.operator = operator
        self.offset = offset
        self.method = method
        self.rho = rho
        self.tolerances = tolerances
        self.root = np.sqrt(operator.H_i)
        self.bound_per_residual = 1 / (rho * np.sqrt(operator.lambda_min))
        self.reached_levels: list[ReachedLevel] = []
        self.steps = -1
        self.newton_operations = 0
        self.checks = 0  # since the last level that was met

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Record the levels that this step meets, and count its solve on the cells in contact, y > R."""
        self.steps += 1
        self._record_levels(y, dnrm2(R) * self.bound_per_residual)
        if self.method == "newton":
            self.newton_operations += operations.count_newton_solve(int(np.count_nonzero(y > R)))

    def _record_levels(self, y: Array, residual: float) -> None:
        """The levels that y meets, by its residual in the loop's own precision and then by its bound."""
        waiting = self.tolerances[len(self.reached_levels) :]
        if not waiting or residual > waiting[0]:
            return
        bound = self._residual_bound(y)
        for tolerance in waiting:
            if residual > tolerance:
                return
            self.checks += 1
            if bound > tolerance:
                return
            self.reached_levels.append(
                ReachedLevel(y / self.root, self.steps, self.checks, bound, self.newton_operations)
            )
            self.checks = 0

    def _residual_bound(self, y: Array) -> float:
        """The bound of `residual_bound`, in double precision whatever the loop's own is."""
        S = self.operator.S
        # ||u(mu) - u_h||_1 <= ||R||_S + ||R||_0 / (rho lambda_min(S)^{1/2}), R = y - max(0, y - rho F)
        R = np.minimum(y, self.rho * (S @ y + self.root * self.offset))
        size = dnrm2(R)
        return scaled_matrix_norm(S, R, size) + size * self.bound_per_residual


def method_and_step(algorithm: str, spaces: MixedSpaces) -> tuple[str, float]:
    """The name of its steps in `uzawa_steps.STEP_METHODS`, and rho.

    "safe" and "optimal" are Uzawa's steps with 1.9 sigma_1, and with the best rho if all is in contact.
    """
    operator = spaces.operator
    match algorithm:
        case "safe":
            return "uzawa", UZAWA_STEP_FACTOR * spaces.condensed.sigma_1
        case "optimal":
            return "uzawa", 2 / (operator.lambda_min + operator.lambda_max)
    return algorithm, STEP_METHODS[algorithm].rho_factor / operator.lambda_max


def run_to_levels(
    posed_case: PosedCase, variant: Variant, stops: Sequence[float], max_steps: int
) -> list[ReachedLevel]:
    """The levels that a run meets, of the falling ones asked for."""
    operator = posed_case.spaces.operator
    offset = posed_case.discrete.offset
    method, rho = method_and_step(variant.algorithm, posed_case.spaces)
    tolerances = [stop * posed_case.discrete_errors[0] for stop in stops]
    apply = make_product(variant.algebra, variant.precision, posed_case.spaces, posed_case.factors)
    history = History(operator, offset, method, rho, tolerances)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of runs that do not converge
        uzawa(
            operator,
            offset,
            tolerances[-1],
            rho,
            max_steps=max_steps,
            method=method,
            apply=apply,
            observe=history,
        )
    return history.reached_levels


def count_operations(
    posed_case: PosedCase, variant: Variant, reached: Sequence[ReachedLevel]
) -> tuple[float, float, list[float]]:
    """Operations of the set-up, of a step, and of the runs that stop at what is reached.

    The set-up has two solves, with f and for u_h. Where S is not formed rho and lambda_min(S) are taken as
    given.
    """
    m = posed_case.spaces.partition.n_cells
    nb = len(posed_case.spaces.mesh.boundary)
    nnz = posed_case.spaces.B.nnz
    counts = posed_case.counts[variant.algebra]
    setup: float = counts.factorise + 2 * counts.solve
    match variant.algebra:
        case "A":
            application: float = operations.count_product_by_A(m, nb, nnz, counts)
        case "A_3":
            setup += operations.count_scaling_of_A_3(nb)
            application = operations.count_product_by_A_3(m, nb, nnz)
        case _:
            setup += operations.count_forming_S(m, nb) + operations.count_spectrum(m)
            application = operations.count_product_by_S(m)
    # A residual: S y, plus 4 m for F, rho F, R and its norm; one refined product in 50 is made twice.
    residual = application + 4 * m
    if variant.precision == "refined":
        residual += application / PRODUCTS_PER_REFRESH + 2 * m
    advance = (
        operations.STEP_OPERATIONS_PER_CELL[method_and_step(variant.algorithm, posed_case.spaces)[0]] * m
    )
    # A check of the bound: S R, and two products of vectors.
    check = application + 2 * m
    totals = [
        setup
        + (level.steps + 1) * residual
        + level.steps * advance
        + level.checks * check
        + level.newton_operations
        for level in reached
    ]
    return setup, residual + advance, totals
