"""The guaranteed total error of a discrete solution, by a flux and a potential that are nearly the best ones.

Symbols as in `total_errors`: u_h + y is feasible, D = |||y|||, B = <sigma, u_h + y - g>, S bounds the
residual on functions that vanish on clamped sides; s' is the second bound of `residual_norm` on a triangle.

The bounds follow from the residuals of u_h and of a feasible v with one flux (`bound_total_errors`). Both v
and the flux begin with w of V_h, u_h or near it: the flux is q by `equilibrate_flux` for w
(`balanced_potential`) and theta r, by which its divergence is nearly c w - f_h (`misfit_field`). f_h is the
linear part of f.

With curl phi, phi of P2 and 0 on the boundary but for clamped sides, div q, and q.n on the other sides, stay
what they are. These are all fluxes of RT1 with those if the other sides make one arc; else those with the
same flow through each row of clamped sides. The potential v of P2 is g where (u_h, lambda_H) is in contact,
u_D on clamped sides, and goes from w towards the solution of (1.1) with k dv/dn = tau~ on free sides and 0
elsewhere; at last it is made feasible. For f_h, without rounding, S^2 + 2 B of a feasible v is at most eta^2,
which both reduce,

    eta^2 = ||q - k grad v||^2 / k + ||f_h + div q - c v||^2 / c + 2 <sigma, v - g>,

independently of each other: (grad v, curl phi) = 0, and the best v does not depend on q. They are found by
conjugate gradients, and every iterate will do.

Where u and f are smooth the bound of u tends to the energy norm of u - u_h, as eta is of higher order.
Nothing is assumed of u_h and lambda_H. What rounding and the exact mesh may do is added on each triangle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.balanced_potential import Energy, balance_potential, build_energy
from unilateral.bounds.boundary_flux import GivenEdgeFlux, build_normal_flux
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.feasible import Lift, Lifting, build_lifting
from unilateral.bounds.flux_residuals import residual_parts
from unilateral.bounds.local_bounds import Bound, check_discrete_solution, collect_bounds
from unilateral.bounds.misfit_field import MisfitField, build_misfit_field
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.total_errors import ResidualBounds, bound_residual, bound_total_errors
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import ConjugateGradients
from unilateral.geometry.partition import Partition
from unilateral.solvers.energy_descent import build_hat_matrix, start_descent

MIN_RELATIVE_GAIN = 0.001
"""The steps of v end when one lowers eta^2 by less than this fraction of it, and so do those of q.

The next ones would take less still.
"""
MAX_DESCENT_STEPS = 50
"""At most this many steps are made. Some 7 are enough: their number does not depend on the mesh."""
MIN_FREQUENCY = 18.0
"""|chi|_1^2 is at least this times ||chi||_0^2 / |Omega| for all chi that are 0 on the boundary.

It is pi j^2, j = 2.40.. the first zero of the Bessel function J_0 (Faber and Krahn), rounded down. If
c |Omega| is at most this times k, one preconditioner does for k |.|_1^2 and for the form.
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
    field, s_prime = _start_field(data, u_h, w, sigma.end_values + data.given_flux.end_values, energy)

    # y with u_h + y >= g, D = |||y|||, and D_D, the norm of the part of y at clamped sides
    lifting = build_lifting(data.constraint, form, u_h, sigma)
    y = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    D, D_clamped = _lift_norms(lifting, y)

    # a better flux q + curl phi, and v = w + d that its own lift has made feasible
    field, v, steps = _improve_flux_and_potential(lifting, energy, field, data.given_flux, y)
    del energy

    # S of u_h and of v (Lemma S12), and Theorem 8 (Proposition S11)
    u_residual, v_residual = _bound_improved_residuals(field, data.given_flux, u_h, s_prime, y, v)
    errors = bound_total_errors(
        mesh.exact_mesh_factor,
        u_residual,
        v_residual,
        D=D,
        D_clamped=D_clamped,
        sigma_distance=sigma.multiplier_distance(mesh, form),
    )
    return replace(
        collect_bounds(data, form, errors, D, max(y.remainder_norm, v.lift.remainder_norm), field.outflows),
        steps=steps,
    )


def _start_field(
    data: EnclosedData, u_h: Array, w: Array, sigma: Array, energy: Energy
) -> tuple[MisfitField, Array]:
    """The field of the first flux, q + theta r for w or near it, and u_h's s' (m,) with that flux.

    q.n has the values `sigma` (nb, 2) at the ends of the boundary edges. s' is infinite on triangles that are
    not thick.
    """
    source = data.source
    w, q = balance_potential(source, w, sigma, energy)
    field = build_misfit_field(energy.spaces, source, w, q, energy.quadratic_form.form)
    if not field.is_thick.any():
        return field, np.broadcast_to(math.inf, len(field.is_thick))
    # theta r and curl phi are 0 on thick triangles: s' of the first q holds there
    s_prime = residual_parts(source, data.given_flux, u_h, q, field.form).s_prime
    return field, np.where(field.is_thick, s_prime, math.inf)


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


class FeasiblePotential(NamedTuple):
    """v = w + d of P2, d (size,), which its `lift` makes feasible.

    d includes the hats and bubbles of the lift. To be feasible v still lacks the lift's extensions and its
    hats for the remainder of g, whose norm is at most its `missing_norm`.
    """

    d: Array
    lift: Lift


