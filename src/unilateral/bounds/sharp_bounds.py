"""The guaranteed total error of a discrete solution, by a flux and a potential that are nearly the best ones.

Symbols as in `total_errors`: u_h + y is feasible, D = |||y|||, B = <sigma, u_h + y - g>, S bounds the
residual on functions that vanish on clamped sides; s' is the second bound of `residual_norm` on a triangle.

The bounds follow from the residuals of u_h and of a feasible v with one flux q (`bound_total_errors`). Both v
and q begin with w of V_h, u_h or near it, and the flux of `equilibrate_flux` for w (`balance_potential`).

The flux gets a divergence that is linear on each triangle T. With p = c w - f_h, its values p_k at the nodes
x_k, and the hats psi_k there, q gets theta r,

    r = sum_k p_k psi_k (x - x_k) / 3,     div r = p - mean p,     r.n = 0 on the edges,
    theta = k ||div r||_T^2 / (k ||div r||_T^2 + c ||r||_T^2),

since div (psi_k (x - x_k)) = 3 psi_k - 1. f_h is the linear part of f. On small triangles theta is nearly 1,
and the mean-free part of rho = f_h + div q - c w nearly 0; on triangles larger than (k/c)^{1/2} all of r
would cost more than it gains, and on much larger ones theta is 0. With curl phi, phi of P2 and 0 on the
boundary but for clamped sides, div q, and q.n on the other sides, stay what they are. These are all fluxes of
RT1 with those if the other sides make one arc; else those with the same flow through each row of clamped
sides. The potential v of P2 is g where (u_h, lambda_H) is in contact, u_D on clamped sides, and goes
from w towards the solution of (1.1) with k dv/dn = tau~ on free sides and 0 elsewhere; at last it is made
feasible. For f_h, without rounding, S^2 + 2 B of a feasible v is at most eta^2, which both reduce,

    eta^2 = ||q - k grad v||^2 / k + ||f_h + div q - c v||^2 / c + 2 <sigma, v - g>,

independently of each other: (grad v, curl phi) = 0, and the best v does not depend on q. They are found by
conjugate gradients, and every iterate will do.

Where u and f are smooth the bound of u tends to the energy norm of u - u_h, as eta is of higher order.
Nothing is assumed of u_h and lambda_H. What rounding and the exact mesh may do is added on each triangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.bounds.boundary_flux import GivenEdgeFlux, build_normal_flux
from unilateral.bounds.clamped_ends import outflows
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.equilibrated_flux import triangle_inflows
from unilateral.bounds.feasible import Lift, Lifting, build_lifting
from unilateral.bounds.flux_residuals import (
    SUM_ROUNDING,
    add_given_flux_remainder,
    misfit_at_nodes,
    residual_parts,
    rounding_allowances,
    stretched_divergence,
)
from unilateral.bounds.local_bounds import Bound, check_discrete_solution, collect_bounds, equilibrate_source
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, ResidualParts
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import ResidualBounds, bound_residual, bound_total_errors
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import ConjugateGradients
from unilateral.fem.p1 import lumped_mass
from unilateral.fem.p2 import (
    QuadraticForm,
    QuadraticSpace,
    linear_square_norms,
    quadratic_space,
    quadratic_square_norms,
)
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.refinement import CYCLIC_CORNERS
from unilateral.solvers.energy_descent import HatMatrix, build_hat_matrix, start_descent

MIN_RELATIVE_GAIN = 0.001
"""The steps of v end when one lowers eta^2 by less than this fraction of it, and so do those of q.

The next ones would take less still.
"""
MAX_DESCENT_STEPS = 50
"""At most this many steps are made. Some 7 are enough: their number does not depend on the mesh."""
THICK_TRIANGLE_LAYERS = 20.0
"""On triangles with an edge longer than this times (k/c)^{1/2} the flux stays as it is, and phi is 0.

There s' of `flux_residuals` counts, for u_h.
"""
MIN_FREQUENCY = 18.0
"""|chi|_1^2 is at least this times ||chi||_0^2 / |Omega| for all chi that are 0 on the boundary.

It is pi j^2, j = 2.40.. the first zero of the Bessel function J_0 (Faber and Krahn), rounded down. If
c |Omega| is at most this times k, one preconditioner does for k |.|_1^2 and for the form.
"""
MAX_IMBALANCE_FRACTION = 0.01
"""The square of what w leaves of the discrete equations may be this fraction of two others.

