"""A bound on the algebraic errors of u_h and lambda_H as they were computed, rounding included.

Let u in V_h and mu >= 0 be any, e = u - u_h with the exact u_h and lambda of the discrete problem, and

    r = load + B^T mu - A u,     ||r|| <= delta in the dual norm of V_h,

so that (e, .)_1 = <mu - lambda, .> - r and ||mu - lambda||_{-1/2,h} <= ||e||_1 + delta. Let F be the means of
u - g and F_h those of u_h - g, so that (F - F_h, nu) = <nu, e> for nu in Lambda_H. With

    R = mu - max(0, mu - rho F),     a = ||R||_{-1/2,h},     b = ||R||_0 / (rho lambda_min(S)^{1/2}),

rho (F - F_h, mu - R - lambda) <= (R, mu - R - lambda), as for the projection in (5.2), and therefore

    ||e||_1^2 <= <mu - lambda, e> + delta ||e||_1 <= (a + delta) ||e||_1 + b (||e||_1 + delta),

which fails for ||e||_1 > a + b + 2 delta, so ||e||_1 is at most that. Where S is singular take t >= 0 such
that no mean of v - g is below 0 for v = u + t w, w in V_h that of `DualOperator`. Then
<mu - lambda, v - u_h> <= <mu, v - g>, and as <mu - lambda, w> = (e, w)_1 + r(w)

    ||e||_1^2 <= <mu, v - g> + (t ||w||_1 + delta) ||e||_1 + t ||w||_1 delta,
    ||e||_1^2 <= 2 <mu, v - g> + (t ||w||_1 + 2 delta)^2.

For ||mu - lambda||_{-1/2,h} another delta is added.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.fem.residual_rounding import NORM_ROUNDING_FACTOR, Rounded
from unilateral.fem.spaces import FORM_ROUNDING, DualOperator
from unilateral.solvers.uzawa import scaled_matrix_norm


def condensed_algebraic_bound(
    operator: DualOperator, mu: Array, gap: Rounded, delta: float, rho: float
) -> float:
    """A bound on ||u - u_h||_1 and on ||mu - lambda||_{-1/2,h}, for any u and mu (m,) >= 0.

    `gap` (m,) are the cell means of u - g. `delta` bounds the dual norm of load + B^T mu - A u; it counts
    twice for u and once more for mu. Where rho is NaN, 1 / lambda_max(S) takes its place.
    """
    if not len(mu):
        return delta
    if math.isnan(rho):
        rho = 1 / operator.lambda_max
    if not operator.lambda_min_lower > 0:
        return _singular_algebraic_bound(operator, mu, gap, delta)
    # R = mu - max(0, mu - rho F) = min(mu, rho F), with the least and the largest F that rounding allows
    low = np.minimum(mu, rho * (gap.values - gap.rounding))
    R = np.minimum(mu, rho * gap.values)
    high = np.minimum(mu, rho * (gap.values + gap.rounding))
    weights = np.sqrt(operator.H_i)
    R_norm = float(dnrm2(weights * R))
    R_rounding = float(dnrm2(weights * (high - low)))
    # ||R||_{-1/2,h} <= lambda_max(S)^{1/2} ||R||_0 for what rounding has done to R, with room for lambda_max
    a_rounding = R_rounding * math.sqrt(2 * operator.lambda_max)
    a = (1 + FORM_ROUNDING) * scaled_matrix_norm(operator.D, R, R_norm) + a_rounding
    return a + (R_norm + R_rounding) / (rho * math.sqrt(operator.lambda_min_lower)) + 3 * delta


def _singular_algebraic_bound(operator: DualOperator, mu: Array, gap: Rounded, delta: float) -> float:
    """The bound of `condensed_algebraic_bound` where S is singular."""
    # in units of the largest number, because the square of a tiny one would be 0
    weighted = operator.H_i * mu
    unit = max(float(np.max(numbers)) for numbers in (np.abs(gap.values), gap.rounding, weighted, [delta]))
    if not 0 < unit < math.inf:
        return unit  # 0 if all numbers are 0, else nothing is known
    t = operator.required_shift(gap.values - gap.rounding) / unit
    if not t < math.inf:
        return math.inf
    # 2 <mu, v - g> + (t ||w|| + 2 delta)^2, v = u + t w; the delta added last is for lambda
    product = float(weighted / unit @ ((gap.values + gap.rounding) / unit + t * operator.shift_means))
    linear = t * operator.shift_norm + 2 * delta / unit
    return NORM_ROUNDING_FACTOR * unit * math.hypot(math.sqrt(2 * max(product, 0.0)), linear) + delta
