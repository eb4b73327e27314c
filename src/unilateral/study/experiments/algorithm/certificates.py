"""More of Uzawa's algorithm tried: its certificates, problems with two multipliers, and what steps cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from unilateral.fem.condense import condense
from unilateral.fem.nested_dissection import Sparse, dissected
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case import Case
from unilateral.solvers.uzawa import energy_bound, residual_bound
from unilateral.study import operations
from unilateral.study.experiments.algorithm.measure import SolvedCase, known
from unilateral.study.uzawa_variants import VARIANTS, iterate


def certificates(
    mesh: Mesh, partition: Partition, cases: Sequence[Case], recorded: Sequence[int]
) -> xr.Dataset:
    """Both bounds on the algebraic error over that error, and the error itself, after steps `recorded`.

    The table is over (case, step), for rho = 0.9/lambda_max(S). The error is ||u(mu) - u_h||_1, relative in
    `u_distance`. `first_term_index` is for the first of the two terms of `residual_bound`, which is no bound.
    """
    rows = [[_bounds(of, steps) for steps in recorded] for of in known(mesh, partition, cases)]
    table = {name: (("case", "step"), [[each[name] for each in row] for row in rows]) for name in rows[0][0]}
    return xr.Dataset(table, {"case": [case.name for case in cases], "step": list(recorded)})


def _bounds(of: SolvedCase, steps: int) -> dict[str, float]:
    operator, offset = of.spaces.operator, of.discrete.offset
    rho = 0.9 / operator.lambda_max
    mu = iterate(operator, offset, rho, steps, VARIANTS[0])
    error = float(np.linalg.norm(operator.half @ (mu - of.lambda_H)))
    R = np.minimum(mu, rho * operator.gap(mu, offset))
    return {
        "u_distance": error / float(np.linalg.norm(operator.half @ of.lambda_H)),
        "residual_index": residual_bound(operator, offset, mu, rho) / error,
        "first_term_index": float(np.linalg.norm(operator.half @ R)) / error,
        "energy_index": energy_bound(operator, offset, mu) / error,
    }


def split(mesh: Mesh, partition: Partition, cases: Sequence[Case]) -> xr.Dataset:
    """How far ||u-u_h||_1^2 by quadrature is from ||u-z_h||_1^2 + ||lambda-lambda_H||_{-1/2,h}^2, relative.

    The table is over the cases. `..._elsewhere` is the same with H ||lambda-lambda_H||_0^2 as second term.
    """
    defects = []
    for of in known(mesh, partition, cases):
        ritz, lambda_H = of.exact.ritz, of.lambda_H
        left = h1_distance(ritz.case, mesh, of.spaces.response(of.discrete.load, lambda_H)) ** 2
        seconds = (
            ritz.discrete_dual(of.exact.boundary_load(of.spaces, lambda_H)) ** 2,
            partition.H * of.exact.means.l2_error(lambda_H) ** 2,
        )
        defects.append([abs(ritz.ritz_error**2 + second - left) / left for second in seconds])
    table = dict(zip(("split_defect", "split_defect_elsewhere"), np.transpose(defects), strict=True))
    coords = {"case": [case.name for case in cases]}
    return xr.Dataset({name: ("case", column) for name, column in table.items()}, coords)


def uniqueness(mesh: Mesh, partition: Partition) -> xr.Dataset:
    """A problem with two multipliers at H = h: lambda_H = 1 and 1 + kernel / 2, the kernel (-1)^e/|e|.

    g is chosen so that there is contact everywhere. `violation` is the largest |mean(u_h - g)| of the second;
    `same_u` how far its u_h is from that of the first, in ||.||_1 relative to it.
    """
    spaces = mixed_spaces(condense(mesh), partition)
    one = np.ones(partition.n_cells)
    kernel = (-1.0) ** np.arange(partition.n_cells) / partition.lengths
    other = one + 0.5 * kernel / np.abs(kernel).max()
    gap = spaces.operator.gap(other, -spaces.operator.gap(one, np.zeros(partition.n_cells)))
    norm = np.linalg.norm(spaces.operator.half @ one)
    return xr.Dataset(
        {
            "violation": ((), float(np.abs(gap).max())),
            "same_u": ((), float(np.linalg.norm(spaces.operator.half @ (other - one)) / norm)),
            "multiplier_distance": ((), float(np.sqrt(partition.lengths @ (other - one) ** 2))),
        }
    )


def elimination(meshes: Sequence[Mesh], partitions: Sequence[Partition], steps: int) -> xr.Dataset:
    """Operations to find F in one step (5.1)-(5.3), by `operations`: with A factorised, with A_3, and with S.

    `difference` is how far u^n on the boundary is, after some steps, by the first way from that by the second
    one, on the coarsest mesh and relative to it.
    """
    counts = np.empty((3, len(meshes)))
    for k, (mesh, partition) in enumerate(zip(meshes, partitions, strict=True)):
        condensed = condense(mesh)
        spaces, alone = mixed_spaces(condensed, partition), dissected(condensed.A)
        m, nb, nnz = partition.n_cells, len(mesh.boundary), spaces.B.nnz
        counts[:, k] = (
            operations.apply_A(m, nb, nnz, operations.factors(alone.lu)),
            operations.apply_A_3(m, nb, nnz),
            operations.apply_S(m),
        )
        if k == 0:
            difference = _by_both_ways(alone, spaces, steps)
    sizes = {"h": [mesh.h for mesh in meshes], "unknowns": [mesh.n_nodes for mesh in meshes]}
    table = {name: ("mesh", row) for name, row in zip(("with_A", "with_A_3", "with_S"), counts, strict=True)}
    coordinates = {name: ("mesh", values) for name, values in sizes.items()}
    return xr.Dataset({**table, "difference": ((), difference)}, coords=coordinates)


def _by_both_ways(alone: Sparse, spaces: MixedSpaces, steps: int) -> float:
    """The difference of u^n by both ways, with f = 0 and g = 1, where there is contact everywhere."""
    H_i, condensed = spaces.partition.lengths, spaces.condensed
    boundary = condensed.mesh.boundary
    rho = 1 / spaces.operator.lambda_max
    full, small = np.zeros(len(H_i)), np.zeros(len(H_i))
    for _ in range(steps):
        load = np.zeros(condensed.mesh.n_nodes)
        load[boundary] = spaces.B.T @ full
        u, v = alone.solve(load)[boundary], condensed.solve_boundary(spaces.B.T @ small)
        full, small = (
            np.maximum(0, mu - rho * (spaces.B @ w / H_i - 1)) for mu, w in ((full, u), (small, v))
        )
    return float(np.abs(u - v).max() / np.abs(v).max())
