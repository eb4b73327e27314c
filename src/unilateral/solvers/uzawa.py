"""Uzawa's algorithm (5.1)-(5.3) on the condensed system, stopped by a guaranteed algebraic bound.

Everything lives on the boundary: with D = B A_3^{-1} B^T and the offset F(0) (cell means of
A^{-1} f - g), the cell means of u(mu) - g are F(mu) = D mu / H_i + F(0). The iteration runs on
y_i = H_i^{1/2} mu_i, in which the L2 norm of mu is Euclidean and D becomes S = H^{-1/2} D H^{-1/2}.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.errors import InputError, IterationWarning
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.uzawa_steps import STEP_METHODS, UzawaStep

ApplyS = Callable[[Array, Array], object]
ObserveStep = Callable[[Array, Array, Array], None]
MAX_RESIDUAL = 1e300
"""A residual above this ends the run, which would soon overflow. A first residual above it is refused."""
SMALLEST_NORMAL = float(np.finfo(float).tiny)
"""Data whose largest number is below this have lost digits."""


@dataclass(frozen=True, eq=False)
class DualResult:
    """lambda_H (m,) with `bound` on ||lambda_H - exact||_{-1/2,h} = ||u(lambda_H) - u_h||_1.

    `iterations` and `rho` are NaN for an algorithm that has or tells none. `rounding` is by how much the
    bound for the computed u_h exceeds the iteration's own bound; it is 0 where the latter is already for the
    computed u_h.
    """

    lambda_H: Array
    iterations: float
    operator_applications: int
    bound: float
    converged: bool
    rho: float
    algorithm: str
    rounding: float = 0.0

    def add_counts(self, first_run: DualResult) -> DualResult:
        """The result of a run that went on where the first one ended, with the counts of both."""
        return replace(
            self,
            iterations=first_run.iterations + self.iterations,
            operator_applications=first_run.operator_applications + self.operator_applications,
        )


def residual_bound(operator: DualOperator, offset: Array, mu: Array, rho: float) -> float:
    """||R||_S + ||R||_0 / (rho lambda_min^{1/2}), R = mu - max(0, mu - rho F(mu)); inf if S is singular.

    It is guaranteed for the problem with the operator and the offset as they were computed. For the problem
    itself `condensed_algebraic_bound` has the rounding, too.
    """
    if operator.is_singular:
        return math.inf
    # mu - max(0, mu - rho F) = min(mu, rho F)
    R = np.minimum(mu, rho * operator.gap(mu, offset))
    R_norm = dnrm2(np.sqrt(operator.H_i) * R)
    return scaled_matrix_norm(operator.D, R, R_norm) + R_norm / (rho * math.sqrt(operator.lambda_min))


def energy_bound(operator: DualOperator, offset: Array, mu: Array) -> float:
    """The bound (t^2 ||w||^2 + 2 <mu, v - g>)^{1/2} with v = u(mu) + t w.

    w is that of `DualOperator`, and t >= 0 the least with which no mean of v - g is below 0. It bounds the
    same error as `residual_bound`, also where S is singular; rounding leaves about 5e-7.
    """
    return _scaled_energy_bound(operator.gap(mu, offset), operator.H_i * mu, operator)


def predicted_steps(operator: DualOperator, rho: float, start_bound: float, tolerance: float) -> float:
    """Steps of plain Uzawa from bound0 to tolerance: ln(bound0/tolerance) / -ln max |1 - rho lambda|."""
    if start_bound <= tolerance:
        return 0.0
    # each step multiplies the error by at most q = max |1 - rho lambda| over the spectrum of S, at its ends
    q = max(abs(1 - rho * operator.lambda_min), abs(1 - rho * operator.lambda_max))
    if operator.is_singular or q >= 1 or tolerance <= 0:
        return math.inf
    return math.log(start_bound / tolerance) / -math.log(q) if q > 0 else 1.0


def uzawa(
    operator: DualOperator,
    offset: Array,
    tolerance: float,
    rho: float | None = None,
    start: Array | None = None,
    max_steps: int = 100_000,
    method: str = "uzawa",
    apply: ApplyS | None = None,
    observe: ObserveStep | None = None,
) -> DualResult:
    """lambda_H and its bound, by lambda^{n+1} = max(0, lambda^n - rho F(lambda^n)).

    Parameters
    ----------
    offset : (m,)
        F(0).
    tolerance
        The iteration ends when the bound in ||.||_{-1/2,h} is at most this.
    rho, start
        By default UZAWA_STEP_FACTOR / lambda_max(S), and 0; `start` (m,) has to be >= 0.
    max_steps
        A run that ends by these, or leaves the range of floating point, warns and has converged False.
    method
        Another one of `uzawa_steps.STEP_METHODS` makes its own steps, with its own rho by default.
    apply
        `apply(y, out)` computes S y in another way than `ContactColumns`. What is guaranteed is then so for
        the S y that it finds.
    observe
        `observe(y, F, R)` sees every step.

    Raises
    ------
    InputError
        For an offset, a rho or a tolerance that cannot be meant, for "newton" where S is singular, and for
        data or a start from which the first residual is not below MAX_RESIDUAL.
    """
    check_offset(offset, tolerance)
    rho = _choose_rho(operator, method, rho)
    scaling = np.sqrt(operator.H_i)
    # y_i = H_i^{1/2} mu_i
    y = np.zeros(len(scaling)) if start is None else scaling * start
    iteration = _Iteration(operator, scaling * offset, rho, apply, observe)
    advance = STEP_METHODS[method](operator.S, iteration.b, rho, y)
    with np.errstate(over="ignore", invalid="ignore"):
        steps, bound = iteration.run(y, advance, tolerance, max_steps)
    result = DualResult(
        y / scaling,
        iterations=steps,
        operator_applications=iteration.applications,
        bound=bound,
        converged=bound <= tolerance,
        rho=rho,
        algorithm=method,
    )
    warn_of_missed_tolerance(result, tolerance)
    return result


def _choose_rho(operator: DualOperator, method: str, rho: float | None) -> float:
    """The step rho, by default the method's own. Raises InputError if it or the method cannot be meant."""
    if method == "newton" and operator.is_singular:
        raise InputError("the method newton needs a regular S, with h/H small; take active_set")
    if rho is None:
        rho = STEP_METHODS[method].rho_factor / operator.lambda_max
    if not 0 < rho < math.inf:
        raise InputError(f"the step rho = {rho} must be positive and finite")
    return rho