They are the squared error of w in L2 over W^4, for W with ||z||_0 <= W |||z|||, and that of what is not known
of f.
"""


def sharp_bound(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    potential: Array | None = None,
) -> Bound:
    """Bounds for what `local_bound` takes and refuses; w is the `potential`, by default u_h, or near it."""
    mesh = data.mesh
    check_discrete_solution(mesh, partition, u_h, lambda_H, form)
    w = u_h if potential is None else potential

    # sigma near lambda_H, and the first q: that of `equilibrate_flux` for w, with theta r
    sigma = build_normal_flux(mesh, partition, lambda_H, w, form)
    energy = build_energy(mesh, form)
    w, q = balance_potential(data.source, w, sigma.end_values + data.given_flux.end_values, energy)
    field = _build_misfit_field(energy.spaces, data.source, w, q, form)
    s_prime = _bound_thick_triangles(field, data.given_flux, u_h, q)
    del q  # its memory is needed for the steps

    # y with u_h + y >= g, D = |||y|||, and D_D, the norm of the part of y at clamped sides
    lifting = build_lifting(data.constraint, form, u_h, sigma)
    y = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    D, D_clamped = _lift_norms(lifting, y)

    # a better flux q + curl phi, and v = w + d that its own lift has made feasible
    field, d, v_lift, steps = _improve_flux_and_potential(lifting, energy, field, data.given_flux, y)
    del energy

    # S of u_h and of v (Lemma S18), and Theorem 8 (Proposition S14)
    u_residual, v_residual = _bound_improved_residuals(field, data.given_flux, u_h, s_prime, y, d, v_lift)
    distance = sigma.multiplier_distance(mesh, form)
    errors = bound_total_errors(
        mesh.exact_mesh_factor, u_residual, v_residual, D=D, D_clamped=D_clamped, sigma_distance=distance
    )
    remainder_norm = max(y.remainder_norm, v_lift.remainder_norm)
    return replace(collect_bounds(data, form, errors, D, remainder_norm, field.outflows), steps=steps)


def _lift_norms(lifting: Lifting, y: Lift) -> tuple[float, float]:
    """D = |||y||| and D_D, the energy norm of the part of y at clamped sides: upper bounds on both."""
    layer = lifting.layer
    form = lifting.form
    # triangle inequality: y is hats and bubbles, extensions, and hats for the remainder of g
    y_norm = layer.norm(form, y.nodal, y.bubbles) + y.shortfall.extension_norm + y.remainder_norm
    clamped = form.clamped_edges(layer.mesh)
    clamped_nodal = np.where(clamped | np.roll(clamped, 1), y.nodal, 0.0)
    clamped_norm = layer.norm(form, clamped_nodal, np.where(clamped, y.bubbles, 0.0))
    clamped_norm += math.sqrt(float(y.shortfall.extension_squares[clamped].sum()))
    # the hats for the remainder are not told apart: all of them count as at clamped sides
    D = (1 + SQUARES_ROUNDING) * y_norm + y.underflow
    return D, (1 + SQUARES_ROUNDING) * (clamped_norm + y.remainder_norm) + y.underflow


class Energy(NamedTuple):
    """P2 on a mesh, its form, and the matrix of the form on V_h."""

    spaces: QuadraticSpace
    quadratic_form: QuadraticForm
    hat_matrix: HatMatrix

    def residual(self, v: Array, f_h: Array, flux: Array) -> Array:
        """The residual (f_h, z) + <flux, z> - k (grad v, grad z) - c (v, z) of v (size,); shape (size,).

        z are the basis functions. f_h (m, 3) is linear on triangles, and the flux (nb, 2) on boundary edges.
        """
        residual = self.spaces.load(f_h)
        residual += self.spaces.edge_load(flux)
        residual -= self.quadratic_form.apply(v)
        return residual


def build_energy(mesh: Mesh, form: Form) -> Energy:
    """The energy of a form on P2 of a mesh."""
    spaces = quadratic_space(mesh)
    return Energy(spaces, spaces.quadratic_form(form), build_hat_matrix(mesh, form))


def _improve_flux_and_potential(
    lifting: Lifting, energy: Energy, field: _MisfitField, tau: GivenEdgeFlux, y: Lift
) -> tuple[_MisfitField, Array, Lift, int]:
    """The field of q + curl phi, d (size,) of v = w + d, the lift of v, and how many steps were made.

    d includes the hats and bubbles of that lift. To be feasible v still lacks the lift's extensions and its
    hats for the remainder of g, whose norm is at most its `missing_norm`.
    """
    spaces = field.spaces
    # until v is known 2 <sigma, v - g> of u_h + y stands for its own in eta^2, which only ends the steps
    d, phi, steps = _minimise_eta(lifting, energy, field, tau.end_values, 2 * y.shortfall.complementarity)
    nodal, bubbles = np.split(d[spaces.boundary_unknowns], 2)
    v_lift = lifting.make_feasible(field.w[spaces.mesh.boundary] + nodal, bubbles)
    d[spaces.boundary_unknowns] += np.concatenate([v_lift.nodal, v_lift.bubbles])
    return field.add_curl(phi), d, v_lift, steps


def _bound_improved_residuals(
    field: _MisfitField, tau: GivenEdgeFlux, u_h: Array, s_prime: Array, y: Lift, d: Array, v_lift: Lift
) -> tuple[ResidualBounds, ResidualBounds]:
    """The bounds on the residuals of u_h, with its s' (m,), and of v = w + d, with the field's flux."""
    tau_error = tau.projection_error(field.spaces.mesh, field.form)
    u_parts = field.residual_parts(field.spaces.embed_linear(u_h - field.w), tau)._replace(s_prime=s_prime)
    u_residual = bound_residual(u_parts, tau_error, y.shortfall.complementarity)
    del u_parts
    v_parts = field.residual_parts(d, tau)
    # what u_h lacks is y, with the norm D; what v lacks is added to its S (`total_errors`, the last sentence)
    v_missing = v_lift.missing_norm + tau_error
    return u_residual, bound_residual(v_parts, v_missing, v_lift.shortfall.complementarity)


def _bound_thick_triangles(field: _MisfitField, tau: GivenEdgeFlux, u_h: Array, q: Array) -> Array:
    """Bounds s' of u_h on thick triangles, infinite on others, with the first flux q; shape (m,)."""
    if not field.is_thick.any():
        return np.broadcast_to(math.inf, len(field.is_thick))
    # theta r and curl phi are 0 on thick triangles: s' of the first q holds there
    s_prime = residual_parts(field.source, tau, u_h, q, field.form).s_prime
    return np.where(field.is_thick, s_prime, math.inf)


