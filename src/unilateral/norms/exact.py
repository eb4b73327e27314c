"""What is measured: errors of u in H1 and of lambda in L2 and in the discrete dual norm, by exact identities.

Everything that needs the interior is computed once per case and mesh, with one pass of quadrature; each
further partition then costs operations on the boundary only. With z_h the Ritz projection of u,

    ||u - u_h||_1^2 = ||u - z_h||_1^2 + 2 (u - z_h, z_h - u_h)_1 + ||z_h - u_h||_1^2,

the last term is ||lambda - lambda_H||_{-1/2,h}^2 and the middle one, 0 in exact arithmetic, is what
quadrature contributes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.errors import InputError
from unilateral.fem.condense import Condensed
from unilateral.fem.p1 import gradients, h1_load, load
from unilateral.fem.quadrature import boundary_rule, triangle_rules
from unilateral.fem.spaces import MixedSpaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.case import Case

SMALLEST, LARGEST = 1e-152, 1e152
"""Of u, so that squares of errors down to 1e-3 of it are normal numbers, and none overflows."""


@dataclass(frozen=True, eq=False)
class RitzProjection:
    """A case seen from V_h: its loads, its Ritz projection z_h and how far u is from that.

    `load` (n,) is (f, phi_i); `flux_load` (nb,) is <lambda, phi_j>; `trace` (nb,) is A^{-1} f on the
    boundary; `ritz_error` is ||u - z_h||_1 and `ritz_defect` (nb,) is A^{-1} (u - z_h, phi_i)_1 on the
    boundary, which is only quadrature's error; `interpolation_error` is ||u - r_h u||_1 of (4.14).
    """

    case: Case
    condensed: Condensed
    load: Array
    flux_load: Array
    trace: Array
    u_norm: float
    interpolation_error: float
    ritz_error: float
    ritz_defect: Array

    def discrete_dual(self, boundary_load: Array) -> float:
        """||mu||_{-1/2,h} = sup over V_h of <mu, v>/||v||_1, from the values <mu, phi_j> (nb,)."""
        return math.sqrt(max(float(boundary_load @ self.condensed.solve_boundary(boundary_load)), 0.0))

    def h1_error(self, boundary_load: Array) -> tuple[float, float]:
        """||u - u_h||_1, and quadrature's share of its square, from <lambda - lambda_H, phi_j> (nb,)."""
        share = 2 * float(self.ritz_defect @ boundary_load)
        square = self.ritz_error**2 + share + self.discrete_dual(boundary_load) ** 2
        return math.sqrt(max(square, 0.0)), abs(share) / square if square > 0 else 0.0


def ritz_projection(case: Case, condensed: Condensed, degree: int | None = None) -> RitzProjection:
    """The projection and its error, with quadrature of that degree in Omega, see `triangle_rules`.

    Raises InputError for a u so large or small that squares of errors leave the range of floating point.
    """
    mesh, A = condensed.mesh, condensed.A
    interpolant, _ = case.value_and_gradient(mesh.points)
    _check_size(case, float(np.abs(interpolant).max()))
    f, residual, square, u_square = _moments(case, mesh, interpolant, degree)
    flux = flux_load(case, mesh)
    total = f.copy()
    total[mesh.boundary] += flux
    solutions = condensed.solve(np.column_stack([f, total]))
    difference = solutions[:, 1] - interpolant
    A_difference = A @ difference
    ritz_square = square - 2 * residual @ difference + difference @ A_difference
    defect = condensed.solve(residual - A_difference)
    return RitzProjection(
        case,
        condensed,
        load=f,
        flux_load=flux,
        trace=solutions[mesh.boundary, 0],
        u_norm=math.sqrt(u_square),
        interpolation_error=math.sqrt(square),
        ritz_error=math.sqrt(max(ritz_square, 0.0)),
        ritz_defect=defect[mesh.boundary],
    )


def _check_size(case: Case, size: float) -> None:
    if size != 0 and not SMALLEST <= size <= LARGEST:
        raise InputError(
            f"case '{case.name}': u is as large as {size:.3g}, and squares of its errors leave double "
            f"precision; scale the data to a size between {SMALLEST:g} and {LARGEST:g}"
        )


def h1_distance(case: Case, mesh: Mesh, v_h: Array, degree: int | None = None) -> float:
    """||u - v_h||_1 of any v_h (n,) in V_h, by quadrature."""
    return math.sqrt(_moments(case, mesh, v_h, degree)[2])


def _moments(case: Case, mesh: Mesh, v_h: Array, degree: int | None) -> tuple[Array, Array, float, float]:
    """(f, phi_i), (u - v_h, phi_i)_1, ||u - v_h||_1^2 and ||u||_1^2, in one pass."""
    nodal = v_h[mesh.triangles]
    slope_of_v = np.einsum("ti,tid->td", nodal, gradients(mesh))
    m = len(mesh.triangles)
    of_f, of_difference, gradient = np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 2))
    square = u_square = 0.0
    for rule in triangle_rules(mesh, case, degree):
        w, phi = rule.weight, rule.barycentric
        u, grad_u = case.value_and_gradient(rule.origin, rule.offset)
        u_square += float(w.ravel() @ (u**2 + grad_u[:, 0] ** 2 + grad_u[:, 1] ** 2))
        value = u.reshape(w.shape) - np.einsum("kb,kqb->kq", nodal[rule.triangle], phi)
        slope = grad_u.reshape(*w.shape, 2) - slope_of_v[rule.triangle][:, None]
        square += float(np.sum(w * (value**2 + slope[..., 0] ** 2 + slope[..., 1] ** 2)))
        f = case.source(rule.origin, rule.offset).reshape(w.shape)
        np.add.at(of_f, rule.triangle, np.einsum("kq,kqb->kb", w * f, phi))
        np.add.at(of_difference, rule.triangle, np.einsum("kq,kqb->kb", w * value, phi))
        np.add.at(gradient, rule.triangle, np.einsum("kq,kqd->kd", w, slope))
    return load(mesh, of_f), h1_load(mesh, of_difference, gradient), square, u_square


