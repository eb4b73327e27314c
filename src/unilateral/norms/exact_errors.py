"""What is measured: errors of u in H1 and of lambda in L2 and in the discrete dual norm, by exact identities.

Once a case is seen from a mesh (`ritz`), each partition costs operations on the boundary only. With z_h the
Ritz projection of u,

    ||u - u_h||_1^2 = ||u - z_h||_1^2 + 2 (u - z_h, z_h - u_h)_1 + ||z_h - u_h||_1^2,

the last term is ||lambda - lambda_H||_{-1/2,h}^2 and the middle one, 0 in exact arithmetic, is what
quadrature contributes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.fem.p1 import coupling
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import MixedSpaces
from unilateral.geometry.partition import Partition
from unilateral.norms.ritz import RitzProjection, ritz_projection

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution


@dataclass(frozen=True, eq=False)
class CellMeans:
    """A case seen from T_H: cell means (m,) of lambda, u - g and g, and norms, NaN if lambda is not in L2.

    The norms are ||lambda||_0 and ||lambda - Pi_H lambda||_0. `has_transition` (m,) is as the case declares
    it; `data_size` is the largest |u| + |u - g| on the boundary.
    """

    partition: Partition
    lambda_means: Array
    gap_means: Array
    g_means: Array
    has_transition: Mask
    lambda_norm: float
    projection_error: float
    data_size: float

    @cached_property
    def consistency_terms(self) -> Array:
        """The cells' parts (m,) of <Pi_H lambda, u - g>, (4.16)."""
        return self.partition.lengths * self.lambda_means * self.gap_means

    @property
    def consistency(self) -> float:
        """<Pi_H lambda, u - g>, (4.16)."""
        return float(self.consistency_terms.sum())

    @property
    def consistency_elsewhere(self) -> float:
        """The part of <Pi_H lambda, u - g> on the cells without a transition, (4.16): 0 in theory."""
        return float(self.consistency_terms[~self.has_transition].sum())

    def l2_error(self, lambda_H: Array) -> float:
        """||lambda - lambda_H||_0, exact: the projection's error and that of the means are orthogonal."""
        mean_error_square = self.partition.lengths @ (self.lambda_means - lambda_H) ** 2
        return math.sqrt(self.projection_error**2 + mean_error_square)

    @cached_property
    def lambda_is_zero(self) -> bool:
        """Whether lambda is 0 up to a thousand times the round-off of the data, whatever their size."""
        return self.lambda_norm <= 1e-12 * self.data_size


def cell_means(case: ExactSolution, partition: Partition) -> CellMeans:
    """The cell means of one case, see `cell_means_of_gaps`."""
    return cell_means_of_gaps([case], partition)[0]


def cell_means_of_gaps(cases: Sequence[ExactSolution], partition: Partition) -> list[CellMeans]:
    """Cell means and norms of cases with the same u, which is evaluated once, and different gaps u - g."""
    # they are exact to round-off: the quadrature is split at the singular points of all cases
    singular = [point for case in cases for point in case.singular_points()]
    rule = boundary_rule(partition.polygon, partition.points, singular)
    m = partition.n_cells
    # all cases have the first one's u and lambda
    u, flux, first_gap = cases[0].trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    gaps = [first_gap, *(case.gap(rule.side, rule.s) for case in cases[1:])]
    lambda_means = rule.integrate(flux, m) / partition.lengths
    # lambda - Pi_H lambda, whose norm is measured directly: the difference of two squares would be rounded
    deviation = flux - lambda_means[rule.interval]
    in_L2 = 1.0 if cases[0].flux_in_L2 else math.nan
    lambda_norm = in_L2 * math.sqrt(rule.weight @ flux**2)
    projection_error = in_L2 * math.sqrt(rule.weight @ deviation**2)
    return [
        CellMeans(
            partition,
            lambda_means=lambda_means,
            gap_means=rule.integrate(gap, m) / partition.lengths,
            g_means=rule.integrate(u - gap, m) / partition.lengths,
            has_transition=partition.has_inside(case.transitions()),
            lambda_norm=lambda_norm,
            projection_error=projection_error,
            data_size=float(np.max(np.abs(u) + np.abs(gap))),
        )
        for case, gap in zip(cases, gaps, strict=True)
    ]


class ExactErrors(NamedTuple):
    """||u - u_h||_1, ||lambda - lambda_H||_{-1/2,h} and ||lambda - lambda_H||_0; NaN where not judged.

    `quadrature_share` is the share of h1^2 that an exact quadrature would not have.
    """

    h1: float
    hm12_discrete: float
    l2: float
    quadrature_share: float


@dataclass(frozen=True, eq=False)
class CaseProjections:
    """The exact solution seen from both spaces: what a discrete one is measured by."""

    ritz: RitzProjection
    cell_means: CellMeans

    def smallest_error_part(self, spaces: MixedSpaces) -> float:
        """The smallest part that is not 0 of the discretisation error, as far as known before iterating."""
        # the parts are ||u - z_h||_1 and lambda_min(S)^{1/2} ||lambda - Pi_H lambda||_0
        if spaces.operator.is_singular or self.cell_means.lambda_is_zero:
            return self.ritz.ritz_error
        lambda_part = math.sqrt(spaces.operator.lambda_min) * self.cell_means.projection_error
        return min(x for x in (self.ritz.ritz_error, lambda_part) if x > 0)

    def boundary_load(self, spaces: MixedSpaces, mu: Array) -> Array:
        """<lambda - mu, phi_j> (nb,) for mu (m,)."""
        return self.ritz.multiplier_load - spaces.B.T @ mu

    def ritz_means_norm(self, spaces: MixedSpaces) -> float:
        """||Pi_H(u - z_h)||_0 on the cells with a multiplier."""
        # not spaces.B, which is 0 at clamped nodes, where z_h need not be
        u_means = (self.cell_means.gap_means + self.cell_means.g_means)[spaces.cells]
        lengths = spaces.operator.H_i
        B = coupling(spaces.mesh, spaces.partition)[spaces.cells]
        z_means = B @ self.ritz.boundary_values / lengths
        return math.sqrt(lengths @ (u_means - z_means) ** 2)

    def errors(self, spaces: MixedSpaces, mu: Array) -> ExactErrors:
        """The errors of (u(mu), mu) for mu (m,); those of lambda are not judged where beta is 0."""
        h1, share, dual = self.ritz.h1_and_dual_errors(self.boundary_load(spaces, mu))
        if spaces.operator.is_singular:
            return ExactErrors(h1, math.nan, math.nan, share)
        return ExactErrors(h1, dual, self.cell_means.l2_error(spaces.extend_by_zero(mu)), share)


def project_case(case: ExactSolution, spaces: MixedSpaces) -> CaseProjections:
    """The case's solution seen from the spaces."""
    return CaseProjections(ritz_projection(case, spaces.condensed), cell_means(case, spaces.partition))