@dataclass(frozen=True, eq=False)
class _MisfitField:
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

    def add_curl(self, phi: Array) -> _MisfitField:
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


def balance_potential(source: Source, u_h: Array, sigma: Array, energy: Energy) -> tuple[Array, Array]:
    """w (n,), u_h or a better solution of the discrete equations, and the flux by `equilibrate_flux` for w.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    What a solver left of the discrete equations, and what the flux on the edges leaves of lambda_H, may be
    nothing beside the error of u_h, and much beside the error of lambda_H, which is smaller.
    """
    mesh = source.mesh
    form = energy.quadratic_form.form
    # what u_h leaves of k (grad w, grad z) + c (w, z) = (f, z) + <sigma, z> for all z of P2 with z = u_D = 0
    r = energy.residual(energy.spaces.embed_linear(u_h), source.f_h, sigma)
    r[energy.spaces.boundary_unknowns[np.tile(form.clamped_edges(mesh), 2)]] = 0.0
    r[: mesh.n_nodes][form.clamped_nodes(mesh)] = 0.0
    hat_residual, bubble_residual = np.split(r, [mesh.n_nodes])
    # S has M_T + E_T: a mean far below E_T hardly counts, nor does one far below the error
    square_error = _estimate_square_error(mesh, bubble_residual, energy.quadratic_form)
    tolerance = max(
        MAX_IMBALANCE_FRACTION * max(square_error, float(source.remainder @ source.remainder)),
        _estimate_square_rounding(source, u_h, form),
    )
    # patch a spreads r_a evenly over the area |a| of its triangles, and at most three patches lie at any
    # place: so the square of what div q lacks is at most sum 3 r_a^2 / |a|
    w = u_h + energy.hat_matrix.solve(hat_residual, lumped_mass(mesh), tolerance)
    return w, equilibrate_source(source, w, sigma, form)


def _estimate_square_error(mesh: Mesh, bubble_residual: Array, quadratic_form: QuadraticForm) -> float:
    """An estimate of the squared error of u_h in L2 over W^4, from the residual (edges,) on bubbles."""
    form = quadratic_form.form
    W = form.value_constant
    start, end = mesh.triangulation.ends.T
    x, y = mesh.points.T
    lengths = np.hypot(x.take(end) - x.take(start), y.take(end) - y.take(start))
    # the energy norm of u - u_h is about that of the bubbles r_b / ||b||^2; k^{-1/2} min(h / W, k^{1/2}) / W
    # times that is nearly the norm of u - u_h in L2 over W^2
    energy_squares = bubble_residual**2 / quadratic_form.nodal_squares[mesh.n_nodes :]
    factors = np.minimum(lengths / W, math.sqrt(form.k)) ** 2 / (form.k * W**2)
    return float(factors @ energy_squares)


