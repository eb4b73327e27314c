"""One run of the study of cost: its algorithm, way to S y and precision; what it reaches, for how much."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple, TypeVar

import numpy as np

from study import operations
from study.experiments.cost.history import History, Reached, by_A, by_A_3, by_S, by_S32, refined
from study.experiments.cost.variants import REFRESH, Variant
from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, with_solution
from unilateral.fem.condense import Condensed, by_sparse, matrix
from unilateral.fem.linear_systems import Sparse, dissected
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import uniform
from unilateral.norms.dual import Gram
from unilateral.norms.exact_errors import Exact, cell_means
from unilateral.norms.ritz import ritz_projection
from unilateral.problems.case import ExactSolution
from unilateral.solvers.uzawa import Apply, uzawa
from unilateral.solvers.uzawa_steps import STEPS

Errors = tuple[float, float, float, float]
Made = TypeVar("Made")
SAFE = 1.9
METHODS = {"safe": "uzawa", "optimal": "uzawa"}
"""The methods of the algorithms that have a step rho of their own, and no other difference."""
EXACT, MOST_NEWTON = 1e-10, 100
"""The tolerance, as a share of ||u - z_h||_1, of the discrete solution that the levels refer to, and its most
steps."""


class Costs(NamedTuple):
    """Operations of the set-up, a residual, the step from there, and a check of the guaranteed bound."""

    setup: float
    residual: float
    advance: float
    check: float

    def total(self, reached: Reached) -> float:
        """The operations of a run that stops there."""
        steps = (reached.steps + 1) * self.residual + reached.steps * self.advance
        return self.setup + steps + reached.checks * self.check + reached.solving


@dataclass(frozen=True, eq=False)
class Measured:
    """A case on a mesh and a partition, with the dual norm's forms there, in which it has the number `c`.

    `alone` are the factors of A for steps without elimination of the interior; `of_A` has the counts of A's
    factors, by the matrix of a step.
    """

    exact: Exact
    discrete: CondensedProblem
    form: Gram
    c: int
    alone: Sparse
    of_A: Mapping[str, operations.Factors]

    @property
    def spaces(self) -> MixedSpaces:
        return self.discrete.spaces

    @cached_property
    def discrete_errors(self) -> Errors:
        """`errors` of the discrete solution (u_h, lambda_H)."""
        tolerance = EXACT * self.exact.ritz.ritz_error
        solve = partial(uzawa, max_steps=MOST_NEWTON, method="newton")
        return self.errors(solve(self.spaces.operator, self.discrete.offset, tolerance).lambda_H)

    @cached_property
    def norms(self) -> Errors:
        """||u||_1, the bounds on ||lambda||_{-1/2} and ||lambda||_0."""
        return (self.exact.ritz.u_norm, *self.errors(np.zeros(self.spaces.partition.n_cells))[1:])

    def errors(self, mu: Array) -> Errors:
        """||u - u(mu)||_1, the bounds on ||lambda - mu||_{-1/2} and ||lambda - mu||_0, for mu (m,)."""
        errors = self.exact.errors(self.spaces, mu)
        lower, upper = self.form.error(self.c, (self.exact.means.lambda_means - mu)[None])
        return errors.h1, max(float(lower[0]), errors.hm12_discrete), float(upper[0]), errors.l2

    def rho(self, algorithm: str) -> float:
        """The step: the safe 1.9 sigma_1, the best one if all is in contact, or the method's own."""
        operator = self.spaces.operator
        if algorithm == "safe":
            return SAFE * self.spaces.condensed.sigma_1
        if algorithm == "optimal":
            return 2 / (operator.lambda_min + operator.lambda_max)
        return STEPS[algorithm].share / operator.lambda_max

    def apply(self, variant: Variant) -> Apply:
        """The way in which the variant computes S y."""
        spaces, operator = self.spaces, self.spaces.operator
        ways = {
            ("A", "float64"): lambda: by_A(self.alone, spaces),
            ("A_3", "float64"): lambda: by_A_3(spaces),
            ("S", "float64"): lambda: by_S(operator),
            ("S", "float32"): lambda: by_S32(operator),
            ("S", "refined"): lambda: refined(operator),
        }
        return ways[variant.algebra, variant.precision]()

    def costs(self, variant: Variant) -> Costs:
        """The costs by the formulas of `operations`. The set-up has two solves, with f and for u_h.

        Where S is not formed rho and lambda_min(S) are taken as given.
        """
        m, nb, nnz = self.spaces.partition.n_cells, len(self.spaces.mesh.boundary), self.spaces.B.nnz
        of_A = self.of_A[variant.algebra]
        once = of_A.factorise + 2 * of_A.solve
        setup, application = {
            "A": (once, operations.apply_A(m, nb, nnz, of_A)),
            "A_3": (once + operations.scale_A_3(nb), operations.apply_A_3(m, nb, nnz)),
            "S": (once + operations.form_S(m, nb) + operations.spectrum(m), operations.apply_S(m)),
        }[variant.algebra]
        refreshing = application / REFRESH + 2 * m if variant.precision == "refined" else 0
        advance = operations.PER_CELL[method_of(variant)] * m
        return Costs(setup, application + refreshing + 4 * m, advance, application + 2 * m)

    def run(self, variant: Variant, stops: Sequence[float], max_steps: int) -> tuple[list[Reached], float]:
        """What is reached at each of the falling levels, as long as they are met, and seconds a step."""
        operator, offset, rho = self.spaces.operator, self.discrete.offset, self.rho(variant.algorithm)
        method, tolerances = method_of(variant), [stop * self.discrete_errors[0] for stop in stops]
        apply = self.apply(variant)
        history = History(operator, offset, rho, tolerances)
        observe = history.with_solves if method == "newton" else history
        steps = partial(uzawa, max_steps=max_steps, method=method, apply=apply, observe=observe)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            _, seconds = timed(partial(steps, operator, offset, tolerances[-1], rho))
        return history.reached, (seconds - history.aside) / (history.steps + 1)


