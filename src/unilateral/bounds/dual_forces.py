"""The force over a part of the boundary between two numbers, whose distance falls faster than errors do.

P is a set of sides, J the integral of lambda over those with contact plus that of k du/dn over clamped ones.
Let X bound |||u - u_h|||, and let v be the feasible function of `local_bounds`, R its residual with sigma. By

    |||u - v|||^2 + <lambda, v - g> + <sigma, u - g> = R(u - v) + <sigma, v - g>

both <lambda, v - g> and <sigma, u - g> together are at most G = B + S^2 / 4 (`gamma_force_bound`). Let psi be 1
on P and 0 on the other sides that are not free, w in V_h be psi on clamped sides, M >= 0, and q_w a flux with
q_w.n = 0 on free sides and s = q_w.n on those with contact, so that there

    psi - w <= M (v - g),     s <= M sigma.

With S_w a bound on the residual R_w(z) = (q_w - k grad w, grad z) + (div q_w - c w, z), (1.1) says that

    J <= (u_h, w) - (f, w) - <q, w> - <q_w.n, u_h - g> + X S_w + M G,

where u_D stands for g on clamped sides, (u_h, w) is the form, and q the given flux. With -psi for psi it is a bound
from below (supplement, Proposition S20). X S_w is a product of two errors, and G falls like X^2.

w is psi at the nodes in contact, discretely harmonic (of the form) elsewhere, and then raised where v - g needs it.
q_w is made by `equilibrate_flux` from w~ in V_h, whose flux on the zone of contact is the nodal one of w, less what
exceeds M sigma. So for the bound from below, where w <= 1 and s >= 0 by the maximum principle, M is 0 or nearly so;
for the one from above w and s cannot both be what they should be beside an end of contact. There S_w^2 falls like
1 / M, so with X ~ h, G ~ h^2 the best M ~ h^{-2/3} leaves h^{4/3}. Where contact has no end, and w is in H^2, it
is h^2. Nothing is assumed of w, w~ and M.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Mask
from unilateral.bounds.boundary_flux import build_normal_flux, no_given_flux
from unilateral.bounds.constraint import BERNSTEIN_ROUNDING, bernstein_bounds
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.equilibrated_flux import boundary_end_values
from unilateral.bounds.feasible import Lifting, Shortfall, build_lifting
from unilateral.bounds.flux_residuals import residual_parts
from unilateral.bounds.local_bounds import Bound, equilibrate_source
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, ResidualParts
from unilateral.bounds.source import zero_source
from unilateral.fem.condense import form_matrix
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import SparseFactors, factorise_by_dissection
from unilateral.fem.p1 import boundary_mass, edge_load, energy_norm, gradients
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition

FACTOR_STEP = 4.0
MAX_FACTOR_STEPS = 8
FIRST_FACTOR_SHARE = 1 / 16
"""The search for the best M begins where M G is this part of X |||w|||, and goes on by FACTOR_STEP.

Only the sharpness of the bounds depends on these numbers.
"""


class ForceInterval(NamedTuple):
    """A value of the force, and two numbers between which it lies.

    `shares` (m,) are the parts of the triangles in the bounds, with a sum of 2.
    """

    value: float
    lower: float
    upper: float
    shares: Array


class _Primal(NamedTuple):
    """What is known of the solution: u_h, v, sigma, and the bounds X and G.

    `residual` (n,) is (u_h, phi_i) - (f, phi_i) - <q, phi_i>. v has the values `v_trace` (2 nb,) at the P2
    unknowns of the boundary; v - g is at least that less p and the remainder, and between two nodes
    `in_contact` (nb,) it is at least 0. `sigma` (nb, 2) are the values at the ends of the boundary edges.
    `lift` is None where u_h is u_D on clamped sides. The equations are those of w, which is given in contact,
    and of w~, given on clamped sides only; None if they determine no constant.
    """

    data: EnclosedData
    form: Form
    matrix: sp.csr_array
    u_h: Array
    residual: Array
    v_trace: Array
    in_contact: Mask
    sigma: Array
    X: float
    G: float
    lift: _LiftNorms | None
    contact_equation: _Equation | None
    flux_equation: _Equation | None


class _Equation(NamedTuple):
    """The equations (w, phi_i) = load_i for the `free` nodes (n,), and the factors of their matrix."""

    matrix: sp.csr_array
    free: Mask
    factors: SparseFactors

    def solve(self, values: Array, load: Array) -> Array:
        """The solution (n,) for this load (n,) with these values (n,) at the nodes that are not free."""
        w = np.where(self.free, 0.0, values)
        w[self.free] = self.factors.solve((load - self.matrix @ w)[self.free])
        return w


class _LiftNorms(NamedTuple):
    """Bounds on |||u - v|||, and on |y|_1 and ||y||_0 for y = v - u_h."""

    eta: float
    gradient_norm: float
    value_norm: float


class _ForceBound(NamedTuple):
    """A bound from above on J for psi, the number near J that it rests on, and the triangles' parts in S_w^2."""

    upper: float
    estimate: float
    shares: Array


