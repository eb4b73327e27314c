"""The positive part of arrays."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array


def positive_power(a: Array, k: float) -> Array:
    """a_+^k elementwise: 0 where a <= 0, whatever the sign of k."""
    a = np.asarray(a, dtype=float)
    positive = a > 0
    safe = np.where(positive, a, 1.0)
    if k == int(k) and 0 <= k <= 8:
        power = np.ones_like(safe)
        for _ in range(int(k)):
            power *= safe
    else:
        power = np.sqrt(safe) ** round(2 * k) if 2 * k == round(2 * k) else safe**k
    return np.where(positive, power, 0.0)