def warn_of_missed_tolerance(result: DualResult, tolerance: float) -> None:
    """Gives an IterationWarning of one sentence if the result's bound misses the tolerance."""
    if not result.converged:
        message = (
            f"{result.algorithm} stopped after {result.iterations} steps with the algebraic bound "
            f"{result.bound:.3g}, above the tolerance {tolerance:.3g}"
        )
        warnings.warn(message, IterationWarning, stacklevel=3)


class ContactColumns:
    """Computes S y from the columns of the cells in contact, often few; they are copied when these change."""

    def __init__(self, S: Array) -> None:
        self.S = S
        self.contact_mask: bytes | None = None

    def __call__(self, y: Array, out: Array) -> None:
        """Write S y (m,) into `out`."""
        mask = (y != 0).tobytes()
        if mask != self.contact_mask:
            self.contact_mask = mask
            self.contact = y.nonzero()[0]
            self.columns = self.S[self.contact]  # rows: S is symmetric
        np.dot(y[self.contact], self.columns, out=out)


class _Iteration:
    """The loop and its buffers: F = S y + b is the scaled gap, R = min(y, rho F) the scaled residual."""

    def __init__(
        self, operator: DualOperator, b: Array, rho: float, apply: ApplyS | None, observe: ObserveStep | None
    ) -> None:
        self.operator = operator
        self.scaling = np.sqrt(operator.H_i)
        self.b = b
        self.rho = rho
        self.observe = observe
        self.apply = apply or ContactColumns(operator.S)
        self.singular = operator.is_singular
        self.bound_per_residual = math.inf if self.singular else 1 / (rho * math.sqrt(operator.lambda_min))
        self.applications = 0

    def run(self, y: Array, advance: UzawaStep, tolerance: float, max_steps: int) -> tuple[int, float]:
        """Iterates on y in place. Returns the number of steps, and the bound that belongs to the final y."""
        F = np.empty_like(y)
        R = np.empty_like(y)
        for step in range(max_steps + 1):
            # F = S y + b, R = min(y, rho F): by (5.2), (5.3) the next iterate is y - R
            self.apply(y, F)
            np.add(F, self.b, out=F)
            np.multiply(F, self.rho, out=R)
            np.minimum(y, R, out=R)
            if self.observe:
                self.observe(y, F, R)
            size = dnrm2(R)  # scaled: the square of a tiny R would be 0
            if step == 0 and not size < MAX_RESIDUAL:
                raise InputError(
                    f"the first residual, {size:.3g}, is not below {MAX_RESIDUAL:g}; scale the data to about "
                    "1, start from smaller numbers, or take a smaller rho"
                )
            # if ||R||_0 / (rho lambda_min^{1/2}) is above the tolerance, so is the bound: no need for ||R||_S
            last = step == max_steps or not size < MAX_RESIDUAL
            if last or self.singular or size * self.bound_per_residual <= tolerance:
                bound = self._bound(y, F, R, size)
                if last or bound <= tolerance:
                    break
            advance(y, F, R)
        self.applications += step + 1
        return step, bound

    def _bound(self, y: Array, F: Array, R: Array, size: float) -> float:
        """||R||_S + ||R||_0 / (rho lambda_min^{1/2}), or the bound by the energy where S is singular."""
        if self.singular:
            return _scaled_energy_bound(F / self.scaling, self.scaling * y, self.operator)
        if not size < MAX_RESIDUAL:
            return math.inf
        self.applications += 1
        return scaled_matrix_norm(self.operator.S, R, size) + size * self.bound_per_residual