def enclose_force(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    bound: Bound,
    sides: Collection[int],
) -> ForceInterval:
    """The force over `sides` with contact, with the reactions on clamped ones, by the cheap `bound` of (u_h, lambda_H).

    Clamped sides in a row have to be in `sides` together. The interval is infinite where nothing is known.
    """
    primal = _collect_primal(data, partition, u_h, lambda_H, form, bound)
    on_P = np.isin(data.mesh.side, [*sides]) & ~np.isin(data.mesh.side, form.free)
    above = _bound_from_above(primal, on_P.astype(float))
    below = _bound_from_above(primal, -on_P.astype(float))
    lower = -below.upper if {*sides} & {*form.clamped} else max(-below.upper, 0.0)
    upper = max(above.upper, lower)
    value = min(max(0.5 * (above.estimate - below.estimate), lower), upper)
    # X S_w is a product of two roots of sums over triangles: of each sum a triangle counts by its fraction
    shares = _normalise(bound.shares) + 0.5 * (_normalise(above.shares) + _normalise(below.shares))
    return ForceInterval(value, lower, upper, shares)


def _normalise(shares: Array) -> Array:
    """The shares (m,) over their sum, 0 if all are."""
    return np.asarray(shares / max(float(shares.sum()), np.finfo(float).tiny))


def _collect_primal(
    data: EnclosedData, partition: Partition, u_h: Array, lambda_H: Array, form: Form, bound: Bound
) -> _Primal:
    """The parts of the bound that do not depend on the force; v and sigma are those of `local_bound`."""
    mesh = data.mesh
    flux = build_normal_flux(mesh, partition, lambda_H, u_h, form)
    lifting = build_lifting(data.constraint, form, u_h, flux)
    nodal, bubbles, shortfall = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    # at clamped nodes v may be lower by what is not known of u_D
    v = u_h[mesh.boundary] + nodal - shortfall.nodal_change
    at_clamped = _at_nodes(form.clamped_edges(mesh))
    in_contact = lifting.contact[: len(v)] & _at_nodes(form.has_multiplier(mesh.side)) & ~at_clamped
    matrix = form_matrix(mesh, form._replace(clamped=()))
    return _Primal(
        data,
        form,
        matrix,
        u_h,
        residual=matrix @ u_h - data.load,
        v_trace=np.concatenate([v, 0.5 * (v + np.roll(v, -1)) + bubbles]),
        in_contact=in_contact,
        sigma=flux.end_values,
        X=bound.u,
        G=(1 + SQUARES_ROUNDING) * bound.clamped_ends.gamma_force_bound,
        lift=_bound_lift(lifting, nodal, bubbles, shortfall, bound),
        contact_equation=_factorise_equation(mesh, form, matrix, in_contact | at_clamped),
        flux_equation=_factorise_equation(mesh, form, matrix, at_clamped),
    )


