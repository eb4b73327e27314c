"""What sections 1, 3 and 5 of the paper say of Lagrangians and of Uzawa's algorithm, tried.

Also its certificates, problems with two multipliers, and what steps cost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from study import operations
from study.uzawa_variants import AS_MEANT, VARIANTS, iterate_variant
from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, discretise_case
from unilateral.fem.condense import condense
from unilateral.fem.linear_systems import SparseFactors, factorise_by_dissection
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.norms.ritz import h1_distance, ritz_projection
from unilateral.problems.case import ExactSolution
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.uzawa import energy_bound, residual_bound

N_DIRECTIONS = 200
DIRECTION_SIZE = 1e-6
"""How many random directions are tried, and how near to u_h: there a slope of L in v, if there were one,
outweighs its curvature."""
MAX_DISTANCE = 1e6
"""Distances above this number count as this number."""


class SolvedCase(NamedTuple):
    """A case's discrete problem with lambda_H (m,) from the active set."""

    discrete: CondensedProblem
    exact: CaseProjections
    lambda_H: Array

    @property
    def spaces(self) -> MixedSpaces:
        """The spaces of the discrete problem."""
        return self.discrete.spaces


def solve_cases(mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution]) -> Iterator[SolvedCase]:
    """The cases on one mesh and one partition."""
    spaces = mixed_spaces(condense(mesh), partition)
    for case in cases:
        exact = CaseProjections(ritz_projection(case, spaces.condensed), cell_means(case, partition))
        discrete = discretise_case(spaces, exact)
        yield SolvedCase(
            discrete, exact, solve_by_active_set(spaces.operator, discrete.offset, np.inf).lambda_H
        )


def measure_algorithm(
    mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution], shares: Sequence[float], steps: int
) -> xr.Dataset:
    """Distances from lambda_H after so many steps from 0, by step rho (a share of 2/lambda_max(S)).

    They are in L2, relative to lambda_H, over (case, variant, rho_share). Further numbers of each case are
    how far (u_h, lambda_H) is from being a saddle point, the factor between the stationary multipliers of
    (3.3) and of section 5, and the part of u_h - g that is not constant on the cells. `..._elsewhere` is the
    same with lambda_H + 1, and for the Lagrangian of section 5.
    """
    rng = np.random.default_rng(0)
    distances = []
    rows = []
    for solved in solve_cases(mesh, partition, cases):
        distances.append(
            [
                [_distance_after_steps(solved, share, steps, variant) for share in shares]
                for variant in VARIANTS
            ]
        )
        rows.append(
            _measure_saddle(solved, solved.lambda_H, rng, "")
            | _measure_saddle(solved, solved.lambda_H + 1, rng, "_elsewhere")
            | {
                "multiplier_factor": _multiplier_factor(solved, 0.5),
                "multiplier_factor_elsewhere": _multiplier_factor(solved, 1.0),
                "off_cells": _cellwise_variation(solved),
            }
        )
    table: dict[str, Any] = {"distance": (("case", "variant", "rho_share"), np.array(distances))}
    table |= {name: ("case", [row[name] for row in rows]) for name in rows[0]}
    coords = {"case": [case.name for case in cases], "variant": list(VARIANTS), "rho_share": list(shares)}
    return xr.Dataset(table, coords).assign(steps=((), steps))


def _distance_after_steps(solved_case: SolvedCase, share: float, steps: int, variant: str) -> float:
    operator = solved_case.spaces.operator
    H_i = solved_case.spaces.partition.lengths
    last = iterate_variant(
        operator, solved_case.discrete.offset, share * 2 / operator.lambda_max, steps, variant
    )
    difference = np.where(np.isfinite(last), np.clip(last - solved_case.lambda_H, -1e100, 1e100), 1e100)
    return min(float(np.sqrt(H_i @ difference**2 / (H_i @ solved_case.lambda_H**2))), MAX_DISTANCE)


def _multiplier_factor(solved_case: SolvedCase, share: float) -> float:
    """The norm in L2 of the stationary multiplier with that share of D, over that of lambda_H."""
    spaces = solved_case.spaces
    H_i = solved_case.spaces.partition.lengths
    # The stationary multiplier minimises share mu.D mu / 2 + offset.(H_i mu) over mu >= 0
    scaled = replace(spaces.operator, D_factor=spaces.operator.D_factor * np.sqrt(share))
    stationary = solve_by_active_set(scaled, solved_case.discrete.offset, np.inf).lambda_H
    return float(np.sqrt(H_i @ stationary**2 / (H_i @ solved_case.lambda_H**2)))