def method_of(variant: Variant) -> str:
    """The variant's method, a name in `uzawa_steps.STEPS`."""
    return METHODS.get(variant.algorithm, variant.algorithm)


class Shared:
    """What the variants on a mesh share, and the seconds that it took: to condense, to dissect, to couple.

    `measured` is by case and H/h, `coupled`, the spaces and the seconds, by H/h.
    """

    def __init__(
        self, mesh: Mesh, cases: Sequence[ExactSolution], gram: Gram, variants: Sequence[Variant]
    ) -> None:
        (factors, condensed), self.condensing = timed(partial(_condensed, mesh))
        alone, self.dissecting = timed(lambda: dissected(matrix(mesh)))
        eliminated = operations.factors(factors.lu)
        of_A = {"A": operations.factors(alone.lu), "A_3": eliminated, "S": eliminated}
        ratios = {variant.H_over_h for variant in variants}
        self.coupled = {ratio: timed(partial(_spaces, condensed, ratio)) for ratio in ratios}
        self.measured: dict[tuple[str, float], Measured] = {}
        for c, case in enumerate(cases):
            own = {variant.H_over_h for variant in variants if variant.case == case.name}
            if own:
                problem = ritz_projection(case, condensed)
            for ratio in own:
                spaces = self.coupled[ratio][0]
                exact = Exact(problem, cell_means(case, spaces.partition))
                discrete, form = with_solution(spaces, exact), gram.on(spaces.partition)
                self.measured[case.name, ratio] = Measured(exact, discrete, form, c, alone, of_A)


def _condensed(mesh: Mesh) -> tuple[Sparse, Condensed]:
    """The mesh condensed by sparse elimination, whose operations are counted, with the factors."""
    factors = dissected(matrix(mesh), mesh.boundary)
    return factors, by_sparse(mesh, factors)


def _spaces(condensed: Condensed, ratio: float) -> MixedSpaces:
    """The spaces for that H/h, with the spectrum of S, which is found once and kept."""
    mesh = condensed.mesh
    spaces = mixed_spaces(condensed, uniform(mesh.polygon, ratio * mesh.h))
    spaces.operator.spectrum  # noqa: B018
    return spaces


def timed(make: Callable[[], Made]) -> tuple[Made, float]:
    """What `make` returns, and the seconds it takes."""
    begin = time.perf_counter()
    return make(), time.perf_counter() - begin