def _factorise_equation(mesh: Mesh, form: Form, matrix: sp.csr_array, fixed: Mask) -> _Equation | None:
    """The equations for functions that are given at the boundary nodes `fixed` (nb,)."""
    if not fixed.any() and not form.c:
        return None
    free = np.ones(mesh.n_nodes, dtype=bool)
    free[mesh.boundary[fixed]] = False
    return _Equation(matrix, free, factorise_by_dissection(matrix[free][:, free].tocsr()))


def _at_nodes(edges: Mask) -> Mask:
    """The boundary nodes (nb,) at the ends of these boundary edges (nb,)."""
    return edges | np.roll(edges, 1)


def _bound_lift(
    lifting: Lifting, nodal: Array, bubbles: Array, shortfall: Shortfall, bound: Bound
) -> _LiftNorms | None:
    """Norms of y, which has these hats and bubbles and the shortfall; None if it is 0 on clamped sides."""
    edges = lifting.constraint.clamped_edges
    nodes = _at_nodes(edges)
    on_clamped = (nodal[nodes], bubbles[edges], shortfall.extension_squares[edges], shortfall.nodal_change)
    if not any(np.any(values) for values in on_clamped):
        return None
    # ||y||_0 of hats and bubbles; of extensions, at most half their height times |w|_1; and of hats for remainders
    values_only = Form(k=np.finfo(float).tiny, c=1.0)
    mesh = lifting.constraint.mesh
    k = lifting.form.k
    remainder = float(np.max(shortfall.nodal_raise + shortfall.nodal_change))
    value_norm = (
        lifting.layer.norm(values_only, nodal, bubbles)
        + 0.5 * mesh.diameter * shortfall.extension_norm / math.sqrt(k)
        + math.sqrt(float(mesh.areas.sum())) * remainder
    )
    return _LiftNorms(bound.eta, bound.lift_norm / math.sqrt(k), value_norm)


def _bound_from_above(primal: _Primal, psi: Array) -> _ForceBound:
    """The least bound on J that was found, for psi (nb,) on the boundary edges."""
    w, s = _extend_from_contact(primal, psi)
    best = _bound_for_factor(primal, psi, w, s, 0.0)
    if not primal.G > 0:
        return best
    first_factor = FIRST_FACTOR_SHARE * primal.X * energy_norm(primal.data.mesh, w, primal.form) / primal.G
    # from the first M up, and then down, as long as the bound falls
    for step in (FACTOR_STEP, 1 / FACTOR_STEP):
        last = math.inf
        for k in range(MAX_FACTOR_STEPS):
            force_bound = _bound_for_factor(primal, psi, w, s, first_factor * step**k)
            best = min(best, force_bound, key=lambda candidate: candidate.upper)
            if last <= force_bound.upper < math.inf:
                break
            last = force_bound.upper
    return best


def _extend_from_contact(primal: _Primal, psi: Array) -> tuple[Array, Array]:
    """w (n,), which is psi in contact and discretely harmonic elsewhere, and its nodal flux s (nb, 2) there."""
    mesh = primal.data.mesh
    form = primal.form
    clamped = form.clamped_edges(mesh)
    has_multiplier = form.has_multiplier(mesh.side)
    at_clamped = _at_nodes(clamped)
    # at a node psi is the larger one of both edges, and on clamped sides theirs
    nodal = np.where(at_clamped, _at_nodes_largest(psi, clamped), _at_nodes_largest(psi, has_multiplier))
    fixed = at_clamped | primal.in_contact
    w = np.full(mesh.n_nodes, psi.max())
    w[mesh.boundary[fixed]] = nodal[fixed]
    if primal.contact_equation:
        w = primal.contact_equation.solve(w, np.zeros(mesh.n_nodes))

    # the continuous s on the zone of contact with <s, phi_i> = (w, phi_i) at its nodes
    zone = fixed & np.roll(fixed, -1) & has_multiplier
    nodes = np.flatnonzero(_at_nodes(zone) & ~at_clamped)
    s = np.zeros(len(zone))
    if nodes.size:
        mass = boundary_mass(mesh, zone)[nodes][:, nodes]
        s[nodes] = factorise_by_dissection(mass).solve((primal.matrix @ w)[mesh.boundary[nodes]])
    return w, np.where(zone[:, None], np.column_stack([s, np.roll(s, -1)]), 0.0)


