"""What sections 1, 3 and 5 of the paper say of Lagrangians and of Uzawa's algorithm, tried on one mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.active_set import active_set
from unilateral.case import Case
from unilateral.condense import Condensed, DualOperator, condense
from unilateral.mesh import Mesh
from unilateral.norms import on_cells, on_mesh
from unilateral.partition import Partition
from unilateral.solve import Pair, pair
from unilateral.uzawa import energy_bound, residual_bound

Array = NDArray[np.float64]
VARIANTS = ("as meant", "as printed", "without the clip")
"""(5.1)-(5.3) with u^n from lambda^n; with u^n from lambda^(n-1), as the index reads; without max(0, .)."""
DIRECTIONS, NEAR = 200, 1e-6
"""Near u_h a slope of L in v, if there were one, outweighs its curvature."""
BOUNDED = 1e6
"""Distances beyond it count as that."""


def algorithm(
    mesh: Mesh, partition: Partition, cases: Sequence[Case], shares: Sequence[float], steps: int
) -> xr.Dataset:
    """Distances from lambda_H after so many steps from 0, by step rho (a share of 2/lambda_max(S)).

    In L2, relative to lambda_H; over (case, variant, share). Besides, of every case: how far (u_h, lambda_H)
    is from being a saddle point, and the factor between the stationary multipliers of (3.3) and of section 5.
    """
    condensed = condense(mesh)
    both = pair(condensed, partition)
    rng = np.random.default_rng(0)
    distance = np.empty((len(cases), len(VARIANTS), len(shares)))
    primal, dual, factor = (np.empty(len(cases)) for _ in range(3))
    for c, case in enumerate(cases):
        problem, cells = on_mesh(case, condensed), on_cells(case, partition)
        offset = both.B @ problem.trace / partition.lengths - cells.g_means
        lambda_H = active_set(both.operator, offset, np.inf).lambda_H
        for v, variant in enumerate(VARIANTS):
            for k, share in enumerate(shares):
                rho = share * 2 / both.operator.lambda_max
                found = _iterate(both.operator, offset, rho, steps, variant)
                distance[c, v, k] = min(_relative(found, lambda_H, partition), BOUNDED)
        primal[c], dual[c] = _saddle(condensed, both, problem.load, cells.g_means, lambda_H, rng)
        halved = DualOperator(both.operator.half / np.sqrt(2), partition.lengths, mesh.polygon.area)
        doubled = active_set(halved, offset, np.inf).lambda_H
        factor[c] = np.sqrt(partition.lengths @ doubled**2 / (partition.lengths @ lambda_H**2))
    return xr.Dataset(
        {
            "distance": (("case", "variant", "rho_share"), distance),
            "saddle_in_v": ("case", primal),
            "saddle_in_mu": ("case", dual),
            "multiplier_factor": ("case", factor),
        },
        coords={"case": [case.name for case in cases], "variant": list(VARIANTS), "rho_share": list(shares)},
    ).assign(steps=((), steps))


def _iterate(operator: DualOperator, offset: Array, rho: float, steps: int, variant: str) -> Array:
    """lambda^steps, from lambda^0 = 0 and, where it takes part, lambda^(-1) = 0."""
    now = before = np.zeros(len(offset))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            of = before if variant == "as printed" else now
            new = now - rho * operator.gap(of, offset)
            now, before = (new if variant == "without the clip" else np.maximum(0, new)), now
    return now


def _relative(found: Array, lambda_H: Array, partition: Partition) -> float:
    difference = np.where(np.isfinite(found), np.clip(found - lambda_H, -1e100, 1e100), 1e100)
    return float(np.sqrt(partition.lengths @ difference**2 / (partition.lengths @ lambda_H**2)))


def _saddle(
    condensed: Condensed, both: Pair, load: Array, g_means: Array, lambda_H: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """The smallest L(v, lambda_H) - L(u_h, lambda_H) and L(u_h, lambda_H) - L(u_h, mu) of random v and mu.

    L(v, mu) = ||v||_1^2 / 2 - (f, v) - <mu, v - g>; relative to |L(u_h, lambda_H)|.
    """
    H_i, boundary = both.partition.lengths, condensed.mesh.boundary
    total = load.copy()
    total[boundary] += both.B.T @ lambda_H
    u_h = condensed.solve(total)

    def L(v: Array, mu: Array) -> float:
        return float(0.5 * v @ (condensed.A @ v) - load @ v - mu @ (both.B @ v[boundary] - H_i * g_means))

    at, size = L(u_h, lambda_H), np.abs(u_h).max()
    in_v = [L(u_h + NEAR * size * rng.standard_normal(len(u_h)), lambda_H) - at for _ in range(DIRECTIONS)]
    in_mu = [at - L(u_h, lambda_H.max() * rng.random(len(lambda_H))) for _ in range(DIRECTIONS)]
    return min(in_v) / abs(at), min(in_mu) / abs(at)


def certificates(
    mesh: Mesh, partition: Partition, cases: Sequence[Case], recorded: Sequence[int]
) -> xr.Dataset:
    """Both bounds of the algebraic error over that error, and the error itself, after steps `recorded`.

    Over (case, step), rho = 0.9/lambda_max(S); the error is ||u(mu) - u_h||_1, relative in `u_distance`.
    """
    condensed = condense(mesh)
    both = pair(condensed, partition)
    rho = 0.9 / both.operator.lambda_max
    shape = (len(cases), len(recorded))
    distance, residual, energy = (np.empty(shape) for _ in range(3))
    for c, case in enumerate(cases):
        problem, cells = on_mesh(case, condensed), on_cells(case, partition)
        offset = both.B @ problem.trace / partition.lengths - cells.g_means
        lambda_H = active_set(both.operator, offset, np.inf).lambda_H
        for k, steps in enumerate(recorded):
            mu = _iterate(both.operator, offset, rho, steps, VARIANTS[0])
            error = float(np.linalg.norm(both.operator.half @ (mu - lambda_H)))
            distance[c, k] = error / np.linalg.norm(both.operator.half @ lambda_H)
            residual[c, k] = residual_bound(both.operator, offset, mu, rho) / error
            energy[c, k] = energy_bound(both.operator, offset, mu) / error
    table = {"u_distance": distance, "residual_index": residual, "energy_index": energy}
    coordinates = {"case": [case.name for case in cases], "step": list(recorded)}
    return xr.Dataset(
        {name: (("case", "step"), values) for name, values in table.items()}, coords=coordinates
    )


def uniqueness(mesh: Mesh, partition: Partition) -> xr.Dataset:
    """A problem with two multipliers at H = h: lambda_H = 1 and 1 + kernel / 2, the kernel (-1)^e/|e|.

    g is chosen so that there is contact everywhere. `violation` is the largest |mean(u_h - g)| of the second;
    `same_u` how far its u_h is from that of the first, in ||.||_1 relative to it.
    """
    both = pair(condense(mesh), partition)
    one = np.ones(partition.n_cells)
    kernel = (-1.0) ** np.arange(partition.n_cells) / partition.lengths
    other = one + 0.5 * kernel / np.abs(kernel).max()
    gap = both.operator.gap(other, -both.operator.gap(one, np.zeros(partition.n_cells)))
    norm = np.linalg.norm(both.operator.half @ one)
    return xr.Dataset(
        {
            "violation": ((), float(np.abs(gap).max())),
            "same_u": ((), float(np.linalg.norm(both.operator.half @ (other - one)) / norm)),
            "multiplier_distance": ((), float(np.sqrt(partition.lengths @ (other - one) ** 2))),
        }
    )


def elimination(meshes: Sequence[Mesh], partitions: Sequence[Partition], steps: int) -> xr.Dataset:
    """Multiplications and additions of one step (5.1)-(5.3): with A factorised, with A_3, and with S.

    And how far u^n on the boundary is after some steps by the first way from that by the second, on the
    coarsest mesh, relative to it.
    """
    counts = np.empty((3, len(meshes)))
    for k, (mesh, partition) in enumerate(zip(meshes, partitions, strict=True)):
        condensed = condense(mesh)
        both = pair(condensed, partition)
        coupling = 4 * both.B.nnz
        factors = condensed.lu.L.nnz + condensed.lu.U.nnz
        counts[:, k] = (
            2 * factors + coupling,
            2 * len(mesh.boundary) ** 2 + coupling,
            2 * partition.n_cells**2,
        )
        if k == 0:
            difference = _by_both_ways(condensed, both, steps)
    sizes = {"h": [mesh.h for mesh in meshes], "unknowns": [mesh.n_nodes for mesh in meshes]}
    table = {name: ("mesh", row) for name, row in zip(("with_A", "with_A_3", "with_S"), counts, strict=True)}
    coordinates = {name: ("mesh", values) for name, values in sizes.items()}
    return xr.Dataset({**table, "difference": ((), difference)}, coords=coordinates)


def _by_both_ways(condensed: Condensed, both: Pair, steps: int) -> float:
    """With f = 0 and g = 1, which is in contact everywhere."""
    H_i, boundary = both.partition.lengths, condensed.mesh.boundary
    rho = 1 / both.operator.lambda_max
    full, small = np.zeros(len(H_i)), np.zeros(len(H_i))
    for _ in range(steps):
        load = np.zeros(condensed.mesh.n_nodes)
        load[boundary] = both.B.T @ full
        u, v = condensed.solve(load)[boundary], condensed.solve_boundary(both.B.T @ small)
        full, small = (np.maximum(0, mu - rho * (both.B @ w / H_i - 1)) for mu, w in ((full, u), (small, v)))
    return float(np.abs(u - v).max() / np.abs(v).max())
