"""Nested iteration for the problem with u >= g at the nodes, as drivers of other packages share it.

A driver brings the matrices of nested meshes and a preconditioner for each of them. From the coarsest mesh to
the finest: u and the contact nodes of the mesh before are interpolated, and are the start of the primal-dual
active set, M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865-888. Each set takes a few steps
of preconditioned conjugate gradients only, before the next set is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

Operator = Callable[[np.ndarray], np.ndarray]
"""Multiplies a vector (n,) by a matrix or a preconditioner."""
MAX_SETS = 50
MAX_STEPS = 200
SET_FACTOR = 0.1
"""The factor by which the residual falls before the set is looked at again."""
COARSE_FACTOR = 1e-2
"""The factor by which the residual falls on all meshes but the finest."""


class Level(NamedTuple):
    """A mesh: triangles (t, 3), nodes (b,) and arc lengths (b + 1,) along the boundary.

    `ends` (m, 2) are the nodes between which its last m nodes lie, `obstacle` (n,) is g at boundary nodes,
    and minus infinity at others. `load` is (n,).
    """

    triangles: np.ndarray
    boundary: np.ndarray
    s: np.ndarray
    ends: np.ndarray
    load: np.ndarray
    obstacle: np.ndarray


def read_levels(data: Mapping[str, Any]) -> list[Level]:
    """The meshes in a problem's data with their loads and obstacles, the coarsest first."""
    last = int(data["n_levels"]) - 1
    load = data["load"]
    obstacle = np.full(len(load), -np.inf)
    obstacle[data[f"boundary_{last}"]] = data["obstacle"]
    levels = []
    for k in range(last, -1, -1):
        ends = data[f"ends_{k - 1}"] if k else np.empty((0, 2), np.int32)
        levels.append(
            Level(data[f"triangles_{k}"], data[f"boundary_{k}"], data[f"s_{k}"], ends, load, obstacle)
        )
        n_coarse = len(load) - len(ends)
        # phi_i of a coarse node is the sum of finer hats, with the factor 1/2 in the middles of its edges
        load = load[:n_coarse] + np.bincount(ends.ravel(), np.repeat(0.5 * load[n_coarse:], 2), n_coarse)
        obstacle = obstacle[:n_coarse]
    return levels[::-1]


def interpolation(level: Level) -> sp.csr_matrix:
    """P (n, n_coarse): a node that is not new has one entry 1, a new one two entries 1/2."""
    n_new = len(level.ends)
    n_coarse = len(level.load) - n_new
    columns = np.append(np.arange(n_coarse, dtype=np.int32), np.sort(level.ends).ravel())
    values = np.append(np.ones(n_coarse), np.full(2 * n_new, 0.5))
    starts = np.append(np.arange(n_coarse), n_coarse + 2 * np.arange(n_new + 1))
    return sp.csr_matrix((values, columns, starts.astype(np.int32)), (len(level.load), n_coarse))


def renumber(levels: Sequence[Level], nodes: Sequence[np.ndarray]) -> list[Level]:
    """The levels' loads and obstacles where the i-th unknown of level k is that of node `nodes[k][i]`."""
    return [
        level._replace(load=level.load[order], obstacle=level.obstacle[order])
        for level, order in zip(levels, nodes, strict=True)
    ]


def solve_by_nested_iteration(
    levels: Sequence[Level],
    interpolations: Sequence[sp.csr_matrix],
    multiply: Sequence[Operator],
    make_preconditioner: Callable[[int, np.ndarray], Operator],
    tolerance: float,
) -> tuple[np.ndarray, dict[str, int]]:
    """u (n,) on the finest mesh, and how many `iterations` and `sets` that mesh took.

    `interpolations` lead to each level but the first. `make_preconditioner` is called once a level, with its
    number and the free nodes (n,) of the first set. Later sets have other free nodes, so it has to be
    positive definite on all nodes. `tolerance` bounds (r . M r)^(1/2) at the end, an estimate of the error in
    the energy norm. Raises RuntimeError if that takes too many sets.
    """
    contact = np.isfinite(levels[0].obstacle)
    u = np.where(contact, levels[0].obstacle, 0.0)
    for k, level in enumerate(levels):
        if k:
            P = interpolations[k - 1]
            u = P @ u
            # The middle of an edge on the boundary is a contact node if both ends are
            contact = (P @ contact.astype(float) == 1) & np.isfinite(level.obstacle)
        goal = tolerance if k + 1 == len(levels) else None
        u, contact, counts = _solve_level(level, multiply[k], make_preconditioner, k, u, contact, goal)
    return u, counts


def _solve_level(
    level: Level,
    multiply: Operator,
    make_preconditioner: Callable[[int, np.ndarray], Operator],
    k: int,
    u: np.ndarray,
    contact: np.ndarray,
    goal: float | None,
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    precondition = make_preconditioner(k, ~contact)
    is_boundary = np.isfinite(level.obstacle)
    steps = 0
    for sets in range(1, MAX_SETS + 1):
        u[contact] = level.obstacle[contact]
        free = ~contact
        first, norm, used = solve_by_conjugate_gradients(
            multiply, level.load, u, free, precondition, SET_FACTOR, goal or 0.0
        )
        steps += used
        if goal is None:
            goal = COARSE_FACTOR * first
        # Next: contact nodes with a positive reaction A u - b, and boundary nodes with u < g
        reaction = multiply(u) - level.load
        following = np.where(contact, reaction > 0, is_boundary & (u < level.obstacle))
        if norm <= goal and np.array_equal(following, contact):
            return u, contact, {"iterations": steps, "sets": sets}
        contact = following
    raise RuntimeError(f"no end after {MAX_SETS} sets on level {k}")


def solve_by_conjugate_gradients(
    multiply: Operator,
    load: np.ndarray,
    u: np.ndarray,
    free: np.ndarray,
    precondition: Operator,
    factor: float,
    goal: float,
) -> tuple[float, float, int]:
    """A u = load in the free nodes, from u, which is changed; norms before and after, and steps.

    The norm is (r . M r)^(1/2). It ends at `goal`, or where it has fallen by `factor`.
    """
    r = np.where(free, load - multiply(u), 0.0)
    z = np.where(free, precondition(r), 0.0)
    square = first_square = float(r @ z)
    p = z.copy()
    steps = 0
    while square > max(goal, factor * first_square**0.5) ** 2 and steps < MAX_STEPS:
        Ap = np.where(free, multiply(p), 0.0)
        alpha = square / (p @ Ap)
        u += alpha * p
        r -= alpha * Ap
        z = np.where(free, precondition(r), 0.0)
        previous_square = square
        square = float(r @ z)
        p *= square / previous_square
        p += z
        steps += 1
    return first_square**0.5, square**0.5, steps