def _at_nodes_largest(values: Array, edges: Mask) -> Array:
    """The larger one of the values (nb,) on these edges at each boundary node, -inf where there is none, (nb,)."""
    on_edges = np.where(edges, values, -np.inf)
    return np.maximum(on_edges, np.roll(on_edges, 1))


def _bound_for_factor(primal: _Primal, psi: Array, w: Array, s: Array, M: float) -> _ForceBound:
    """The bound from above on J for psi (nb,) and M, made from w (n,) and the nodal flux s (nb, 2)."""
    data = primal.data
    mesh = data.mesh
    form = primal.form
    clamped = form.clamped_edges(mesh)

    # psi - w <= M (v - g) and s <= M sigma; w~ has the flux that is left of s
    w_raised = _raise_to_psi(primal, psi, w, M)
    if w_raised is None:
        return _ForceBound(math.inf, 0.0, np.zeros(len(mesh.triangles)))
    s_left = np.where(form.has_multiplier(mesh.side)[:, None], np.minimum(s, M * primal.sigma), 0.0)
    w_tilde = w
    if primal.flux_equation and not np.array_equal(s, s_left):
        w_tilde = primal.flux_equation.solve(w, edge_load(mesh, s_left))

    # q_w and the residual of w, whose source is 0
    source = zero_source(mesh)
    q_w = equilibrate_source(source, w_tilde, s_left, form)
    residual = residual_parts(source, no_given_flux(mesh), w_raised, q_w, form)
    normal_flux = np.where(clamped[:, None], boundary_end_values(mesh, q_w), s_left)

    # (u_h, w) - (f, w) - <q, w> - <q_w.n, u_h - g>
    estimate = float(primal.residual @ w_raised)
    error = _bound_pairing_error(primal, w_raised)
    gap_pairing, gap_error = _pair_with_gap(primal, normal_flux)
    estimate -= gap_pairing
    growth = (1 + SQUARES_ROUNDING) * mesh.exact_mesh_factor
    upper = estimate + error + gap_error + growth * _bound_residual_of_error(primal, residual) + M * primal.G
    return _ForceBound(upper, estimate, residual.shares())


def _raise_to_psi(primal: _Primal, psi: Array, w: Array, M: float) -> Array | None:
    """w (n,), raised at boundary nodes so that psi - w <= M (v - g); None if it cannot be, beside clamped sides."""
    mesh = primal.data.mesh
    constraint = primal.data.constraint
    on_edges = constraint.edge
    trace = w[mesh.boundary]
    has_multiplier = primal.form.has_multiplier(mesh.side)[on_edges]
    v, _ = constraint.trace_and_slope(primal.v_trace)
    w_values = (
        trace[on_edges][:, None] * (1 - constraint.x) + np.roll(trace, -1)[on_edges][:, None] * constraint.x
    )
    lacking = psi[on_edges][:, None] - w_values

    # M (v - p) is polynomial on each interval, v - g >= v - p - remainder, and v - g >= 0
    size = np.abs(primal.v_trace[constraint.unknowns]).max(axis=1)[on_edges]
    w_size = np.maximum(np.abs(trace), np.abs(np.roll(trace, -1)))[on_edges]
    rounding = BERNSTEIN_ROUNDING * (w_size + np.abs(psi[on_edges]) + M * size)
    without_gap = bernstein_bounds(lacking)[1] + BERNSTEIN_ROUNDING * (w_size + np.abs(psi[on_edges]))
    with_gap = bernstein_bounds(lacking - M * (v - constraint.p))[1] + M * constraint.remainder + rounding
    touching = primal.in_contact & np.roll(primal.in_contact, -1)
    needed = np.where(touching[on_edges], without_gap, np.minimum(without_gap, with_gap))
    raises = np.zeros(len(trace))
    np.maximum.at(raises, on_edges, np.where(has_multiplier, needed, 0.0))
    nodal = np.maximum(raises, np.roll(raises, 1))
    if np.any(nodal[_at_nodes(constraint.clamped_edges)] > 0):
        return None
    raised = w.copy()
    raised[mesh.boundary] += nodal
    return raised


