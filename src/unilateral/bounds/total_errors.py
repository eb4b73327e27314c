"""The theorem: total errors from the residuals of u_h and of a feasible v (supplement, F.1).

Let q.n = sigma >= 0 on sides with contact, and let u_h + y be >= g there and u_D on clamped sides. R is the
residual of u_h with q.n (`residual_norm`), |||.||| is the energy norm, D = |||y|||, B = <sigma, u_h + y - g>,
X = |||u - u_h|||, and V has the functions that vanish on clamped sides.

(i) Let S_1 bound R on H^1, and let Y be the norm on H^1 of

    j(w) = k (grad u, grad w) + c (u, w) - (f, w) - <q.n, w>,

which is <lambda - sigma, w> for w in V. Then X^2 + (Y - D)^2 <= S_1^2 + 2 B + D^2.

(ii) Let S bound R on V, and let Y be the norm of lambda - sigma on V. Then X^2 + (Z - D)^2 <= S^2 + 2 B + D^2
with Z^2 - Y^2 at least 0 and at most D_D^2, D_D the energy norm of the part of y at clamped sides.

So in both cases X^2 <= S^2 + 2 B + D^2 and Y <= D + (S^2 + 2 B + D^2)^{1/2}. A feasible v has y = 0: with its
S and B, Y^2 is at most eta^2 = S^2 + 2 B. Where eta is known to be small,

    X^2 <= S^2 + 2 B + D^2 - max(D - eta, 0)^2,     eta in (ii) with D_D^2 added to its square.

(iii) Reactions are bounded for all c in the norm N of `ReactionData.depth`, N(w)^2 = k |w|_1^2 + K ||w||_0^2,
which is at least |||w|||. Let m = k^{-1/2} ||q - k grad u_h||, and R_1 what (q - k grad u_h, grad z) leaves
of R, with at most the norm e on V, and e_N on H^1 in N. Then |j(w)| <= E N(w) for w in H^1 with

    E = D + (m^2 + 2 B + (D + e)^2)^{1/2} + e_N,

where those of v serve as well, with D = 0. By (i) E = Y serves, too.

v may have a part of which the energy norm alone is known. In S and m that is added to the norm of the others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, ResidualParts


class ResidualBounds(NamedTuple):
    """Bounds on the residual of a function v, on what they miss, and B = <sigma, v - g>.

    `S_1` bounds it on H^1 and `S` on V; `misfit_norm`, `e` and `e_N` are m, e and e_N of (iii), infinite
    without Friedrichs' constant. `missing_norm` is that of a part of v of which the energy norm alone is
    known, and of a functional of which the dual norm is.
    """

    S_1: float
    S: float
    misfit_norm: float
    e: float
    e_N: float
    missing_norm: float
    B: float


def bound_residual(
    residual: ResidualParts, missing_norm: float, B: float, squares: Array | None = None
) -> ResidualBounds:
    """The bounds from the parts of the residual, whose `squares` (m,) may be known.

    `missing_norm` and B are only passed on.
    """
    form = residual.form
    S_1, S = residual.dual_norms(squares)
    m = e = e_N = math.inf
    if math.isfinite(form.friedrichs):
        # e and e_N: the bounds on what is left of the residual without the misfit
        zeros = np.zeros_like(residual.misfit)
        remainder = residual._replace(misfit=zeros, s_prime=np.broadcast_to(math.inf, zeros.shape))
        m = float(np.linalg.norm(residual.misfit)) / math.sqrt(form.k)
        _, e = remainder.dual_norms()
        # N is the energy norm with K = max(c, k / C^2) for c
        N_form = form._replace(c=max(form.c, form.k / form.friedrichs**2))
        e_N, _ = remainder._replace(form=N_form).dual_norms()
    return ResidualBounds(S_1=S_1, S=S, misfit_norm=m, e=e, e_N=e_N, missing_norm=missing_norm, B=B)


class TotalErrors(NamedTuple):
    """Bounds on X, on the norm on V of lambda - lambda_H, and E of (iii) for lambda_H; `eta` is that of (ii).

    `gamma_force_bound` is at least gamma <lambda, w> of `clamped_ends`.
    """

    u: float
    lambda_: float
    reaction_bound: float
    eta: float
    gamma_force_bound: float


def bound_total_errors(
    exact_mesh_factor: float,
    u_residual: ResidualBounds,
    v_residual: ResidualBounds,
    D: float,
    D_clamped: float,
    sigma_distance: float,
) -> TotalErrors:
    """The bounds from the residuals of u_h and of a feasible v, D, D_D, and the norm of lambda_H - sigma.

    The exact mesh makes them larger by the `exact_mesh_factor`.
    """
    growth = exact_mesh_factor * (1 + SQUARES_ROUNDING)

    # (i): X^2 <= S_1^2 + 2 B + D^2, Y <= D + X, and for the feasible v Y <= eta; infinite for c = 0
    X_1 = math.hypot(_eta(u_residual, u_residual.S_1), D)
    eta_1 = _eta(v_residual, v_residual.S_1)
    Y_1 = min(D + X_1, eta_1)

    # (ii): the same on V, where eta gets D_D before it is compared with D
    X = math.hypot(_eta(u_residual, u_residual.S), D)
    eta = _eta(v_residual, v_residual.S)
    eta_with_D = math.hypot(eta, D_clamped)
    Y = min(D + X, eta, Y_1)
    S_v = v_residual.S + v_residual.missing_norm
    u_bounds = (
        _u_bound(u_residual, u_residual.S_1, D, eta_1),
        _u_bound(u_residual, u_residual.S, D, eta_with_D),
    )

    # (iii): E of u_h, E of v with D = 0, or Y of (i)
    E = min(Y_1, _reaction_bound(u_residual, D), _reaction_bound(v_residual, 0.0))
    return TotalErrors(
        u=growth * min(u_bounds),
        lambda_=growth * (Y + sigma_distance),
        reaction_bound=growth * (E + sigma_distance),
        eta=growth * eta,
        # gamma <lambda, w> <= <sigma, v - g> + S^2 / 4 (Proposition S16); both grow like squares
        gamma_force_bound=growth * growth * (v_residual.B + S_v * S_v / 4),
    )


def _eta(residual_bounds: ResidualBounds, S: float) -> float:
    """eta = (S^2 + 2 B)^{1/2}, with what the bound S misses added to it."""
    return math.hypot(S + residual_bounds.missing_norm, math.sqrt(2 * residual_bounds.B))


def _reaction_bound(residual_bounds: ResidualBounds, D: float) -> float:
    """E = D + (m^2 + 2 B + (D + e)^2)^{1/2} + e_N, of (iii)."""
    root = math.hypot(_eta(residual_bounds, residual_bounds.misfit_norm), D + residual_bounds.e)
    return D + root + residual_bounds.e_N


def _u_bound(residual_bounds: ResidualBounds, S: float, D: float, eta: float) -> float:
    """The bound (S^2 + 2 B + D^2 - max(D - eta, 0)^2)^{1/2} on X, from S, D and a bound on eta."""
    if eta >= D:
        return math.hypot(_eta(residual_bounds, S), D)
    # D^2 - (D - eta)^2
    return math.hypot(_eta(residual_bounds, S), math.sqrt(eta) * math.sqrt(2 * D - eta))
