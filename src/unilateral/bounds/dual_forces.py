"""The force over a part of the boundary between two numbers whose distance falls like a product of errors.

P is a set of sides, and J the integral of lambda over those with contact, plus that of k du/dn over clamped
ones. X bounds |||u - u_h|||, v is the feasible function of `local_bounds`, R its residual with sigma. Since

    |||u - v|||^2 + <lambda, v - g> + <sigma, u - g> = R(u - v) + <sigma, v - g>,

<lambda, v - g> and <sigma, u - g> together are at most G = B + S^2 / 4. Let psi be 1 on P and 0 on the other
sides. Let w in V_h be psi on clamped sides, M >= 0, and q_w a flux with q_w.n = 0 on free sides and s = q_w.n
on those with contact, so that on these

    psi - w <= M (v - g),     s <= M sigma.

Let S_w bound the residual R_w(z) = (q_w - k grad w, grad z) + (div q_w - c w, z). By (1.1)

    J <= (u_h, w) - (f, w) - <q, w> - <q_w.n, u_h - g> + X S_w + M G,

where (u_h, w) is the form, q the given flux, and u_D stands for g on clamped sides. With -psi in the place of
psi it is a bound from below (supplement, Proposition S22). X S_w is a product of two errors, and G ~ X^2.

w is psi in contact, discretely harmonic elsewhere, and raised where v - g is too small for it. q_w is made by
`equilibrate_flux` from w~ in V_h, which has the nodal flux s of w in contact, less what exceeds M sigma. For
the bound from below M = 0 will do, as w <= 1 and s >= 0 by the maximum principle. For the one from above s is
too large and w too small beside an end of contact, and what is changed of them leaves S_w ~ M^{-1/2} there.
With X ~ h and G ~ h^2 the best M ~ h^{-2/3} makes the distance h^{4/3}. Without an end of contact it is h^2.
Nothing is assumed of w, w~ and M.
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
from unilateral.bounds.feasible import Lift, Lifting, build_lifting
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

FIRST_FACTOR_SHARE = 1 / 16
FACTOR_STEP = 4.0
MAX_FACTOR_STEPS = 8
"""The search for the best M begins where M G is the first times X |||w|||, and goes on by the second.

