"""The errors of one discrete solution in the three norms, lambda's in H^{-1/2} between guaranteed bounds."""

from __future__ import annotations

import math
from typing import NamedTuple

from unilateral.arrays import Array
from unilateral.fem.spaces import MixedSpaces
from unilateral.norms.dual import dual_norm
from unilateral.norms.exact import Exact


class Errors(NamedTuple):
    """||u - u_h||_1, bounds of ||lambda - lambda_H||_{-1/2}, ||lambda - lambda_H||_0; NaN where not judged.

    lambda is not judged where beta is 0; its L2 error is NaN where lambda is not in L2.
    """

    h1: float
    hm12_lower: float
    hm12_upper: float
    l2: float


def errors(exact: Exact, spaces: MixedSpaces, mu: Array) -> Errors:
    """The errors of (u(mu), mu) for mu (m,)."""
    found = exact.errors(spaces, mu)
    if spaces.operator.singular:
        return Errors(found.h1, math.nan, math.nan, math.nan)
    case, cells = exact.ritz.case, spaces.partition
    bounds = dual_norm(cells, [case]).of_error(case, spaces.extended(mu)[None])
    lower = max(found.hm12_discrete, float(bounds.lower[0]))
    return Errors(found.h1, lower, float(bounds.upper[0]), found.l2)
