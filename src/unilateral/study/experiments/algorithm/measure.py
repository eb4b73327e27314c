"""What sections 1, 3 and 5 of the paper say of Lagrangians and of Uzawa's algorithm, tried on one mesh."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, with_solution
from unilateral.fem.condense import condense
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import DualOperator, MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import Exact, cell_means
from unilateral.norms.ritz import ritz_projection
from unilateral.problems.case import Case
from unilateral.solvers.active_set import active_set
from unilateral.study.uzawa_variants import VARIANTS, iterate

DIRECTIONS, NEAR = 200, 1e-6
"""How many random directions are tried, and how near to u_h: there a slope of L in v, if there were one,
outweighs its curvature."""
BOUNDED = 1e6
"""Distances above this number count as this number."""


class SolvedCase(NamedTuple):
    """A case's discrete problem with lambda_H (m,) from the active set."""

    discrete: CondensedProblem
    exact: Exact
    lambda_H: Array

    @property
    def spaces(self) -> MixedSpaces:
        return self.discrete.spaces


def known(mesh: Mesh, partition: Partition, cases: Sequence[Case]) -> Iterator[SolvedCase]:
    """The cases on one mesh and one partition."""
    spaces = mixed_spaces(condense(mesh), partition)
    for case in cases:
        exact = Exact(ritz_projection(case, spaces.condensed), cell_means(case, partition))
        discrete = with_solution(spaces, exact)
        yield SolvedCase(discrete, exact, active_set(spaces.operator, discrete.offset, np.inf).lambda_H)


def algorithm(
    mesh: Mesh, partition: Partition, cases: Sequence[Case], shares: Sequence[float], steps: int
) -> xr.Dataset:
    """Distances from lambda_H after so many steps from 0, by step rho (a share of 2/lambda_max(S)).

    They are in L2, relative to lambda_H, over (case, variant, rho_share). Further numbers of each case are
    how far (u_h, lambda_H) is from being a saddle point, the factor between the stationary multipliers of
    (3.3) and of section 5, and the part of u_h - g that is not constant on the cells. `..._elsewhere` is the
    same with lambda_H + 1, and for the Lagrangian of section 5.
    """
    rng = np.random.default_rng(0)
    distances, of_cases = [], []
    for of in known(mesh, partition, cases):
        distances.append([[_distance(of, share, steps, variant) for share in shares] for variant in VARIANTS])
        of_cases.append(
            _saddle(of, of.lambda_H, rng, "")
            | _saddle(of, of.lambda_H + 1, rng, "_elsewhere")
            | {
                "multiplier_factor": _factor(of, 0.5),
                "multiplier_factor_elsewhere": _factor(of, 1.0),
                "off_cells": _off_cells(of),
            }
        )
    table: dict[str, Any] = {"distance": (("case", "variant", "rho_share"), np.array(distances))}
    table |= {name: ("case", [each[name] for each in of_cases]) for name in of_cases[0]}
    coords = {"case": [case.name for case in cases], "variant": list(VARIANTS), "rho_share": list(shares)}
    return xr.Dataset(table, coords).assign(steps=((), steps))


def _distance(of: SolvedCase, share: float, steps: int, variant: str) -> float:
    operator, H_i = of.spaces.operator, of.spaces.partition.lengths
    found = iterate(operator, of.discrete.offset, share * 2 / operator.lambda_max, steps, variant)
    difference = np.where(np.isfinite(found), np.clip(found - of.lambda_H, -1e100, 1e100), 1e100)
    return min(float(np.sqrt(H_i @ difference**2 / (H_i @ of.lambda_H**2))), BOUNDED)


def _factor(of: SolvedCase, share: float) -> float:
    """The norm in L2 of the stationary multiplier with that share of D, over that of lambda_H."""
    spaces, H_i = of.spaces, of.spaces.partition.lengths
    scaled = DualOperator(spaces.operator.half * np.sqrt(share), H_i, spaces.mesh.polygon.area)
    other = active_set(scaled, of.discrete.offset, np.inf).lambda_H
    return float(np.sqrt(H_i @ other**2 / (H_i @ of.lambda_H**2)))


def _saddle(of: SolvedCase, multiplier: Array, rng: np.random.Generator, suffix: str) -> dict[str, float]:
    """The smallest L(v, lambda_H) - L(u_h, lambda_H), L(u_h, lambda_H) - L(u_h, mu) and excess of (4.4).

    They are relative to |L(u_h, lambda_H)|, for random v and mu >= 0, where u_h belongs to the multiplier
    lambda_H, and L(v, mu) = ||v||_1^2 / 2 - (f, v) - <mu, v - g>. The excess is
    A(U_h, V - U_h) - F(V - U_h), V = (v, mu).
    """
    spaces, load, g_means = of.spaces, of.discrete.load, of.exact.means.g_means
    H_i, boundary, A = spaces.partition.lengths, spaces.mesh.boundary, spaces.condensed.A
    u_h = spaces.response(load, multiplier)
    weak = A @ u_h - load
    weak[boundary] -= spaces.B.T @ multiplier

    def L(v: Array, mu: Array) -> float:
        return float(0.5 * v @ (A @ v) - load @ v - mu @ (spaces.B @ v[boundary] - H_i * g_means))

    at, size = L(u_h, multiplier), np.abs(u_h).max()
    gap = spaces.B @ u_h[boundary] - H_i * g_means
    found: dict[str, list[float]] = {"saddle_in_v": [], "saddle_in_mu": [], "inequality": []}
    for _ in range(DIRECTIONS):
        w, mu = NEAR * size * rng.standard_normal(len(u_h)), multiplier.max() * rng.random(len(multiplier))
        found["saddle_in_v"].append(L(u_h + w, multiplier) - at)
        found["saddle_in_mu"].append(at - L(u_h, mu))
        found["inequality"].append(float(weak @ w + (mu - multiplier) @ gap))
    return {f"{name}{suffix}": min(values) / abs(at) for name, values in found.items()}


def _off_cells(of: SolvedCase) -> float:
    """The part of u_h - g, in L2, that is not constant on the cells; relative."""
    mesh, partition, case = of.spaces.mesh, of.spaces.partition, of.exact.ritz.case
    trace = of.spaces.response(of.discrete.load, of.lambda_H)[mesh.boundary]
    rule = boundary_rule(mesh.polygon, np.union1d(mesh.s, partition.points), case.singular())
    u, _, gap = case.boundary(rule.side, rule.s, rule.near)
    s = mesh.polygon.starts[rule.side] + rule.s
    values = np.interp(s, mesh.s, np.append(trace, trace[0])) - (u - gap)
    cell = np.clip(np.searchsorted(partition.points, s, side="right") - 1, 0, partition.n_cells - 1)
    means = np.bincount(cell, rule.weight * values, partition.n_cells) / partition.lengths
    rest, whole = rule.weight @ (values - means[cell]) ** 2, rule.weight @ values**2
    return float(np.sqrt(rest / whole))