def _scaled_energy_bound(gap: Array, weighted_mu: Array, operator: DualOperator) -> float:
    """The bound by the energy, from the means of u(mu) - g and H_i mu_i."""
    # in units of the largest number, because the square of a tiny one would be 0
    unit = max(float(np.abs(gap).max()), float(weighted_mu.max()))
    if not 0 < unit < math.inf:
        return unit
    t = operator.required_shift(gap) / unit
    if not t < math.inf:
        return math.inf
    # (t ||w||)^2 + 2 <mu, v - g>, v = u(mu) + t w
    product = float(weighted_mu / unit @ (gap / unit + t * operator.shift_means))
    return unit * math.sqrt(max((t * operator.shift_norm) ** 2 + 2 * product, 0.0))


def scaled_matrix_norm(matrix: Array, R: Array, scale: float) -> float:
    """The norm (R . matrix R)^{1/2} for R (m,) of the size `scale`; squares neither overflow nor vanish."""
    return scale * math.sqrt(max(float(R / scale @ (matrix @ (R / scale))), 0.0)) if scale > 0 else 0.0


def check_offset(offset: Array, tolerance: float) -> None:
    """Raises InputError for an offset (m,) that is not finite, or too small, and for a negative tolerance."""
    if not np.all(np.isfinite(offset)):
        raise InputError(f"the offset must hold {len(offset)} finite numbers, one for each cell of T_H")
    largest = float(np.max(np.abs(offset), initial=0))
    if 0 < largest < SMALLEST_NORMAL:
        raise InputError(
            f"the offset's largest number, {largest:.3g}, has lost digits of double precision; scale the "
            "data to about 1"
        )
    if not tolerance >= 0:
        raise InputError(f"the tolerance {tolerance} must be a number that is not negative")
