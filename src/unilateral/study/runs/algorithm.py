"""What sections 1, 3 and 5 of the paper say of Lagrangians and of Uzawa's algorithm, tried on one mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.discrete import with_load
from unilateral.fem.condense import condense
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import DualOperator, MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact import cell_means
from unilateral.norms.ritz import RitzProjection, ritz_projection
from unilateral.problems.case import Case
from unilateral.solvers.active_set import active_set

Array = NDArray[np.float64]
VARIANTS = ("as meant", "as printed", "without the clip")
"""(5.1)-(5.3) with u^n from lambda^n; with u^n from lambda^(n-1), as the index reads; without max(0, .)."""
DIRECTIONS, NEAR = 200, 1e-6
"""Near u_h a slope of L in v, if there were one, outweighs its curvature."""
OF_CASE = (
    "saddle_in_v",
    "saddle_in_mu",
    "inequality",
    "saddle_in_v_elsewhere",
    "saddle_in_mu_elsewhere",
    "inequality_elsewhere",
    "multiplier_factor",
    "multiplier_factor_elsewhere",
    "off_cells",
)
BOUNDED = 1e6
"""Distances beyond it count as that."""


def algorithm(
    mesh: Mesh, partition: Partition, cases: Sequence[Case], shares: Sequence[float], steps: int
) -> xr.Dataset:
    """Distances from lambda_H after so many steps from 0, by step rho (a share of 2/lambda_max(S)).

    In L2, relative to lambda_H; over (case, variant, rho_share). Besides, of every case: how far
    (u_h, lambda_H) is from being a saddle point, the factor between the stationary multipliers of (3.3) and
    of section 5, and what of u_h - g is not constant on the cells. `..._elsewhere`: the same with
    lambda_H + 1, and for the Lagrangian of section 5.
    """
    condensed = condense(mesh)
    spaces = mixed_spaces(condensed, partition)
    rng = np.random.default_rng(0)
    distance = np.empty((len(cases), len(VARIANTS), len(shares)))
    of_case = {name: np.empty(len(cases)) for name in OF_CASE}
    for c, case in enumerate(cases):
        problem, cells = ritz_projection(case, condensed), cell_means(case, partition)
        offset = with_load(spaces, problem.load, problem.trace, cells.g_means).offset
        lambda_H = active_set(spaces.operator, offset, np.inf).lambda_H
        for v, variant in enumerate(VARIANTS):
            for k, share in enumerate(shares):
                rho = share * 2 / spaces.operator.lambda_max
                found = iterate(spaces.operator, offset, rho, steps, variant)
                distance[c, v, k] = min(_relative(found, lambda_H, partition), BOUNDED)
        for suffix, mu in (("", lambda_H), ("_elsewhere", lambda_H + 1)):
            saddle = _saddle(spaces, problem.load, cells.g_means, mu, rng)
            for name, value in zip(("saddle_in_v", "saddle_in_mu", "inequality"), saddle, strict=True):
                of_case[name + suffix][c] = value
        for name, share in (("multiplier_factor", 0.5), ("multiplier_factor_elsewhere", 1.0)):
            scaled = DualOperator(spaces.operator.half * np.sqrt(share), partition.lengths, mesh.polygon.area)
            other = active_set(scaled, offset, np.inf).lambda_H
            of_case[name][c] = np.sqrt(partition.lengths @ other**2 / (partition.lengths @ lambda_H**2))
        of_case["off_cells"][c] = _off_cells(problem, spaces, lambda_H)
    table = {name: ("case", values) for name, values in of_case.items()}
    return xr.Dataset(
        {"distance": (("case", "variant", "rho_share"), distance), **table},
        coords={"case": [case.name for case in cases], "variant": list(VARIANTS), "rho_share": list(shares)},
    ).assign(steps=((), steps))


def iterate(operator: DualOperator, offset: Array, rho: float, steps: int, variant: str) -> Array:
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
    spaces: MixedSpaces, load: Array, g_means: Array, lambda_H: Array, rng: np.random.Generator
) -> tuple[float, float, float]:
    """The smallest L(v, lambda_H) - L(u_h, lambda_H), L(u_h, lambda_H) - L(u_h, mu) and excess of (4.4).

    For random v and mu >= 0, u_h that of lambda_H; L(v, mu) = ||v||_1^2 / 2 - (f, v) - <mu, v - g>; relative
    to |L(u_h, lambda_H)|. The excess is A(U_h, V - U_h) - F(V - U_h) with V = (v, mu).
    """
    H_i, boundary, A = spaces.partition.lengths, spaces.mesh.boundary, spaces.condensed.A
    u_h = spaces.response(load, lambda_H)
    weak = A @ u_h - load
    weak[boundary] -= spaces.B.T @ lambda_H

    def L(v: Array, mu: Array) -> float:
        return float(0.5 * v @ (A @ v) - load @ v - mu @ (spaces.B @ v[boundary] - H_i * g_means))

    at, size = L(u_h, lambda_H), np.abs(u_h).max()
    gap = spaces.B @ u_h[boundary] - H_i * g_means
    in_v, in_mu, excess = [], [], []
    for _ in range(DIRECTIONS):
        w, mu = NEAR * size * rng.standard_normal(len(u_h)), lambda_H.max() * rng.random(len(lambda_H))
        in_v.append(L(u_h + w, lambda_H) - at)
        in_mu.append(at - L(u_h, mu))
        excess.append(float(weak @ w + (mu - lambda_H) @ gap))
    return min(in_v) / abs(at), min(in_mu) / abs(at), min(excess) / abs(at)


def _off_cells(problem: RitzProjection, spaces: MixedSpaces, lambda_H: Array) -> float:
    """The part of u_h - g, in L2, that is not constant on the cells; relative."""
    mesh, partition, polygon = spaces.mesh, spaces.partition, spaces.mesh.polygon
    trace = spaces.response(problem.load, lambda_H)[mesh.boundary]
    rule = boundary_rule(polygon, np.union1d(mesh.s, partition.points), problem.case.singular())
    u, _, gap = problem.case.boundary(rule.side, rule.s, rule.near)
    s = polygon.starts[rule.side] + rule.s
    values = np.interp(s, mesh.s, np.append(trace, trace[0])) - (u - gap)
    cell = np.clip(np.searchsorted(partition.points, s, side="right") - 1, 0, partition.n_cells - 1)
    means = np.bincount(cell, rule.weight * values, partition.n_cells) / partition.lengths
    rest, whole = rule.weight @ (values - means[cell]) ** 2, rule.weight @ values**2
    return float(np.sqrt(rest / whole))
