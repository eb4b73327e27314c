"""The least l . v + |v|_S over v that lie above a bound in some unknowns, by primal-dual active sets.

If v = c in the active unknowns, it is least for v = q + t p, where

    q = c in the active unknowns,    (S q)_i = 0 in the others,
    p = 0 in the active unknowns,    (S p)_i = -l_i in the others.

q . S p = 0, so t = |v|_S means t^2 = |q|_S^2 / (1 - |p|_S^2). For |p|_S >= 1 there is no least value, and as
t grows every v_i with p_i < 0 reaches its bound. Active unknowns stay so while l_i + (S v)_i / t >= 0, and
others become so if v_i < c_i (M. Hintermueller, K. Ito and K. Kunisch, SIAM J. Optim. 13, 2002).

Many such problems with the same S and l are solved at once. S is inverted once, on the unknowns that most of
them leave free. Then each problem solves a system only for the unknowns in which it differs from most.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Mask

MOST_STEPS = 10
NEAR = 1e-300
FAR = 1e8
"""NEAR is the least t, taken where q is 0.

Where nothing bounds t, as |p|_S >= 1, it is FAR times 1 or |q|_S, whichever is larger.
"""


def least(S: Array, l: Array, c: Array, active: Mask, exact: Mask) -> Array:  # noqa: E741
    """The best v (n, k) with v >= c, one for each column of c (n, k), which is -inf where there is no bound.

    v = c in the unknowns that are `exact` (n,). S (n, n) is positive definite, and l is (n,). The iteration
    begins with the `active` sets (n, k), where c is finite. Where they do not settle, v is the best one that
    was met. A constant is never better, if nothing is exact.
    """
    active = active | exact[:, None]
    usual = 2 * np.count_nonzero(active, axis=1) <= active.shape[1]
    begin = np.where(np.isfinite(c), c, 0.0) if exact.any() else np.ones_like(c) * c.max(axis=0)
    T = _pivoted(S, usual)
    best = begin
    left = np.arange(c.shape[1])
    values = _values(S, l, best)
    for _ in range(MOST_STEPS):
        of = active[:, left]
        bound = c[:, left]
        v, push = _stationary(T, usual, of, bound, l)
        cut = np.maximum(v, bound)
        now = _values(S, l, cut)
        better = now < values[left]
        best[:, left[better]] = cut[:, better]
        values[left[better]] = now[better]
        active[:, left] = np.where(of, (push >= 0) | exact[:, None], v < bound)
        left = left[(active[:, left] != of).any(axis=0)]
        if not left.size:
            break
    return best


def _stationary(T: Array, usual: Mask, active: Mask, c: Array, l: Array) -> tuple[Array, Array]:  # noqa: E741
    """The stationary v (n, k) for the `active` sets (n, k), and the gradient l + S v / |v|_S."""
    (q, S_q), (p, S_p) = _parts(T, usual, active, c, l)
    of_q = np.sqrt(np.maximum(np.sum(q * S_q, axis=0), 0.0))
    left = 1 + l @ p
    bounded = left > 0
    t = np.where(bounded, of_q / np.sqrt(np.where(bounded, left, 1)), FAR * np.maximum(of_q, 1))
    t = np.maximum(t, NEAR)
    return q + t * p, l[:, None] + S_q / t + S_p


def _values(S: Array, l: Array, v: Array) -> Array:  # noqa: E741
    """(k,) l . v + |v|_S for the columns of v (n, k)."""
    return np.asarray(l @ v + np.sqrt(np.maximum(np.sum(v * (S @ v), axis=0), 0.0)))


def _pivoted(S: Array, usual: Mask) -> Array:
    """T (n, n), which is S after a pivot in the `usual` unknowns.

    For r = S v it takes r in the `usual` unknowns and v in the others to v in the `usual` and r in the
    others.
    """
    F = np.flatnonzero(usual)
    A = np.flatnonzero(~usual)
    inverse = np.linalg.inv(S[np.ix_(F, F)])
    across = inverse @ S[np.ix_(F, A)]
    T = np.empty_like(S)
    T[np.ix_(F, F)] = inverse
    T[np.ix_(F, A)] = -across
    T[np.ix_(A, F)] = across.T
    T[np.ix_(A, A)] = S[np.ix_(A, A)] - S[np.ix_(A, F)] @ across
    return T


def _parts(T: Array, usual: Mask, active: Mask, c: Array, l: Array) -> list[tuple[Array, Array]]:  # noqa: E741
    """q and S q (n, k), p and S p (n, k) for the `active` sets (n, k)."""
    n, k = active.shape
    known = np.zeros((n, 2, k))
    none = np.zeros_like(c)
    given = np.stack([np.where(active, c, none), np.where(active, none, -l[:, None])], axis=1)
    for j in range(k):
        other = np.flatnonzero(active[:, j] == usual)
        known[:, :, j] = given[:, :, j]
        known[other, :, j] = 0
        rest = given[other, :, j] - T[other] @ known[:, :, j]
        known[other, :, j] = np.linalg.solve(T[np.ix_(other, other)], rest)
    out = (T @ known.reshape(n, -1)).reshape(known.shape)
    here = usual[:, None, None]
    v = np.where(here, out, known)
    S_v = np.where(here, known, out)
    return [(v[:, i], S_v[:, i]) for i in (0, 1)]