def _estimate_square_rounding(source: Source, w: Array, form: Form) -> float:
    """About the square of the part of E that is what rounding may do to f_h + div q - c w."""
    mesh = source.mesh
    square = 0.0
    for block in row_blocks(len(mesh.triangles)):
        area = mesh.areas[block]
        values = w.take(mesh.triangles[block].T)
        rise = values.max(axis=0) - values.min(axis=0)
        # flows are some k |grad w| times an edge, and |grad w| is at most rise times an edge over |T|
        f_h = np.ascontiguousarray(source.f_h[block].T)
        size = form.c * np.abs(values).max(axis=0) + np.abs(f_h).max(axis=0)
        size += form.k * rise * (mesh.longest_edges[block] / area) ** 2
        square += SUM_ROUNDING**2 * float(area @ size**2)
    return square


def _build_misfit_field(
    spaces: QuadraticSpace, source: Source, w: Array, q: Array, form: Form
) -> _MisfitField:
    """The `_MisfitField` of q + theta r for w; w and q are as `balance_potential` gives them."""
    mesh = spaces.mesh
    m = len(mesh.triangles)
    # numbers of one node stand together, as blocks of triangles use them
    field = _MisfitField(
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


def _fill_misfit_field(field: _MisfitField, block: slice, q: Array, stretch_allowance: Array) -> None:
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


def _minimise_eta(
    lifting: Lifting, energy: Energy, field: _MisfitField, tau: Array, complementarity: float
) -> tuple[Array, Array, int]:
    """d = v - w and phi (size,) that nearly minimise eta^2, and how many steps were made.

    `tau` (nb, 2) is the flux that is given on free sides, and `complementarity` is nearly 2 <sigma, v - g>.
    """
    spaces = field.spaces
    form = field.form
    # v starts as g in contact, and stays that there
    boundary_start = np.concatenate(lifting.meet_obstacle(field.w[spaces.mesh.boundary]))
    d = np.zeros(spaces.size)
    d[spaces.boundary_unknowns] = boundary_start
    # eta^2 before the first step, with W^2 in place of 1/c
    misfit_squares, *rho_squares = field.square_norms(d).sum(axis=1)
    eta_square = misfit_squares / form.k + form.value_constant**2 * sum(rho_squares) + complementarity

    # v enters eta^2 by |||v|||^2 - 2 (f_h, v) - 2 <q.n, v> + 2 <sigma, v>. On sides with contact q.n = sigma,
    # and the last two cancel; on free sides q.n = tau~ is left; on clamped ones v is given
    d[: len(field.w)] += field.w
    residual = energy.residual(d, field.source.f_h, tau)
    del d  # its memory is needed for the steps
    v_descent = start_descent(
        spaces,
        energy.quadratic_form,
        energy.hat_matrix,
        residual,
        spaces.vanishing_functions(lifting.contact),
    )
    flux_descent = _start_flux_descent(
        field, energy, lifting.constraint.unknowns[~lifting.constraint.clamped_edges]
    )
    unfinished = [v_descent, flux_descent]
    steps = 0
    while unfinished and steps < MAX_DESCENT_STEPS:
        gains = [descent.step() for descent in unfinished]
        eta_square -= sum(gains)
        # eta^2 is below 0 if v is far enough below g
        min_gain = MIN_RELATIVE_GAIN * abs(eta_square)
        unfinished = [descent for descent, gain in zip(unfinished, gains, strict=True) if gain > min_gain]
        steps += 1
    d = v_descent.x
    d[spaces.boundary_unknowns] += boundary_start
    return d, form.k * flux_descent.x, steps


def _start_flux_descent(field: _MisfitField, energy: Energy, outer_unknowns: Index) -> ConjugateGradients:
    """The descent to the chi = phi / k with the least ||q + k curl chi - k grad w||^2 / k.

    chi is 0 at the `outer_unknowns`, those of P2 on the boundary but for clamped sides, and on thick
    triangles.
    """
    spaces = field.spaces
    mesh = spaces.mesh
    form = field.form
    outer = np.zeros(len(spaces.boundary_unknowns), dtype=bool)
    outer[outer_unknowns] = True
    outer[0] = True  # constants have no curl
    hat_matrix = energy.hat_matrix
    if form.clamped or form.c * mesh.areas.sum() > MIN_FREQUENCY * form.k:
        # chi may be any number on clamped sides: a little mass keeps the matrix of all hats regular
        hat_matrix = build_hat_matrix(mesh, Form(form.k, form.k / mesh.polygon.perimeter**2))
    # |curl chi| is |grad chi|
    return start_descent(
        spaces,
        replace(energy.quadratic_form, form=Form(form.k, 0.0)),
        hat_matrix,
        -spaces.curl_load(field.misfit_hats, field.misfit_bubbles),
        spaces.vanishing_functions(outer, spaces.unknowns[field.is_thick].ravel()),
    )
