"""scikit-fem and PyAMG: the nodal Signorini problem by proximal Galerkin, from mesh to mesh.

J. S. Dokken, P. E. Farrell, B. Keith, I. P. A. Papadopoulos, T. M. Surowiec, The latent variable proximal
point algorithm for variational problems with inequality constraints, 2025: for u, and psi at the nodes i of
the boundary,

    alpha (A u - b)_i + m_i (psi_i - psi^0_i) = 0,    u_i - g_i = exp(psi_i),

where psi^0 is that of the step before, alpha grows from step to step, and m_i is half the length of both
edges at the node. Newton's systems for u take conjugate gradients with a geometric V-cycle of PyAMG.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from benchmarks.peers.driver import Clock, order, report
from benchmarks.peers.nested import (
    Level,
    read_levels,
    solve_by_conjugate_gradients,
)
from benchmarks.peers.skfem_pyamg import assemble_levels, factorise, make_cycle

FIRST_ALPHA = 1.0
ALPHA_GROWTH = 10.0
MAX_ALPHA = 1e5
"""Beyond that exp(psi) is lost in the rounding of u - g."""
LEAST_LATENT = -30.0
"""exp(psi) is as small as rounding there."""
SYSTEM_FACTOR = 1e-2
"""The factor by which the residual of Newton's systems falls."""
NEWTON_SHARE = 0.1
"""Newton's method ends with a change of that share of the distance that u may have to the solution."""
MAX_STEPS = 50


def lump_boundary(level: Level) -> np.ndarray:
    """m (n,), and 0 at nodes inside."""
    half = 0.5 * np.diff(level.s)
    lengths = np.zeros(len(level.load))
    lengths[level.boundary] = half + np.roll(half, 1)
    return lengths


def add_weights(
    matrices: Sequence[sp.csr_matrix], interpolations: Sequence[sp.csr_matrix], weights: np.ndarray
) -> list[sp.csr_matrix]:
    """A plus the weights (n,) on its diagonal, on the finest of the meshes; the same on coarser ones."""
    weighted = [(matrices[-1] + sp.diags(weights)).tocsr()]
    for A, P in zip(matrices[-2::-1], interpolations[::-1], strict=True):
        weights = P.T @ weights
        weighted.append((A + sp.diags(weights)).tocsr())
    return weighted[::-1]


def solve_proximal_step(
    level: Level,
    matrices: Sequence[sp.csr_matrix],
    interpolations: Sequence[sp.csr_matrix],
    u: np.ndarray,
    start: np.ndarray,
    alpha: float,
    goal: float,
) -> tuple[np.ndarray, np.ndarray, int]:
    """u and psi (n,) after a proximal step from psi^0 = `start` on the finest mesh, and Newton's steps.

    Raises RuntimeError if Newton's method takes too many steps.
    """
    A = matrices[-1]
    lengths = lump_boundary(level)
    is_boundary = lengths > 0
    psi = start
    for steps in range(1, MAX_STEPS + 1):
        # The second equation is d psi = exp(-psi) (d u + u - g) - 1, which eliminates psi from the first one
        weights = lengths * np.exp(-psi) / alpha
        gap = np.where(is_boundary, u - level.obstacle, 0.0)
        load = level.load - A @ u - lengths * (psi - 1 - start) / alpha - weights * gap
        weighted = add_weights(matrices, interpolations, weights)
        change = np.zeros_like(u)
        size, _, _ = solve_by_conjugate_gradients(
            weighted[-1].dot,
            load,
            change,
            np.ones(len(u), bool),
            make_cycle(weighted, interpolations) if interpolations else factorise(weighted[0]),
            SYSTEM_FACTOR,
            0.0,
        )
        u = u + change
        # Where u - g grows, psi grows by the logarithm of the factor, which is less than Newton's d psi
        ratio = np.exp(-psi) * (gap + change)
        growth = np.where(ratio > 1, np.log(np.maximum(ratio, 1.0)), ratio - 1)
        psi = np.where(is_boundary, np.maximum(psi + growth, LEAST_LATENT), 0.0)
        if size <= NEWTON_SHARE * goal:
            return u, psi, steps
    raise RuntimeError(f"no end of Newton's method after {MAX_STEPS} steps")


def solve_level(
    level: Level,
    matrices: Sequence[sp.csr_matrix],
    interpolations: Sequence[sp.csr_matrix],
    u: np.ndarray,
    psi: np.ndarray,
    alpha: float,
    goal: float,
) -> tuple[np.ndarray, np.ndarray, float, dict[str, int]]:
    """u, psi and alpha where a proximal step has changed u by at most `goal` in the energy norm.

    The counts are Newton's steps, `iterations`, and the proximal steps, `sets`. Raises RuntimeError if there
    are too many.
    """
    iterations = 0
    for sets in range(1, MAX_STEPS + 1):
        before = u
        u, psi, steps = solve_proximal_step(level, matrices, interpolations, u, psi, alpha, goal)
        iterations += steps
        alpha = min(ALPHA_GROWTH * alpha, MAX_ALPHA)
        change = u - before
        if change @ (matrices[-1] @ change) <= goal**2:
            return u, psi, alpha, {"iterations": iterations, "sets": sets}
    raise RuntimeError(f"no end after {MAX_STEPS} proximal steps")


def main() -> None:
    """A run."""
    data, parameters, path = order()
    levels = read_levels(data)
    clock = Clock()
    matrices, interpolations = assemble_levels(clock, levels, data["points"])
    alpha = FIRST_ALPHA
    u = np.zeros(len(levels[0].load))
    psi = np.zeros(len(levels[0].load))
    for k, level in enumerate(levels):
        if k:
            P = interpolations[k - 1]
            u = P @ u
            psi = np.where(np.isfinite(level.obstacle), P @ psi, 0.0)
        # The error of the discrete solution doubles from mesh to coarser mesh
        goal = parameters["tolerance"] * float(data["error"]) * 2.0 ** (len(levels) - 1 - k)
        u, psi, alpha, counts = solve_level(level, matrices[: k + 1], interpolations[:k], u, psi, alpha, goal)
    clock.lap("solve")
    result = {"way": parameters["way"], "phases": clock.only(clock.phases), **counts}
    report(clock, path, data["points"], [result], [u])


if __name__ == "__main__":
    main()
