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
from study.experiments.cost.products import REFRESH, product
from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem
from unilateral.fem.linear_systems import Sparse
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.norms.dual import Gram
from unilateral.norms.exact_errors import Exact
from unilateral.solvers.uzawa import energy_norm, uzawa
from unilateral.solvers.uzawa_steps import STEPS

SAFE_SHARE = 1.9
"""The safe step is this share of sigma_1."""
EXACT = 1e-10
"""The tolerance, as a share of ||u - z_h||_1, of the discrete solution that the levels refer to."""
MAX_NEWTON_STEPS = 100
Errors = tuple[float, float, float, float]


class Variant(NamedTuple):
    """One configuration. `algebra` is the matrix that a step solves with (A, A_3) or multiplies by (S)."""

    scene: str
    case: str
    H_over_h: float
    algorithm: str
    algebra: str
    precision: str


@dataclass(frozen=True, eq=False)
class Posed:
    """A case on a mesh and a partition, with the dual norm's forms there, in which it has the number `c`.

    `factors` are those of A for steps without elimination of the interior; `counts` has the counts of A's
    factors, by the matrix of a step.
    """

    exact: Exact
    discrete: CondensedProblem
    form: Gram
    c: int
    factors: Sparse
    counts: Mapping[str, operations.Factors]

    @property
    def spaces(self) -> MixedSpaces:
        return self.discrete.spaces

    @cached_property
    def discrete_errors(self) -> Errors:
        """`errors` of the discrete solution (u_h, lambda_H)."""
        tolerance = EXACT * self.exact.ritz.ritz_error
        solution = uzawa(
            self.spaces.operator,
            self.discrete.offset,
            tolerance,
            max_steps=MAX_NEWTON_STEPS,
            method="newton",
        )
        return self.errors(solution.lambda_H)

    @cached_property
    def norms(self) -> Errors:
        """||u||_1, the bounds on ||lambda||_{-1/2} and ||lambda||_0."""
        return (self.exact.ritz.u_norm, *self.errors(np.zeros(self.spaces.partition.n_cells))[1:])

    def errors(self, mu: Array) -> Errors:
        """||u - u(mu)||_1, the bounds on ||lambda - mu||_{-1/2} and ||lambda - mu||_0, for mu (m,)."""
        errors = self.exact.errors(self.spaces, mu)
        lower, upper = self.form.error(self.c, (self.exact.means.lambda_means - mu)[None])
        return errors.h1, max(float(lower[0]), errors.hm12_discrete), float(upper[0]), errors.l2


class Reached(NamedTuple):
    """What a run that stops at a level has done.

    `lambda_H` (m,) is lambda^n of n = `steps`. `bound` is guaranteed, in double precision; `checks` are the
    products S y that it took, and `solving` the operations of Newton's own solves.
    """

    lambda_H: Array
    steps: int
    checks: int
    bound: float
    solving: int

    @property
    def applications(self) -> int:
        """Products S y, those of the checks included."""
        return self.steps + 1 + self.checks


class History:
    """Observes the loop: `reached` has an entry for each of the falling `tolerances` that was met.

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
        self.per_residual = 1 / (rho * np.sqrt(operator.lambda_min))
        self.reached: list[Reached] = []
        self.steps = -1
        self.solving = 0
        self.checks = 0  # since the last level that was met

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Record the levels that this step meets, and count its solve on the cells in contact, y > R."""
        self.steps += 1
        self._record(y, dnrm2(R) * self.per_residual)
        if self.method == "newton":
            self.solving += operations.newton_solve(int(np.count_nonzero(y > R)))

    def _record(self, y: Array, residual: float) -> None:
        """The levels that y meets, by its residual in the loop's own precision and then by its bound."""
        waiting = self.tolerances[len(self.reached) :]
        if not waiting or residual > waiting[0]:
            return
        bound = self._bound(y)
        for tolerance in waiting:
            if residual > tolerance:
                return
            self.checks += 1
            if bound > tolerance:
                return
            self.reached.append(Reached(y / self.root, self.steps, self.checks, bound, self.solving))
            self.checks = 0

    def _bound(self, y: Array) -> float:
        """The bound of `residual_bound`, in double precision whatever the loop's own is."""
        S = self.operator.S
        R = np.minimum(y, self.rho * (S @ y + self.root * self.offset))
        size = dnrm2(R)
        return energy_norm(S, R, size) + size * self.per_residual


def method_and_step(algorithm: str, spaces: MixedSpaces) -> tuple[str, float]:
    """The name of its steps in `uzawa_steps.STEPS`, and rho.

    "safe" and "optimal" are Uzawa's steps with 1.9 sigma_1, and with the best rho if all is in contact.
    """
    operator = spaces.operator
    match algorithm:
        case "safe":
            return "uzawa", SAFE_SHARE * spaces.condensed.sigma_1
        case "optimal":
            return "uzawa", 2 / (operator.lambda_min + operator.lambda_max)
    return algorithm, STEPS[algorithm].share / operator.lambda_max


def reach(posed: Posed, variant: Variant, stops: Sequence[float], max_steps: int) -> list[Reached]:
    """What is reached at each of the falling levels, as long as they are met."""
    operator = posed.spaces.operator
    offset = posed.discrete.offset
    method, rho = method_and_step(variant.algorithm, posed.spaces)
    tolerances = [stop * posed.discrete_errors[0] for stop in stops]
    apply = product(variant.algebra, variant.precision, posed.spaces, posed.factors)
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
    return history.reached


def count_operations(
    posed: Posed, variant: Variant, reached: Sequence[Reached]
) -> tuple[float, float, list[float]]:
    """Operations of the set-up, of a step, and of the runs that stop at what is reached.

    The set-up has two solves, with f and for u_h. Where S is not formed rho and lambda_min(S) are taken as
    given.
    """
    m = posed.spaces.partition.n_cells
    nb = len(posed.spaces.mesh.boundary)
    nnz = posed.spaces.B.nnz
    counts = posed.counts[variant.algebra]
    setup: float = counts.factorise + 2 * counts.solve
    match variant.algebra:
        case "A":
            application: float = operations.apply_A(m, nb, nnz, counts)
        case "A_3":
            setup += operations.scale_A_3(nb)
            application = operations.apply_A_3(m, nb, nnz)
        case _:
            setup += operations.form_S(m, nb) + operations.spectrum(m)
            application = operations.apply_S(m)
    # A residual: S y, plus 4 m for F, rho F, R and its norm; one product in REFRESH is made twice.
    residual = application + 4 * m
    if variant.precision == "refined":
        residual += application / REFRESH + 2 * m
    advance = operations.PER_CELL[method_and_step(variant.algorithm, posed.spaces)[0]] * m
    # A check of the bound: S R, and two products of vectors.
    check = application + 2 * m
    totals = [
        setup + (each.steps + 1) * residual + each.steps * advance + each.checks * check + each.solving
        for each in reached
    ]
    return setup, residual + advance, totals