def _measure_saddle(
    solved_case: SolvedCase, multiplier: Array, rng: np.random.Generator, suffix: str
) -> dict[str, float]:
    """The smallest L(v, lambda_H) - L(u_h, lambda_H), L(u_h, lambda_H) - L(u_h, mu) and excess of (4.4).

    They are relative to |L(u_h, lambda_H)|, for random v and mu >= 0, where u_h belongs to the multiplier
    lambda_H, and L(v, mu) = ||v||_1^2 / 2 - (f, v) - <mu, v - g>. The excess is
    A(U_h, V - U_h) - F(V - U_h), V = (v, mu).
    """
    spaces = solved_case.spaces
    load = solved_case.discrete.load
    g_integrals = spaces.partition.lengths * solved_case.exact.cell_means.g_means
    boundary = spaces.mesh.boundary
    A = spaces.condensed.A
    u_h = spaces.response(load, multiplier)
    # (u_h, phi_i)_1 - (f, phi_i) - <lambda_H, phi_i>, which is 0 up to rounding
    weak = A @ u_h - load
    weak[boundary] -= spaces.B.T @ multiplier

    def L(v: Array, mu: Array) -> float:
        """The Lagrangian ||v||_1^2 / 2 - (f, v) - <mu, v - g>."""
        return float(0.5 * v @ (A @ v) - load @ v - mu @ (spaces.B @ v[boundary] - g_integrals))

    saddle = L(u_h, multiplier)
    gap = spaces.B @ u_h[boundary] - g_integrals
    differences: dict[str, list[float]] = {"saddle_in_v": [], "saddle_in_mu": [], "inequality": []}
    for _ in range(N_DIRECTIONS):
        w = DIRECTION_SIZE * np.abs(u_h).max() * rng.standard_normal(len(u_h))
        mu = multiplier.max() * rng.random(len(multiplier))
        differences["saddle_in_v"].append(L(u_h + w, multiplier) - saddle)
        differences["saddle_in_mu"].append(saddle - L(u_h, mu))
        # (4.4): A(U_h, V - U_h) - F(V - U_h) = (weak, w) + <mu - lambda_H, u_h - g>
        differences["inequality"].append(float(weak @ w + (mu - multiplier) @ gap))
    return {f"{name}{suffix}": min(values) / abs(saddle) for name, values in differences.items()}


def _cellwise_variation(solved_case: SolvedCase) -> float:
    """The part of u_h - g, in L2, that is not constant on the cells; relative."""
    mesh = solved_case.spaces.mesh
    partition = solved_case.spaces.partition
    case = solved_case.exact.ritz.case
    trace = solved_case.spaces.response(solved_case.discrete.load, solved_case.lambda_H)[mesh.boundary]
    rule = boundary_rule(mesh.polygon, np.union1d(mesh.s, partition.points), case.singular_points())
    u, _, gap = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    s = mesh.polygon.starts[rule.side] + rule.s
    values = np.interp(s, mesh.s, np.append(trace, trace[0])) - (u - gap)
    cell = np.clip(np.searchsorted(partition.points, s, side="right") - 1, 0, partition.n_cells - 1)
    means = np.bincount(cell, rule.weight * values, partition.n_cells) / partition.lengths
    variation = rule.weight @ (values - means[cell]) ** 2
    square = rule.weight @ values**2
    return float(np.sqrt(variation / square))


def measure_certificates(
    mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution], recorded: Sequence[int]
) -> xr.Dataset:
    """Both bounds on the algebraic error over that error, and the error itself, after steps `recorded`.

    The table is over (case, step), for rho = 0.9/lambda_max(S). The error is ||u(mu) - u_h||_1, relative in
    `u_distance`. `first_term_index` is for the first of the two terms of `residual_bound`, which is no bound.
    """
    rows = [
        [_measure_bounds(solved, steps) for steps in recorded]
        for solved in solve_cases(mesh, partition, cases)
    ]
    dims = ("case", "step")
    table = {name: (dims, [[values[name] for values in row] for row in rows]) for name in rows[0][0]}
    return xr.Dataset(table, {"case": [case.name for case in cases], "step": list(recorded)})


def _measure_bounds(solved_case: SolvedCase, steps: int) -> dict[str, float]:
    operator = solved_case.spaces.operator
    offset = solved_case.discrete.offset
    rho = 0.9 / operator.lambda_max
    mu = iterate_variant(operator, offset, rho, steps, AS_MEANT)
    error = float(np.linalg.norm(operator.D_factor @ (mu - solved_case.lambda_H)))
    R = np.minimum(mu, rho * operator.gap(mu, offset))  # mu - max(0, mu - rho (u(mu) - g)): the last step
    return {
        "u_distance": error / float(np.linalg.norm(operator.D_factor @ solved_case.lambda_H)),
        "residual_index": residual_bound(operator, offset, mu, rho) / error,
        "first_term_index": float(np.linalg.norm(operator.D_factor @ R)) / error,
        "energy_index": energy_bound(operator, offset, mu) / error,
    }


