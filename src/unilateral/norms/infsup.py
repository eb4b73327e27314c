"""The inf-sup constants of Lemma 3.1 for one mesh and one partition, between bounds that hold up to rounding.

The first inequality of (3.4) holds with beta^2 the smallest eigenvalue of D x = beta^2 G x, D the dual
operator and G the Gram matrix of ||.||_{-1/2} on P0(T_H). G is known from both sides as a form, and so is
beta; below 1e-6, where its square is rounding, it counts as 0. The second holds with
beta_0^2 = lambda_min(S) / H.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from scipy.linalg import eigh

from unilateral.arrays import Array
from unilateral.fem.spaces import DualOperator
from unilateral.norms.dual import Bracket

BETA_SQUARED_ROUNDING = 1e-12
"""A beta^2 of at most this is rounding, and counts as 0."""


class InfSup(NamedTuple):
    """Bounds on beta, and the constant beta_0 of the second inequality of (3.4)."""

    beta_lower: float
    beta_upper: float
    beta_0: float


def infsup_constants(operator: DualOperator, gram: Bracket) -> InfSup:
    """The constants of a mesh and a partition, from the Gram matrices (m, m) of P0(T_H)."""
    # beta^2 = min D / G: the larger G gives the lower bound. beta is at most 1, as V_h is a subspace of V
    lower = _least_root(operator.D, gram.upper)
    upper = _least_root(operator.D, gram.lower)
    beta_0 = math.sqrt(max(operator.lambda_min, 0.0) / float(operator.H_i.max()))
    return InfSup(lower, min(upper, 1.0), beta_0)


def _least_root(D: Array, G: Array) -> float:
    """The root of the least eigenvalue of D x = mu G x; 0 if that is rounding."""
    square = float(eigh(D, G, eigvals_only=True, subset_by_index=[0, 0])[0])
    return math.sqrt(square) if square > BETA_SQUARED_ROUNDING else 0.0