def flux_load(case: Case, mesh: Mesh) -> Array:
    """<lambda, phi_j> (nb,) of the boundary hats."""
    rule = boundary_rule(case.polygon, mesh.s, case.singular())
    _, flux, _ = case.boundary(rule.side, rule.s, rule.near)
    edge, nb = rule.interval, len(mesh.boundary)
    position = (rule.s - (mesh.s[edge] - mesh.polygon.starts[rule.side])) / np.diff(mesh.s)[edge]
    weighted = rule.weight * flux
    start = np.bincount(edge, weighted * (1 - position), nb)
    return np.asarray(start + np.roll(np.bincount(edge, weighted * position, nb), 1), dtype=float)


@dataclass(frozen=True, eq=False)
class CellMeans:
    """A case seen from T_H: cell means (m,) of lambda, u - g and g, and norms, NaN if lambda is not in L2.

    These are ||lambda||_0 and ||lambda - Pi_H lambda||_0. `has_transition` (m,) is as the case declares it;
    `size` is the largest |u| + |u - g| on the boundary.
    """

    partition: Partition
    lambda_means: Array
    gap_means: Array
    g_means: Array
    has_transition: Mask
    lambda_norm: float
    projection_error: float
    size: float

    @cached_property
    def consistency_terms(self) -> Array:
        """(m,) the cells' parts of <Pi_H lambda, u - g>, (4.16)."""
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
        of_means = self.partition.lengths @ (self.lambda_means - lambda_H) ** 2
        return math.sqrt(self.projection_error**2 + of_means)

    @cached_property
    def lambda_is_zero(self) -> bool:
        """Up to round-off of the data, whatever their size."""
        return self.lambda_norm <= 1e-12 * self.size


def cell_means(case: Case, partition: Partition) -> CellMeans:
    """Means and norms by quadrature split at the case's singular points, to round-off."""
    rule, m = boundary_rule(case.polygon, partition.points, case.singular()), partition.n_cells
    u, flux, gap = case.boundary(rule.side, rule.s, rule.near)
    lambda_means, gap_means, g_means = (
        rule.integrate(values, m) / partition.lengths for values in (flux, gap, u - gap)
    )
    deviation = flux - lambda_means[rule.interval]
    in_L2 = 1.0 if case.flux_in_L2 else math.nan
    return CellMeans(
        partition,
        lambda_means,
        gap_means,
        g_means,
        partition.has_inside(case.transitions()),
        lambda_norm=in_L2 * math.sqrt(rule.weight @ flux**2),
        projection_error=in_L2 * math.sqrt(rule.weight @ deviation**2),
        size=float(np.max(np.abs(u) + np.abs(gap))),
    )


class ExactErrors(NamedTuple):
    """||u - u_h||_1, ||lambda - lambda_H||_{-1/2,h} and ||lambda - lambda_H||_0; NaN where not judged.

    `quadrature_share` is the share of h1^2 that an exact quadrature would not have.
    """

    h1: float
    hm12_discrete: float
    l2: float
    quadrature_share: float


@dataclass(frozen=True, eq=False)
class Exact:
    """The exact solution seen from both spaces: what a discrete one is measured by."""

    ritz: RitzProjection
    means: CellMeans

    def tolerance(self, spaces: MixedSpaces) -> float:
        """The smallest part of the discretisation error in ||.||_1 that is known before iterating, and not 0.

        These are ||u - z_h||_1 and lambda_min(S)^{1/2} ||lambda - Pi_H lambda||_0.
        """
        if spaces.operator.singular or self.means.lambda_is_zero:
            return self.ritz.ritz_error
        of_lambda = math.sqrt(spaces.operator.lambda_min) * self.means.projection_error
        return min(x for x in (self.ritz.ritz_error, of_lambda) if x > 0)

    def boundary_load(self, spaces: MixedSpaces, mu: Array) -> Array:
        """<lambda - mu, phi_j> (nb,) for mu (m,)."""
        return self.ritz.flux_load - spaces.B.T @ mu

    def errors(self, spaces: MixedSpaces, mu: Array) -> ExactErrors:
        """Those of (u(mu), mu) for mu (m,); where beta is 0 those of lambda are not judged."""
        difference = self.boundary_load(spaces, mu)
        h1, share = self.ritz.h1_error(difference)
        if spaces.operator.singular:
            return ExactErrors(h1, math.nan, math.nan, share)
        l2 = self.means.l2_error(spaces.extended(mu))
        return ExactErrors(h1, self.ritz.discrete_dual(difference), l2, share)


def exact(case: Case, spaces: MixedSpaces) -> Exact:
    """The case's solution seen from the spaces."""
    return Exact(ritz_projection(case, spaces.condensed), cell_means(case, spaces.partition))