def measure_split(mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution]) -> xr.Dataset:
    """How far ||u-u_h||_1^2 by quadrature is from ||u-z_h||_1^2 + ||lambda-lambda_H||_{-1/2,h}^2, relative.

    The table is over the cases. `..._elsewhere` is the same with H ||lambda-lambda_H||_0^2 as second term.
    """
    defects = []
    for solved in solve_cases(mesh, partition, cases):
        ritz = solved.exact.ritz
        lambda_H = solved.lambda_H
        # ||u - u_h||_1^2 against ||u - z_h||_1^2 + the second term, the true and the spoilt one
        square = h1_distance(ritz.case, mesh, solved.spaces.response(solved.discrete.load, lambda_H)) ** 2
        second_terms = (
            ritz.discrete_dual_norm(solved.exact.boundary_load(solved.spaces, lambda_H)) ** 2,
            partition.H * solved.exact.cell_means.l2_error(lambda_H) ** 2,
        )
        defects.append(
            [abs(ritz.ritz_error**2 + second_term - square) / square for second_term in second_terms]
        )
    table = dict(zip(("split_defect", "split_defect_elsewhere"), np.transpose(defects), strict=True))
    coords = {"case": [case.name for case in cases]}
    return xr.Dataset({name: ("case", column) for name, column in table.items()}, coords)


def measure_uniqueness(mesh: Mesh, partition: Partition) -> xr.Dataset:
    """A problem with two multipliers at H = h: lambda_H = 1 and 1 + kernel / 2, the kernel (-1)^e/|e|.

    g is chosen so that there is contact everywhere. `violation` is the largest |mean(u_h - g)| of the second;
    `same_u` how far its u_h is from that of the first, in ||.||_1 relative to it.
    """
    spaces = mixed_spaces(condense(mesh), partition)
    lambda_H = np.ones(partition.n_cells)
    kernel = (-1.0) ** np.arange(partition.n_cells) / partition.lengths  # <kernel, v> = 0 for v in V_h
    mu = lambda_H + 0.5 * kernel / np.abs(kernel).max()
    gap = spaces.operator.gap(mu, -spaces.operator.gap(lambda_H, np.zeros(partition.n_cells)))
    norm = np.linalg.norm(spaces.operator.D_factor @ lambda_H)
    return xr.Dataset(
        {
            "violation": ((), float(np.abs(gap).max())),
            "same_u": ((), float(np.linalg.norm(spaces.operator.D_factor @ (mu - lambda_H)) / norm)),
            "multiplier_distance": ((), float(np.sqrt(partition.lengths @ (mu - lambda_H) ** 2))),
        }
    )


def measure_elimination(meshes: Sequence[Mesh], partitions: Sequence[Partition], steps: int) -> xr.Dataset:
    """Operations to find F in one step (5.1)-(5.3), by `operations`: with A factorised, with A_3, and with S.

    `difference` is how far u^n on the boundary is, after some steps, by the first way from that by the second
    one, on the coarsest mesh and relative to it.
    """
    pairs = [
        mixed_spaces(condense(mesh), partition) for mesh, partition in zip(meshes, partitions, strict=True)
    ]
    factors = [factorise_by_dissection(spaces.condensed.A) for spaces in pairs]
    counts = [
        _count_products(spaces, operations.count_factors(factors_of_A.lu))
        for spaces, factors_of_A in zip(pairs, factors, strict=True)
    ]
    table: dict[str, Any] = {name: ("mesh", [float(count[name]) for count in counts]) for name in counts[0]}
    table["difference"] = ((), _compare_eliminations(factors[0], pairs[0], steps))
    sizes = {"h": [mesh.h for mesh in meshes], "unknowns": [mesh.n_nodes for mesh in meshes]}
    return xr.Dataset(table, coords={name: ("mesh", values) for name, values in sizes.items()})


def _count_products(spaces: MixedSpaces, factors: operations.FactorCounts) -> dict[str, int]:
    """Operations of one product y -> S y: by A and by A_3 as section 5 has them, and by S."""
    m = spaces.partition.n_cells
    nb = len(spaces.mesh.boundary)
    nnz = spaces.B.nnz
    return {
        "with_A": operations.count_product_by_A(m, nb, nnz, factors),
        "with_A_3": operations.count_product_by_A_3(m, nb, nnz),
        "with_S": operations.count_product_by_S(m),
    }


def _compare_eliminations(factors: SparseFactors, spaces: MixedSpaces, steps: int) -> float:
    """The difference of u^n by both ways, with f = 0 and g = 1, where there is contact everywhere."""
    H_i = spaces.partition.lengths
    condensed = spaces.condensed
    boundary = condensed.mesh.boundary
    rho = 1 / spaces.operator.lambda_max
    lambda_A = np.zeros(len(H_i))
    lambda_A_3 = np.zeros(len(H_i))
    # (5.1)-(5.3) with f = 0, g = 1: lambda <- max(0, lambda - rho (means of u - 1)), A u = B^T lambda
    for _ in range(steps):
        load = np.zeros(condensed.mesh.n_nodes)
        load[boundary] = spaces.B.T @ lambda_A
        u = factors.solve(load)[boundary]
        v = condensed.solve_boundary(spaces.B.T @ lambda_A_3)
        lambda_A = np.maximum(0, lambda_A - rho * (spaces.B @ u / H_i - 1))
        lambda_A_3 = np.maximum(0, lambda_A_3 - rho * (spaces.B @ v / H_i - 1))
    return float(np.abs(u - v).max() / np.abs(v).max())
