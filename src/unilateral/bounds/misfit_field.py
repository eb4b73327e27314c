"""The functions q - k grad w and f_h + div q - c w of a flux q of RT1 and a w of V_h, on all triangles.

From them follow the residuals of all v of P2 with q, and with q + curl phi for phi of P2.

A flux q by `equilibrate_flux` for w gets a divergence that is linear on each triangle T. With p = c w - f_h,
its values p_k at the nodes x_k, and the hats psi_k there, it gets theta r,

    r = sum_k p_k psi_k (x - x_k) / 3,     div r = p - mean p,     r.n = 0 on the edges,
    theta = k ||div r||_T^2 / (k ||div r||_T^2 + c ||r||_T^2),

since div (psi_k (x - x_k)) = 3 psi_k - 1. f_h is the linear part of f. On small triangles theta is nearly 1,
and the mean-free part of rho = f_h + div q - c w nearly 0; on triangles larger than (k/c)^{1/2} all of r
would cost more than it gains, and on much larger ones theta is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.bounds.boundary_flux import GivenEdgeFlux
from unilateral.bounds.clamped_ends import outflows
from unilateral.bounds.equilibrated_flux import triangle_inflows
from unilateral.bounds.flux_residuals import (
    SUM_ROUNDING,
    add_given_flux_remainder,
    misfit_at_nodes,
    rounding_allowances,
    stretched_divergence,
)
from unilateral.bounds.residual_norm import ResidualParts
from unilateral.bounds.source import Source
from unilateral.fem.form import Form
from unilateral.fem.p2 import QuadraticSpace, linear_square_norms, quadratic_square_norms
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import CYCLIC_CORNERS

THICK_TRIANGLE_LAYERS = 20.0
"""On triangles with an edge longer than this times (k/c)^{1/2} the flux stays as it is, and phi is 0.

There s' of `flux_residuals` counts, for u_h.
"""


@dataclass(frozen=True, eq=False)
class MisfitField:
    """q - k grad w and f_h + div q - c w for a flux q and w (n,) of V_h; v of P2 is given by v - w.

    The first one has the coefficients `misfit_hats` and `misfit_bubbles` (m, 3, 2), the second one the values
    `rho` (m, 3) at the nodes. `misfit_allowance` and `rho_allowance` (m,) are what rounding and the exact
    mesh may add to both on a triangle, and `is_thick` (m,) says where q stays as it is. `outflows` are those
    of a `Bound`: curl phi changes none but within a row of clamped sides.
    """

    spaces: QuadraticSpace
    source: Source
    form: Form
    w: Array
    misfit_hats: Array
    misfit_bubbles: Array
    rho: Array
    misfit_allowance: Array
    rho_allowance: Array
    is_thick: Mask
    outflows: Array

    def add_curl(self, phi: Array) -> MisfitField:
        """The field for the flux q + curl phi."""
        mesh = self.spaces.mesh
        # the mean of |grad 4 psi_i psi_j|^2 is at most 4 / height^2, and a height twice the area over an edge
        size = self.spaces.coefficient_sums(phi) * mesh.longest_edges / mesh.areas
        allowance = (SUM_ROUNDING + mesh.distortion) * size
        misfit_hats = np.empty_like(self.misfit_hats)
        for block in row_blocks(len(mesh.triangles)):
            misfit_hats[block] = self.misfit_hats[block] + _curl(self.spaces.gradient(phi, block))
        return replace(self, misfit_hats=misfit_hats, misfit_allowance=self.misfit_allowance + allowance)

    def square_norms(self, d: Array) -> Array:
        """The squared norms (3, m) of q - k grad v, of rho less its mean, and of its mean, for v = w + d.

        The bounds weigh the mean of rho and the rest differently.
        """
        k = self.form.k
        c = self.form.c
        squares = np.empty((3, len(self.rho)))
        for block in row_blocks(len(self.rho)):
            area = self.spaces.mesh.areas[block]
            d_hats, d_bubbles = self.spaces.coefficients(d, block)
            rho_hats = self.rho[block] - c * d_hats
            rho_bubbles = -c * d_bubbles
            # the means of a hat and of a bubble are 1/3
            mean = (rho_hats.sum(axis=1) + rho_bubbles.sum(axis=1)) / 3
            misfit_hats = self.misfit_hats[block] - k * self.spaces.gradient(d, block)
            squares[0, block] = quadratic_square_norms(area, misfit_hats, self.misfit_bubbles[block])
            squares[1, block] = quadratic_square_norms(area, rho_hats - mean[:, None], rho_bubbles)
            squares[2, block] = area * mean**2
        return squares

    def residual_parts(self, d: Array, given_flux: GivenEdgeFlux) -> ResidualParts:
        """The parts of the residual of v = w + d, with what is left of tau; s' is infinite."""
        mesh = self.spaces.mesh
        source = self.source
        form = self.form
        size = SUM_ROUNDING * self.spaces.coefficient_sums(d)
        misfit_allowance = self.misfit_allowance + form.k * size * mesh.longest_edges / mesh.areas
        rho_allowance = self.rho_allowance + form.c * size
        misfit_norm, rho_norm, mean = np.sqrt(self.square_norms(d))
        # p - f_h is orthogonal to linear functions
        is_linear = not np.any(d[len(self.w) :])
        mean_free = np.hypot(rho_norm, source.oscillation) if is_linear else rho_norm + source.oscillation
        residual = ResidualParts(
            mesh,
            form,
            misfit=misfit_norm + np.sqrt(mesh.areas) * misfit_allowance,
            oscillation=mean_free + source.jumps,
            mean=mean,
            remainder=source.remainder + np.sqrt(mesh.areas) * rho_allowance,
            s_prime=np.broadcast_to(math.inf, mean.shape),
        )
        add_given_flux_remainder(residual, given_flux)
        return residual