def _pair_with_gap(primal: _Primal, normal_flux: Array) -> tuple[float, float]:
    """<q_w.n, u_h - p> on sides that are not free, and what it may be off <q_w.n, u_h - g>, u_D for g."""
    constraint = primal.data.constraint
    mesh = constraint.mesh
    u_trace = primal.u_h[mesh.boundary]
    start = u_trace[constraint.edge][:, None]
    end = np.roll(u_trace, -1)[constraint.edge][:, None]
    x = constraint.x
    flux = normal_flux[constraint.edge, :1] * (1 - x) + normal_flux[constraint.edge, 1:] * x
    gap = start * (1 - x) + end * x - constraint.p
    sizes = np.abs(constraint.p) + np.abs(start) + np.abs(end)
    error = constraint.edge_integrals(
        np.abs(flux)
        * (constraint.remainder[:, None] + SQUARES_ROUNDING * np.abs(gap) + BERNSTEIN_ROUNDING * sizes)
    )
    changed = mesh.polygon.stretch[mesh.side] * constraint.edge_integrals(np.abs(flux * gap))
    return float(constraint.edge_integrals(flux * gap).sum()), float(error.sum() + changed.sum())


def _bound_pairing_error(primal: _Primal, w: Array) -> float:
    """What `residual` . w may be off (u_h, w) - (f, w) - <q, w> on the exact mesh.

    p - f_h and p - tau~ are orthogonal to w, which is linear on triangles and edges.
    """
    data = primal.data
    mesh = data.mesh
    form = primal.form
    source = data.source
    corners = mesh.triangles
    w_size = np.abs(w[corners]).max(axis=1)
    w_range = np.ptp(w[corners], axis=1)
    hat_gradients = gradients(mesh)
    u_slope = np.linalg.norm(np.einsum("tid,ti->td", hat_gradients, primal.u_h[corners]), axis=1)
    w_slope = np.linalg.norm(np.einsum("tid,ti->td", hat_gradients, w[corners]), axis=1)
    u_size = np.abs(primal.u_h[corners]).max(axis=1)

    # rounding, and what the exact mesh changes of each triangle's part, as in `enclose_total_force`
    changed = SQUARES_ROUNDING + 3 * mesh.distortion
    sizes = form.k * u_slope * w_slope + (form.c * u_size + np.abs(source.f_h).max(axis=1)) * w_size
    error = float((changed * mesh.areas) @ sizes)
    # f - p, and what jumps leave, which has mean 0
    error += float(
        np.sqrt(mesh.areas) @ ((1 + changed) * (source.remainder * w_size + source.jumps * w_range))
    )
    # the given flux: rho, and rounding of tau~
    edge_size = w_size[mesh.boundary_triangles]
    flux = data.given_flux
    flux_sizes = np.diff(mesh.s) * np.abs(flux.end_values).max(axis=1)
    stretch = SQUARES_ROUNDING + mesh.polygon.stretch[mesh.side]
    return error + float(edge_size @ (flux.remainder_integrals + stretch * flux_sizes))


def _bound_residual_of_error(primal: _Primal, residual: ResidualParts) -> float:
    """A bound on |R_w(u - u_h)|: X S_w, where u - u_h vanishes on clamped sides."""
    S_1, S = residual.dual_norms()
    if primal.lift is None:
        return primal.X * S
    # u - u_h = (u - v) + y, and y is bounded in k |y|_1^2 + K ||y||_0^2 for any K > 0
    form = primal.form
    K = max(form.c, form.k / primal.data.mesh.diameter**2)
    S_K, _ = residual._replace(form=form._replace(c=K)).dual_norms()
    lift_norm = math.hypot(
        math.sqrt(form.k) * primal.lift.gradient_norm, math.sqrt(K) * primal.lift.value_norm
    )
    return min(primal.X * S_1, primal.lift.eta * S + S_K * lift_norm)
