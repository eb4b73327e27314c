"""Uzawa's algorithm as section 5 of the paper means it, as its indices read, and without the projection."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.fem.spaces import DualOperator

VARIANTS = ("as meant", "as printed", "without the clip")
"""(5.1)-(5.3) with u^n from lambda^n; with u^n from lambda^(n-1), as the printed index reads; and with u^n
from lambda^n but without max(0, .)."""


def iterate(operator: DualOperator, offset: Array, rho: float, steps: int, variant: str) -> Array:
    """The iterate lambda^steps, from lambda^0 = 0 and, in the variant that uses it, lambda^(-1) = 0."""
    now = before = np.zeros(len(offset))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            of = before if variant == "as printed" else now
            new = now - rho * operator.gap(of, offset)
            now, before = (new if variant == "without the clip" else np.maximum(0, new)), now
    return now