def _curl(gradient: Array) -> Array:
    """The curl (d_y phi, -d_x phi) at the nodes of each triangle, from the gradient of phi, (m, 3, 2)."""
    curl = np.empty_like(gradient)
    curl[..., 0] = gradient[..., 1]
    curl[..., 1] = -gradient[..., 0]
    return curl


def build_misfit_field(spaces: QuadraticSpace, source: Source, w: Array, q: Array, form: Form) -> MisfitField:
    """The `MisfitField` of q + theta r for w; w and q are as `balance_potential` gives them."""
    mesh = spaces.mesh
    m = len(mesh.triangles)
    # numbers of one node stand together, as blocks of triangles use them
    field = MisfitField(
        spaces,
        source,
        form,
        w,
        misfit_hats=np.empty((3, 2, m)).transpose(2, 0, 1),
        misfit_bubbles=np.empty((3, 2, m)).transpose(2, 0, 1),
        rho=np.empty((3, m)).T,
        misfit_allowance=np.empty(m),
        rho_allowance=np.empty(m),
        is_thick=form.c * mesh.longest_edges**2 > THICK_TRIANGLE_LAYERS**2 * form.k,
        outflows=outflows(mesh, form, q),
    )
    stretched = stretched_divergence(mesh, q)
    for block in row_blocks(m):
        _fill_misfit_field(field, block, q, stretched[block])
    return field


def _fill_misfit_field(field: MisfitField, block: slice, q: Array, stretch_allowance: Array) -> None:
    """Put in the numbers of some triangles, whose `stretched_divergence` is the `stretch_allowance` (k,)."""
    mesh = field.spaces.mesh
    form = field.form
    area = mesh.areas[block]
    nodes = field.spaces.unknowns[block].T[:3]
    f_h = field.source.f_h[block].T
    w = field.w.take(nodes)
    p = form.c * w - f_h
    theta, r = _correct_divergence(mesh, nodes, area, p, form)
    theta[field.is_thick[block]] = 0.0
    inflows = triangle_inflows(mesh, q, block)
    field.misfit_hats[block] = -misfit_at_nodes(mesh, nodes, form.k * w, inflows, area).transpose(2, 1, 0)
    field.misfit_bubbles[block] = (theta * r).transpose(2, 0, 1)

    # f_h + div (q + theta r) - c w = div q - mean p - (1 - theta) (p - mean p)
    div_q = -0.5 * (inflows[0] + inflows[1]).sum(axis=0) / area
    mean = p.sum(axis=0) / 3
    field.rho[block] = ((div_q - mean) - (1 - theta) * (p - mean)).T

    # what rounding may do to w and q, and to r: |r| <= longest edge times |p|, |div r| <= 2 |p|
    misfit_allowance, rho_allowance = rounding_allowances(
        mesh, block, np.abs(w).max(axis=0), f_h, inflows, form, stretch_allowance
    )
    p_rounding = (SUM_ROUNDING + mesh.distortion[block]) * np.abs(p).max(axis=0)
    field.misfit_allowance[block] = misfit_allowance + mesh.longest_edges[block] * p_rounding
    field.rho_allowance[block] = rho_allowance + 2 * p_rounding


def _correct_divergence(mesh: Mesh, nodes: Index, area: Array, p: Array, form: Form) -> tuple[Array, Array]:
    """theta (k,), and r by the coefficients (3, 2, k) of its bubbles, on triangles of the `nodes` (3, k).

    p has the values (3, k) at these nodes.
    """
    points = mesh.points.ravel()
    x = np.stack([points.take(2 * nodes), points.take(2 * nodes + 1)], axis=1)
    # on the edge from x_i to x_j r is a bubble, 4 psi_i psi_j, times (p_i - p_j) (x_j - x_i) / 12
    r = np.empty_like(x)
    for i, j, _ in CYCLIC_CORNERS:
        np.multiply((p[i] - p[j]) / 12, x[j] - x[i], out=r[i])
    # theta = k ||div r||^2 / (k ||div r||^2 + c ||r||^2), div r = p - mean p; any number where p is constant
    div_squares = form.k * linear_square_norms(area, (p - p.sum(axis=0) / 3).T)
    bubbles = r.transpose(2, 0, 1)
    total_squares = div_squares + form.c * quadratic_square_norms(area, np.zeros_like(bubbles), bubbles)
    theta = np.divide(div_squares, total_squares, out=np.ones_like(total_squares), where=total_squares > 0)
    return theta, r
