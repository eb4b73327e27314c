"""Uzawa's algorithm as section 5 of the paper means it, as its indices read, and without the projection."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.fem.spaces import DualOperator

AS_MEANT = "as meant"
"""(5.1)-(5.3) with u^n from lambda^n."""
AS_PRINTED = "as printed"
"""With u^n from lambda^(n-1), as the printed index reads."""
UNCLIPPED = "without the clip"
"""With u^n from lambda^n, but without max(0, .)."""
VARIANTS = (AS_MEANT, AS_PRINTED, UNCLIPPED)


def iterate_variant(operator: DualOperator, offset: Array, rho: float, steps: int, variant: str) -> Array:
    """The iterate lambda^steps, from lambda^0 = 0 and, in the variant that uses it, lambda^(-1) = 0."""
    mu = previous = np.zeros(len(offset))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            observed = previous if variant == AS_PRINTED else mu
            # (5.1), (5.2): lambda^{n+1} = max(0, lambda^n - rho (means of u^n - g)), u^n of the observed one
            updated = mu - rho * operator.gap(observed, offset)
            previous = mu
            mu = updated if variant == UNCLIPPED else np.maximum(0, updated)
    return mu
