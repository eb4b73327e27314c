"""The least ell . v + |v|_S over v that lie above a bound in some unknowns, by primal-dual active sets.

If v = c in the active unknowns, it is least for v = q + t p, where

    q = c in the active unknowns,    (S q)_i = 0 in the others,
    p = 0 in the active unknowns,    (S p)_i = -ell_i in the others.

q . S p = 0, so t = |v|_S means t^2 = |q|_S^2 / (1 - |p|_S^2). For |p|_S >= 1 there is no least value, and as
t grows every v_i with p_i < 0 reaches its bound. Active unknowns stay so while ell_i + (S v)_i / t >= 0, and
others become so if v_i < c_i (M. Hintermueller, K. Ito and K. Kunisch, SIAM J. Optim. 13, 2002).

Many such problems with the same S and ell are solved at once. S is inverted once, on the unknowns that most
of them leave free. Then each problem solves a system only for the unknowns in which it differs from most.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Mask

MAX_SET_UPDATES = 10
MIN_T = 1e-300
"""The least t, taken where q is 0: the gradient is divided by t."""
UNBOUNDED_T = 1e8
"""Where nothing bounds t, as |p|_S >= 1, it is this many times 1 or |q|_S, whichever is larger."""


def minimise_linear_plus_norm(
    S: Array, ell: Array, lower_bounds: Array, active: Mask, equalities: Mask
) -> Array:
    """The best v (n, k) with v >= c, column by column of the `lower_bounds` c (n, k), -inf for no bound.

    Every column of c has a finite number. v = c in the unknowns that are `equalities` (n,). S (n, n) is
    positive definite, and ell is (n,). The iteration begins with the `active` sets (n, k), where c is finite.
    Where they do not settle, v is the best one that was met. Without equalities that is never worse than the
    least constant v >= c.
    """
    active = active | equalities[:, None]
    usually_free = 2 * np.count_nonzero(active, axis=1) <= active.shape[1]
    # a start with v >= c: c itself where some unknowns are given, else the least constant
    best = (
        np.where(np.isfinite(lower_bounds), lower_bounds, 0.0)
        if equalities.any()
        else np.ones_like(lower_bounds) * lower_bounds.max(axis=0)
    )
    pivoted = _principal_pivot(S, usually_free)
    unsettled = np.arange(lower_bounds.shape[1])
    values = _objective(S, ell, best)
    for _ in range(MAX_SET_UPDATES):
        # the stationary v of the problems that have not settled, cut to v >= c, is kept where it is better;
        # where |p|_S >= 1 it is one far out (UNBOUNDED_T)
        active_now = active[:, unsettled]
        c = lower_bounds[:, unsettled]
        v, gradient = _stationary_point(pivoted, usually_free, active_now, c, ell)
        feasible = np.maximum(v, c)
        objective = _objective(S, ell, feasible)
        better = objective < values[unsettled]
        best[:, unsettled[better]] = feasible[:, better]
        values[unsettled[better]] = objective[better]
        # active unknowns stay while the gradient is >= 0, others become so where v < c
        active[:, unsettled] = np.where(active_now, (gradient >= 0) | equalities[:, None], v < c)
        unsettled = unsettled[(active[:, unsettled] != active_now).any(axis=0)]
        if not unsettled.size:
            break
    return best


def _stationary_point(
    T: Array, usually_free: Mask, active: Mask, lower_bounds: Array, ell: Array
) -> tuple[Array, Array]:
    """The stationary v = q + t p (n, k) for the `active` sets (n, k), and the gradient ell + S v / |v|_S."""
    (q, S_q), (p, S_p) = _solve_active_sets(T, usually_free, active, lower_bounds, ell)
    # t = |v|_S: t^2 = |q|_S^2 / (1 - |p|_S^2), and |p|_S^2 = -ell . p
    q_norm = np.sqrt(np.maximum(np.sum(q * S_q, axis=0), 0.0))
    denominator = 1 + ell @ p
    bounded = denominator > 0
    t = np.where(
        bounded, q_norm / np.sqrt(np.where(bounded, denominator, 1)), UNBOUNDED_T * np.maximum(q_norm, 1)
    )
    t = np.maximum(t, MIN_T)
    return q + t * p, ell[:, None] + S_q / t + S_p


def _objective(S: Array, ell: Array, v: Array) -> Array:
    """The values of ell . v + |v|_S for each column of v; shape (k,)."""
    return np.asarray(ell @ v + np.sqrt(np.maximum(np.sum(v * (S @ v), axis=0), 0.0)))


def _principal_pivot(S: Array, usually_free: Mask) -> Array:
    """T (n, n), which is S after a pivot in the `usually_free` unknowns.

    For r = S v it takes r in the `usually_free` unknowns and v in the others to v in the `usually_free` and r
    in the others.
    """
    F = np.flatnonzero(usually_free)
    A = np.flatnonzero(~usually_free)
    # v_F = S_FF^{-1} (r_F - S_FA v_A), and r_A = S_AF v_F + S_AA v_A
    inverse = np.linalg.inv(S[np.ix_(F, F)])
    across = inverse @ S[np.ix_(F, A)]
    T = np.empty_like(S)
    T[np.ix_(F, F)] = inverse
    T[np.ix_(F, A)] = -across
    T[np.ix_(A, F)] = across.T
    T[np.ix_(A, A)] = S[np.ix_(A, A)] - S[np.ix_(A, F)] @ across
    return T


def _solve_active_sets(
    T: Array, usually_free: Mask, active: Mask, lower_bounds: Array, ell: Array
) -> list[tuple[Array, Array]]:
    """q and S q (n, k), p and S p (n, k) for the `active` sets (n, k), by T of `_principal_pivot`."""
    n, k = active.shape
    arguments = np.zeros((n, 2, k))
    zero = np.zeros_like(lower_bounds)
    prescribed = np.stack(
        [np.where(active, lower_bounds, zero), np.where(active, zero, -ell[:, None])], axis=1
    )
    # T acts on S v in usually free unknowns, on v in the others. The problem prescribes v in active unknowns
    # and S v in the others: where an unknown is not as usual, the argument is what makes T yield that
    for j in range(k):
        differing = np.flatnonzero(active[:, j] == usually_free)
        arguments[:, :, j] = prescribed[:, :, j]
        arguments[differing, :, j] = 0
        rhs = prescribed[differing, :, j] - T[differing] @ arguments[:, :, j]
        arguments[differing, :, j] = np.linalg.solve(T[np.ix_(differing, differing)], rhs)
    images = (T @ arguments.reshape(n, -1)).reshape(arguments.shape)
    is_free = usually_free[:, None, None]
    v = np.where(is_free, images, arguments)
    S_v = np.where(is_free, arguments, images)
    return [(v[:, i], S_v[:, i]) for i in (0, 1)]