Only the sharpness of the bounds depends on these numbers.
"""


class ForceInterval(NamedTuple):
    """A value of the force, two numbers between which it lies, and the parts (m,) of triangles in both.

    The sum of the `shares` is 2.
    """

    value: float
    lower: float
    upper: float
    shares: Array


class _Equation(NamedTuple):
    """The equations (w, phi_i) = load_i at the `free` nodes (n,), and the factors of their matrix."""

    matrix: sp.csr_array
    free: Mask
    factors: SparseFactors

    def solve(self, values: Array, load: Array) -> Array:
        """The solution (n,) for this load (n,) that has these values (n,) at the nodes that are not free."""
        w = np.where(self.free, 0.0, values)
        w[self.free] = self.factors.solve((load - self.matrix @ w)[self.free])
        return w


class _LiftNorms(NamedTuple):
    """Bounds on |||u - v|||, and on |y|_1 and ||y||_0 for y = v - u_h."""

    eta: float
    gradient_norm: float
    value_norm: float


class _Primal(NamedTuple):
    """What the bounds need of (u_h, lambda_H), whatever the sides are.

    `residual` (n,) is (u_h, phi_i) - (f, phi_i) - <q, phi_i>. v has at least the values `v_trace` (2 nb,) at
    the unknowns of P2 on the boundary, but on edges between two nodes `in_contact` (nb,) it is only known
    that v >= g. sigma has the values `sigma` (nb, 2) at the ends of edges. `lift` is None where u_h is u_D on
    clamped sides. What raises w solves the `trace_equation`, given on the boundary; w solves the
    `contact_equation`, given in contact and on clamped sides, and w~ the `flux_equation`, given on clamped
    sides. The last two are None where they would not determine constants.
    """

    data: EnclosedData
    form: Form
    u_h: Array
    matrix: sp.csr_array
    residual: Array
    v_trace: Array
    in_contact: Mask
    sigma: Array
    X: float
    G: float
    lift: _LiftNorms | None
    trace_equation: _Equation
    contact_equation: _Equation | None
    flux_equation: _Equation | None


class _ForceBound(NamedTuple):
    """A bound from above on J for psi and M, the number near J in it, and the parts (m,) of S_w^2."""

    M: float
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
    """The force over `sides`, with the reactions on clamped ones, by the cheap `bound` on (u_h, lambda_H).

    Clamped sides in a row are all in `sides`, or none. Where nothing is known the interval is infinite.
    """
    primal = _collect_primal(data, partition, u_h, lambda_H, form, bound)
    on_P = np.isin(data.mesh.side, [*sides]) & ~np.isin(data.mesh.side, form.free)
    above = _bound_from_above(primal, on_P.astype(float))
    below = _bound_from_above(primal, -on_P.astype(float))
    # lambda is not negative
    lower = -below.upper if {*sides} & {*form.clamped} else max(-below.upper, 0.0)
    upper = max(above.upper, lower)
    value = min(max(0.5 * (above.estimate - below.estimate), lower), upper)
    # X S_w is a product of roots of sums over triangles: in each sum a triangle counts by its fraction
    shares = _normalise(bound.shares) + 0.5 * (_normalise(above.shares) + _normalise(below.shares))
    return ForceInterval(value, lower, upper, shares)


def _normalise(shares: Array) -> Array:
    """The shares (m,) over their sum, 0 if all are."""
    return np.asarray(shares / max(float(shares.sum()), np.finfo(float).tiny))


def _collect_primal(
    data: EnclosedData, partition: Partition, u_h: Array, lambda_H: Array, form: Form, bound: Bound
) -> _Primal:
    """The `_Primal` of a solution, with the v and sigma of `local_bound`."""
    mesh = data.mesh
    sigma = build_normal_flux(mesh, partition, lambda_H, u_h, form)
    lifting = build_lifting(data.constraint, form, u_h, sigma)
    y = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    # at clamped nodes v may be lower by what is not known of u_D
    v = u_h[mesh.boundary] + y.nodal - y.shortfall.nodal_change
    at_clamped = _at_nodes(form.clamped_edges(mesh))
    in_contact = lifting.contact[: len(v)] & _at_nodes(form.has_multiplier(mesh.side)) & ~at_clamped
    fixed = in_contact | at_clamped
    matrix = form_matrix(mesh, form._replace(clamped=()))
    return _Primal(
        data,
        form,
        u_h,
        matrix,
        residual=matrix @ u_h - data.load,
        v_trace=np.concatenate([v, 0.5 * (v + np.roll(v, -1)) + y.bubbles]),
        in_contact=in_contact,
        sigma=sigma.end_values,
        X=bound.u,
        G=(1 + SQUARES_ROUNDING) * bound.clamped_ends.gamma_force_bound,
        lift=_bound_lift(lifting, y, bound),
        trace_equation=_factorise_equation(mesh, matrix, np.ones_like(fixed)),
        contact_equation=_factorise_equation(mesh, matrix, fixed) if form.c or fixed.any() else None,
        flux_equation=_factorise_equation(mesh, matrix, at_clamped) if form.c or at_clamped.any() else None,
    )


def _at_nodes(edges: Mask) -> Mask:
    """Which boundary nodes (nb,) are ends of these boundary edges (nb,)."""
    return edges | np.roll(edges, 1)


def _bound_lift(lifting: Lifting, y: Lift, bound: Bound) -> _LiftNorms | None:
    """Norms of y, None if it is 0 on clamped sides."""
    constraint = lifting.constraint
    edges = constraint.clamped_edges
    shortfall = y.shortfall
    on_clamped = (y.nodal[_at_nodes(edges)], y.bubbles[edges], shortfall.extension_squares[edges])
    if not any(np.any(values) for values in (*on_clamped, shortfall.nodal_change)):
        return None
    # ||.||_0 of hats and bubbles, of extensions, at most half their height times |.|_1, and of hats for g
    values_only = Form(k=np.finfo(float).tiny, c=1.0)
    root_k = math.sqrt(lifting.form.k)
    mesh = constraint.mesh
    value_norm = (
        lifting.layer.norm(values_only, y.nodal, y.bubbles)
        + 0.5 * mesh.diameter * shortfall.extension_norm / root_k
        + math.sqrt(float(mesh.areas.sum())) * float(np.max(shortfall.nodal_raise + shortfall.nodal_change))
    )
    return _LiftNorms(bound.eta, bound.lift_norm / root_k, value_norm)


def _factorise_equation(mesh: Mesh, matrix: sp.csr_array, fixed: Mask) -> _Equation:
    """The equation for functions that are given at the boundary nodes `fixed` (nb,)."""
    free = np.ones(mesh.n_nodes, dtype=bool)
    free[mesh.boundary[fixed]] = False
    return _Equation(matrix, free, factorise_by_dissection(matrix[free][:, free].tocsr()))


def _bound_from_above(primal: _Primal, psi: Array) -> _ForceBound:
    """The least bound on J for psi (nb,) on the boundary edges, among those for some M."""
    w, s = _extend_from_contact(primal, psi)
    best = _bound_for_factor(primal, psi, w, s, 0.0)
    if not primal.G > 0:
        return best
    first_factor = FIRST_FACTOR_SHARE * primal.X * energy_norm(primal.data.mesh, w, primal.form) / primal.G
    # from the first M up, and from the one below down, as long as the bound falls; then between the best two
    for step, start in ((FACTOR_STEP, 0), (1 / FACTOR_STEP, 1)):
        last = math.inf
        for k in range(start, MAX_FACTOR_STEPS):
            force_bound = _bound_for_factor(primal, psi, w, s, first_factor * step**k)
            best = min(best, force_bound, key=lambda candidate: candidate.upper)
            if last <= force_bound.upper < math.inf:
                break
            last = force_bound.upper
    for step in (math.sqrt(FACTOR_STEP), 1 / math.sqrt(FACTOR_STEP)) if best.M > 0 else ():
        between = _bound_for_factor(primal, psi, w, s, best.M * step)
        best = min(best, between, key=lambda candidate: candidate.upper)
    return best


def _extend_from_contact(primal: _Primal, psi: Array) -> tuple[Array, Array]:
    """w (n,), psi in contact and discretely harmonic elsewhere, and its nodal flux s (nb, 2) in contact."""
    mesh = primal.data.mesh
    form = primal.form
    clamped = form.clamped_edges(mesh)
    has_multiplier = form.has_multiplier(mesh.side)
    at_clamped = _at_nodes(clamped)
    # at a node the larger psi of both edges counts, and on clamped sides theirs
    values = np.where(at_clamped, _largest_at_nodes(psi, clamped), _largest_at_nodes(psi, has_multiplier))
    fixed = at_clamped | primal.in_contact
    w = np.full(mesh.n_nodes, psi.max())
    w[mesh.boundary[fixed]] = values[fixed]
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


def _largest_at_nodes(values: Array, edges: Mask) -> Array:
    """The largest value (nb,) of these edges at each boundary node, -inf where there is none, (nb,)."""
    on_edges = np.where(edges, values, -np.inf)
    return np.maximum(on_edges, np.roll(on_edges, 1))


def _bound_for_factor(primal: _Primal, psi: Array, w: Array, s: Array, M: float) -> _ForceBound:
    """The bound from above on J for psi (nb,) and M, from w (n,) and its nodal flux s (nb, 2)."""
    data = primal.data
    mesh = data.mesh
    form = primal.form
    # psi - w <= M (v - g), s <= M sigma
    raised = _raise_to_psi(primal, psi, w, M)
    if raised is None:
        return _ForceBound(M, math.inf, 0.0, np.zeros(len(mesh.triangles)))
    has_multiplier = form.has_multiplier(mesh.side)
    s_left = np.where(has_multiplier[:, None], np.minimum(s, M * primal.sigma), 0.0)
    w_tilde = w
    if primal.flux_equation and not np.array_equal(s, s_left):
        w_tilde = primal.flux_equation.solve(w, edge_load(mesh, s_left))

    # q_w and the residual R_w
    no_source = zero_source(mesh)
    q_w = equilibrate_source(no_source, w_tilde, s_left, form)
    residual = residual_parts(no_source, no_given_flux(mesh), raised, q_w, form)
    clamped = form.clamped_edges(mesh)
    normal_flux = np.where(clamped[:, None], boundary_end_values(mesh, q_w), s_left)

    # (u_h, w) - (f, w) - <q, w> - <q_w.n, u_h - g> + X S_w + M G
    gap_pairing, gap_error = _pair_with_gap(primal, normal_flux)
    estimate = float(primal.residual @ raised) - gap_pairing
    error = _bound_pairing_error(primal, raised) + gap_error
    upper = estimate + error + _bound_error_residual(primal, residual) + M * primal.G
    return _ForceBound(M, upper, estimate, residual.shares())


def _raise_to_psi(primal: _Primal, psi: Array, w: Array, M: float) -> Array | None:
    """w (n,), raised at boundary nodes for psi - w <= M (v - g); None if a clamped node would be raised."""
    mesh = primal.data.mesh
    constraint = primal.data.constraint
    edge = constraint.edge
    trace = w[mesh.boundary]
    ends = np.column_stack([trace, np.roll(trace, -1)])[edge]
    lacking = psi[edge, None] - ends[:, :1] * (1 - constraint.x) - ends[:, 1:] * constraint.x
    rounding = BERNSTEIN_ROUNDING * (np.abs(ends).max(axis=1) + np.abs(psi[edge]))
    without_gap = bernstein_bounds(lacking)[1] + rounding

    # v - g is at least v - p - remainder, and on all edges at least 0
    v, _ = constraint.trace_and_slope(primal.v_trace)
    v_rounding = BERNSTEIN_ROUNDING * np.abs(primal.v_trace[constraint.unknowns]).max(axis=1)[edge]
    with_gap = bernstein_bounds(lacking - M * (v - constraint.p))[1] + rounding
    with_gap += M * (constraint.remainder + v_rounding)
    touching = (primal.in_contact & np.roll(primal.in_contact, -1))[edge]
    needed = np.where(touching, without_gap, np.minimum(without_gap, with_gap))
    raises = np.zeros(len(trace))
    np.maximum.at(raises, edge, np.where(primal.form.has_multiplier(mesh.side)[edge], needed, 0.0))

    # both ends of an edge by what is needed on it
    nodal_raise = np.maximum(raises, np.roll(raises, 1))
    if np.any(nodal_raise[_at_nodes(constraint.clamped_edges)] > 0):
        return None
    raise_values = np.zeros_like(w)
    raise_values[mesh.boundary] = nodal_raise
    return w + primal.trace_equation.solve(raise_values, np.zeros_like(w))


def _pair_with_gap(primal: _Primal, normal_flux: Array) -> tuple[float, float]:
    """<q_w.n, u_h - p> on sides that are not free, and a bound on its distance from <q_w.n, u_h - g>.

    q_w.n has the values `normal_flux` (nb, 2) at the ends of edges. On clamped sides p is near u_D.
    """
    constraint = primal.data.constraint
    mesh = constraint.mesh
    trace = primal.u_h[mesh.boundary]
    ends = np.column_stack([trace, np.roll(trace, -1)])[constraint.edge]
    end_flux = normal_flux[constraint.edge]
    x = constraint.x
    u_h = ends[:, :1] * (1 - x) + ends[:, 1:] * x
    flux = end_flux[:, :1] * (1 - x) + end_flux[:, 1:] * x
    gap = u_h - constraint.p
    # rounding, the remainder of g, and what the exact mesh changes of lengths
    sizes = np.abs(constraint.p) + np.abs(ends).sum(axis=1, keepdims=True)
    gap_error = constraint.remainder[:, None] + BERNSTEIN_ROUNDING * sizes + SQUARES_ROUNDING * np.abs(gap)
    error = constraint.edge_integrals(np.abs(flux) * gap_error)
    error += mesh.polygon.stretch[mesh.side] * constraint.edge_integrals(np.abs(flux * gap))
    return float(constraint.edge_integrals(flux * gap).sum()), (1 + SQUARES_ROUNDING) * float(error.sum())


def _bound_pairing_error(primal: _Primal, w: Array) -> float:
    """A bound on the distance of residual . w from (u_h, w) - (f, w) - <q, w> on the exact mesh, for w (n,).

    p - f_h and p - tau~ are orthogonal to w, which is linear on triangles and on edges.
    """
    data = primal.data
    mesh = data.mesh
    source = data.source
    u_at_corners = primal.u_h[mesh.triangles]
    w_at_corners = w[mesh.triangles]
    w_size = np.abs(w_at_corners).max(axis=1)
    hat_gradients = gradients(mesh)
    u_slope = np.linalg.norm(np.einsum("tid,ti->td", hat_gradients, u_at_corners), axis=1)
    w_slope = np.linalg.norm(np.einsum("tid,ti->td", hat_gradients, w_at_corners), axis=1)

    # rounding, and what the exact mesh changes of each triangle's part, as in `enclose_total_force`
    changed = SQUARES_ROUNDING + 3 * mesh.distortion
    value_sizes = primal.form.c * np.abs(u_at_corners).max(axis=1) + np.abs(source.f_h).max(axis=1)
    error = float((changed * mesh.areas) @ (primal.form.k * u_slope * w_slope + value_sizes * w_size))
    # what f leaves of its polynomials: E_T ||w||_T, and for jumps, with mean 0, ||w - mean w||_T
    w_range = np.ptp(w_at_corners, axis=1)
    leftover = source.remainder * w_size + source.jumps * w_range
    error += float(((1 + changed) * np.sqrt(mesh.areas)) @ leftover)
    # rho of the given flux, and its rounding
    flux = data.given_flux
    flux_size = np.diff(mesh.s) * np.abs(flux.end_values).max(axis=1)
    flux_error = flux.remainder_integrals + (SQUARES_ROUNDING + mesh.polygon.stretch[mesh.side]) * flux_size
    return error + float(w_size[mesh.boundary_triangles] @ flux_error)


def _bound_error_residual(primal: _Primal, residual: ResidualParts) -> float:
    """A bound on |R_w(u - u_h)|: X S_w where u - u_h vanishes on clamped sides."""
    growth = (1 + SQUARES_ROUNDING) * primal.data.mesh.exact_mesh_factor
    S_1, S = residual.dual_norms()
    if primal.lift is None:
        return growth * primal.X * S
    # u - u_h = (u - v) + y; y has the norm of k |y|_1^2 + K ||y||_0^2, for any K > 0
    form = primal.form
    K = max(form.c, form.k / primal.data.mesh.diameter**2)
    S_K, _ = residual._replace(form=form._replace(c=K)).dual_norms()
    y_norm = math.hypot(math.sqrt(form.k) * primal.lift.gradient_norm, math.sqrt(K) * primal.lift.value_norm)
    return growth * min(primal.X * S_1, primal.lift.eta * S + S_K * y_norm)
