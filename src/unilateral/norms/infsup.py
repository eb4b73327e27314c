"""The inf-sup constants of Lemma 3.1 for one mesh and one partition, between guaranteed bounds.

The first inequality of (3.4) holds with beta^2 the smallest eigenvalue of D x = beta^2 G x, D the dual
operator and G the Gram matrix of ||.||_{-1/2} on P0(T_H). G is known from both sides as a form, and so is
beta; below 1e-6, where its square is rounding, it counts as 0. The second holds with
beta_0^2 = lambda_min(S) / H.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import eigh

from unilateral.arrays import Array, Index
from unilateral.fem.spaces import DualOperator
from unilateral.norms.dual import Bracket

if TYPE_CHECKING:
    import xarray as xr

ZERO = 1e-12
TIE = 1e-3
"""Symmetry classes count as equally bad if the relative difference of their beta^2 is at most this."""


class InfSup(NamedTuple):
    """Bounds on beta, and the constant beta_0 of the second inequality of (3.4)."""

    beta_lower: float
    beta_upper: float
    beta_0: float


def infsup(operator: DualOperator, gram: Bracket) -> InfSup:
    """The constants of a mesh and a partition, from the Gram matrices (m, m) of P0(T_H).

    beta is at most 1, for V_h is conforming; beta^2 <= 1e-12, which is rounding, counts as 0.
    """
    forms = (gram.upper, gram.lower)
    squares = [float(eigh(operator.D, G, eigvals_only=True, subset_by_index=[0, 0])[0]) for G in forms]
    lower, upper = (math.sqrt(square) if square > ZERO else 0.0 for square in squares)
    beta_0 = math.sqrt(max(operator.lambda_min, 0.0) / float(operator.H_i.max()))
    return InfSup(lower, min(upper, 1.0), beta_0)


def cellwise(operator: DualOperator) -> float:
    """The constant of Theorem 5: sup over V_h of <mu, v>/||v||_1 against (sum_i H_i^2 mu_i^2)^{1/2}.

    On cells of one length it is beta_0, else it is larger.
    """
    weighted = operator.D / operator.H_i[:, None] / operator.H_i
    return math.sqrt(max(float(eigh(weighted, eigvals_only=True, subset_by_index=[0, 0])[0]), 0.0))


def of_runs(errors: xr.Dataset) -> xr.Dataset:
    """What Lemmas 3.1 and 4.3 say about every run of a scene, with its measured errors and constants.

    `norm_ratio` bounds ||e||_{-1/2,h} / ||e||_{-1/2} for e = lambda - lambda_H, which lies in [0, 1] and, if
    e were in P0(T_H), above beta; `lemma_4_3` is the left side of (4.6) over the right one with the constants
    1 + 1/beta and 1/beta, every factor taken on its unfavourable side. NaN where beta or, to round-off, the
    error is 0.
    """
    import xarray as xr

    beta, upper = errors["beta_upper"], errors["hm12_error_upper"]
    known = (beta > 0) & (upper > ZERO * errors["u_norm"])
    right = (1 + 1 / beta) * errors["hm12_best"] + errors["h1_error"] / beta
    found = {
        "norm_ratio_lower": errors["discrete_error"] / upper,
        "norm_ratio_upper": errors["discrete_error"] / errors["hm12_error_lower"],
        "lemma_4_3": upper / right,
    }
    order = ("case", "mesh", "partition")
    table = xr.Dataset({name: values.where(known).transpose(*order) for name, values in found.items()})
    return table.merge(errors[["beta_lower", "beta_upper", "beta_0"]])


def worst_multiplier(D: Array, G: Array, symmetries: Sequence[Index] = ()) -> Array:
    """mu (m,) at which ||mu||_{-1/2,h} / ||mu||_{-1/2} is smallest, its largest value 1.

    `symmetries` are commuting involutions (m,) of the cells that map the domain, its mesh and T_H onto
    themselves. The worst mu is looked for among those that each symmetry keeps or turns into -mu; of classes
    that are equally bad it is the first, beginning with the symmetric.
    """
    m = len(D)
    best, found = 0.0, np.empty(0)
    for signs in product((1.0, -1.0), repeat=len(symmetries)):
        projector = np.eye(m)
        for sign, image in zip(signs, symmetries, strict=True):
            projector = 0.5 * (projector + sign * projector[image])
        values, vectors = np.linalg.eigh(projector)
        basis = vectors[:, values > 0.5]
        if not basis.shape[1]:
            continue
        value, x = eigh(basis.T @ D @ basis, basis.T @ G @ basis, subset_by_index=[0, 0])
        if not found.size or value[0] < best - TIE * abs(best):
            best, found = float(value[0]), basis @ x[:, 0]
    size = np.abs(found)
    return found / found[np.flatnonzero(size >= (1 - TIE) * size.max())[0]]