def _improve_flux_and_potential(
    lifting: Lifting, energy: Energy, field: MisfitField, tau: GivenEdgeFlux, y: Lift
) -> tuple[MisfitField, FeasiblePotential, int]:
    """The field of q + curl phi, v, and how many steps were made towards the best ones."""
    spaces = field.spaces
    # until v is known 2 <sigma, v - g> of u_h + y stands for its own in eta^2, which only ends the steps
    d, phi, steps = _minimise_eta(lifting, energy, field, tau.end_values, 2 * y.shortfall.complementarity)
    nodal, bubbles = np.split(d[spaces.boundary_unknowns], 2)
    v_lift = lifting.make_feasible(field.w[spaces.mesh.boundary] + nodal, bubbles)
    d[spaces.boundary_unknowns] += np.concatenate([v_lift.nodal, v_lift.bubbles])
    return field.add_curl(phi), FeasiblePotential(d, v_lift), steps


def _bound_improved_residuals(
    field: MisfitField, tau: GivenEdgeFlux, u_h: Array, s_prime: Array, y: Lift, v: FeasiblePotential
) -> tuple[ResidualBounds, ResidualBounds]:
    """The bounds on the residuals of u_h, with its s' (m,), and of v, with the field's flux."""
    tau_error = tau.projection_error(field.spaces.mesh, field.form)
    u_parts = field.residual_parts(field.spaces.embed_linear(u_h - field.w), tau)._replace(s_prime=s_prime)
    u_residual = bound_residual(u_parts, tau_error, y.shortfall.complementarity)
    del u_parts
    v_parts = field.residual_parts(v.d, tau)
    # what u_h lacks is y, with the norm D; what v lacks is added to its S (`total_errors`, the last sentence)
    v_missing = v.lift.missing_norm + tau_error
    return u_residual, bound_residual(v_parts, v_missing, v.lift.shortfall.complementarity)


def _minimise_eta(
    lifting: Lifting, energy: Energy, field: MisfitField, tau: Array, complementarity: float
) -> tuple[Array, Array, int]:
    """d = v - w and phi (size,) that nearly minimise eta^2, and how many steps were made.

    `tau` (nb, 2) is the flux that is given on free sides, and `complementarity` is nearly 2 <sigma, v - g>.
    """
    spaces = field.spaces
    # v starts as g in contact, and stays that there
    start = np.concatenate(lifting.meet_obstacle(field.w[spaces.mesh.boundary]))
    eta_square = _estimate_eta_square(field, start, complementarity)
    v_descent = _start_potential_descent(lifting, energy, field, start, tau)
    flux_descent = _start_flux_descent(
        field, energy, lifting.constraint.unknowns[~lifting.constraint.clamped_edges]
    )
    steps = _descend([v_descent, flux_descent], eta_square)
    d = v_descent.x
    d[spaces.boundary_unknowns] += start
    return d, field.form.k * flux_descent.x, steps


def _estimate_eta_square(field: MisfitField, start: Array, complementarity: float) -> float:
    """eta^2 before the first step, with W^2 in place of 1/c; v - w is `start` (2 nb,) on the boundary."""
    d = np.zeros(field.spaces.size)
    d[field.spaces.boundary_unknowns] = start
    misfit_squares, *rho_squares = field.square_norms(d).sum(axis=1)
    form = field.form
    return float(misfit_squares / form.k + form.value_constant**2 * sum(rho_squares) + complementarity)


def _descend(descents: list[ConjugateGradients], eta_square: float) -> int:
    """Make steps of each descent until one gains next to nothing of eta^2; how many steps were made."""
    steps = 0
    while descents and steps < MAX_DESCENT_STEPS:
        gains = [descent.step() for descent in descents]
        eta_square -= sum(gains)
        # eta^2 is below 0 if v is far enough below g
        min_gain = MIN_RELATIVE_GAIN * abs(eta_square)
        descents = [descent for descent, gain in zip(descents, gains, strict=True) if gain > min_gain]
        steps += 1
    return steps


def _start_potential_descent(
    lifting: Lifting, energy: Energy, field: MisfitField, start: Array, tau: Array
) -> ConjugateGradients:
    """The descent to what v lacks of the best v, which vanishes in contact.

    v starts as w, with `start` (2 nb,) added on the boundary.
    """
    spaces = field.spaces
    # v enters eta^2 by |||v|||^2 - 2 (f_h, v) - 2 <q.n, v> + 2 <sigma, v>. On sides with contact q.n = sigma,
    # and the last two cancel; on free sides q.n = tau~ is left; on clamped ones v is given
    v = spaces.embed_linear(field.w)
    v[spaces.boundary_unknowns] += start
    residual = energy.residual(v, field.source.f_h, tau)
    del v  # its memory is needed for the steps
    return start_descent(
        spaces,
        energy.quadratic_form,
        energy.hat_matrix,
        residual,
        spaces.vanishing_functions(lifting.contact),
    )


def _start_flux_descent(field: MisfitField, energy: Energy, outer_unknowns: Index) -> ConjugateGradients:
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
