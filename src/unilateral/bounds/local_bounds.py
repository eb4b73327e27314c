"""The guaranteed total error of a discrete solution by problems on vertex patches.

Theorem 8 of the paper (`bound_total_errors`): let sigma >= 0 on sides with contact, and let u_h + y be >= g
there and u_D on clamped sides. Let S be a bound on the residual of u_h with sigma in the dual of the energy
norm, B = <sigma, u_h + y - g>, and D the energy norm of y. Then

    ||u - u_h||^2 <= S^2 + 2 B + D^2,    ||lambda - sigma|| <= D + (S^2 + 2 B + D^2)^{1/2}.

With v = u_h + y in place of u_h, and 0 in place of y, the second says ||lambda - sigma||^2 <= S^2 + 2 B;
the smaller one is taken.

S is that of `residual_norm` for a flux q by `equilibrate_flux`. q.n is sigma on these sides, and tau~, near
the given flux, on free ones (`boundary_flux`). What tau~ leaves of that, what the enclosure of f misses
(`source`), and rounding are parts of the residual. y (`feasible`) is 0 but on the triangles at boundary
nodes. Nothing is assumed of u_h and lambda_H.

u_h stands for the function with its nodal values on the exact mesh (`geometry.exact_mesh`). What that changes
of differences is added like rounding, and the rest is in `exact_mesh_factor`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import GivenEdgeFlux, build_normal_flux
from unilateral.bounds.clamped_ends import ClampedEnds, find_clamped_ends, no_clamped_ends, outflows
from unilateral.bounds.constraint import quadratic_lower_bounds
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.equilibrated_flux import equilibrate_flux
from unilateral.bounds.feasible import Lift, build_lifting
from unilateral.bounds.flux_residuals import add_lift_to_residual, residual_parts
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import ResidualBounds, TotalErrors, bound_residual, bound_total_errors
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p2 import BoundaryLayer
from unilateral.geometry import exact_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition


@dataclass(frozen=True)
class Bound:
    """Guaranteed bounds on the errors of (u_h, lambda_H), and what they are made of.

    Parameters
    ----------
    u, lambda_
        Bounds on the energy norm of u - u_h, and on the dual norm of lambda - lambda_H.
    lift_norm
        A bound on the energy norm of y, D.
    data_remainder, irreducible_remainder
        A bound on the part of both that would be 0 if f, g and tau were the polynomials by which they are
        enclosed, and the part of that which hardly falls on finer meshes.
    outflows : (2, sides)
        The integrals of q.n over clamped sides, and those of its size, by `clamped_ends.outflows`.
    reaction_bound
        A bound on lambda - lambda_H and, on clamped sides, k du/dn - q.n, as one functional on H^1, in the
        norm of `ReactionData`.
    eta
        A bound on (S^2 + 2 B)^{1/2} for the v of this bound.
    shares : (triangles,)
        Of the cheap bound: the triangles' parts of S^2 + 2 B + D^2, whose sum is at most that and, but for
        rounding, at least u^2 / 6.
    lift : (2, boundary edges)
        Of the cheap bound: the coefficients of y at boundary nodes, and of the bubbles of boundary edges.
    clamped_ends
        Of the cheap bound: what is known of lambda at the ends of clamped sides.
    steps
        Of the sharp bound: how many steps towards the best v and q were made.
    """

    u: float
    lambda_: float
    lift_norm: float
    data_remainder: float
    irreducible_remainder: float
    outflows: Array
    reaction_bound: float
    eta: float
    shares: Array = field(default_factory=lambda: np.zeros(0))
    lift: Array = field(default_factory=lambda: np.zeros((2, 0)))
    clamped_ends: ClampedEnds = field(default_factory=lambda: no_clamped_ends(0))
    steps: int = 0


def local_bound(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    potential: Array | None = None,
) -> Bound:
    """Bounds for any u_h (n,) in V_h and lambda_H (m,) in Lambda_H, which is 0 on free and on clamped sides.

    The `data` are enclosed for the same form. The flux q is made from the `potential` w (n,), by default u_h.
    Around each node it can only be in equilibrium if w solves the discrete equation with lambda_H. So for a
    u_h of another program w is that solution: q made from u_h would be away from grad u by the residual of
    u_h divided by h. The nearer w and lambda_H are to the discrete solution, the sharper the bounds are.

    Raises InputError if the arrays do not fit the mesh and the cells, or lambda_H is negative somewhere or
    not 0 on such a side.
    """
    mesh = data.mesh
    tau = data.given_flux
    check_discrete_solution(mesh, partition, u_h, lambda_H, form)
    w = u_h if potential is None else potential

    # sigma near lambda_H, and q with q.n = sigma on sides with contact, q.n = tau~ on free ones (F.1)
    sigma = build_normal_flux(mesh, partition, lambda_H, w, form)
    q = equilibrate_source(data.source, w, sigma.end_values + tau.end_values, form)

    # y with u_h + y >= g, D = |||y|||; B = <sigma, u_h + y - g> is its `complementarity`
    lifting = build_lifting(data.constraint, form, u_h, sigma)
    y = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    y_squares = lifting.layer.square_norms(form, *lifting.layer.expand(y.nodal, y.bubbles))
    D = (1 + SQUARES_ROUNDING) * math.sqrt(float(y_squares.sum())) + y.missing_norm

    # S of u_h and of the feasible v = u_h + y (Lemma S12), and Theorem 8 (Proposition S11)
    u_residual, v_residual, S_shares = _bound_residuals(data, u_h, q, lifting.layer, y, form)
    errors = bound_total_errors(
        mesh.exact_mesh_factor,
        u_residual,
        v_residual,
        D=D,
        D_clamped=D,
        sigma_distance=sigma.multiplier_distance(mesh, form),
    )
    v_lower = _bound_lifted_trace(u_h[mesh.boundary], y)
    return replace(
        collect_bounds(data, form, errors, D, y.remainder_norm, outflows(mesh, form, q)),
        shares=_add_lift_shares(S_shares, lifting.layer, y_squares, y, tau, form),
        lift=np.stack([y.nodal, y.bubbles]),
        clamped_ends=find_clamped_ends(mesh, form, lifting, v_lower, sigma, errors.gamma_force_bound),
    )


def _bound_lifted_trace(trace: Array, y: Lift) -> Array:
    """Lower bounds on v = u_h + y over the boundary edges, (nb,), from u_h at the boundary nodes."""
    start = trace + y.nodal
    end = np.roll(start, -1)
    return quadratic_lower_bounds(start, end, middle=0.5 * (start + end) + y.bubbles)


def _bound_residuals(
    data: EnclosedData, u_h: Array, q: Array, layer: BoundaryLayer, y: Lift, form: Form
) -> tuple[ResidualBounds, ResidualBounds, Array]:
    """The bounds on the residuals of u_h and of v = u_h + y with q, and u_h's S^2 by triangles, (m,)."""
    source = data.source
    tau = data.given_flux
    B = y.shortfall.complementarity
    # what tau~ leaves of the given flux; its dual norm is added to S
    tau_error = tau.projection_error(data.mesh, form)
    residual = residual_parts(source, tau, u_h, q, form)
    squares = residual.squares()
    u_residual = bound_residual(residual, tau_error, B, squares)
    S_shares = residual.shares(squares)
    # of v the hats and bubbles of y enter the residual, the norm of what else is in y is added to S; only
    # the triangles of the layer change
    hats, bubbles = layer.expand(y.nodal, y.bubbles)
    add_lift_to_residual(residual, source, tau, u_h, q, layer, hats, bubbles)
    v_squares = squares.copy()
    v_squares[layer.triangles] = residual.squares_on(layer.triangles)
    v_residual = bound_residual(residual, y.missing_norm + tau_error, B, v_squares)
    return u_residual, v_residual, S_shares


def _add_lift_shares(
    S_shares: Array, layer: BoundaryLayer, y_squares: Array, y: Lift, tau: GivenEdgeFlux, form: Form
) -> Array:
    """The triangles' parts (m,) of S^2 + 2 B + D^2, from those of S^2 and the squared norms of y.

    D is the sum of the norms of the three parts of y; here their squares are added, at least a third of D^2.
    """
    mesh = layer.mesh
    shares = S_shares.copy()
    shares[layer.triangles] += y_squares + y.remainder_squares
    complementarity = 2 * y.shortfall.edge_complementarity
    edge_shares = y.shortfall.extension_squares + complementarity + tau.shares(mesh, form)
    np.add.at(shares, mesh.boundary_triangles, edge_shares)
    return shares


def collect_bounds(
    data: EnclosedData, form: Form, errors: TotalErrors, D: float, remainder_norm: float, outflows: Array
) -> Bound:
    """The Bound of these total errors.

    `remainder_norm` is the energy norm of the hats that are in y for the remainder of g.
    """
    # polynomials enclose g and tau once for a problem, whatever the mesh: no finer mesh brings them nearer.
    # Those of f do come nearer if f is resolved; what they leave counts times W, where ||z||_0 <= W |||z|||
    remainder = remainder_norm + data.given_flux.remainder_dual_norm(data.mesh, form)
    W = form.value_constant
    return Bound(
        u=errors.u,
        # without a side for contact lambda is 0
        lambda_=errors.lambda_ if form.has_multiplier(data.mesh.side).any() else 0.0,
        lift_norm=D,
        data_remainder=W * data.source.remainder_norm + remainder,
        irreducible_remainder=remainder + W * data.source.irreducible_remainder,
        outflows=outflows,
        reaction_bound=errors.reaction_bound,
        eta=errors.eta,
    )


def equilibrate_source(source: Source, u_h: Array, sigma: Array, form: Form) -> Array:
    """The flux by `equilibrate_flux` with q.n = sigma (nb, 2) on the edges that are not clamped."""
    normal_flux = np.where(form.clamped_edges(source.mesh)[:, None], math.nan, sigma)
    return equilibrate_flux(source.mesh, u_h, source.moments, normal_flux, form)


def check_discrete_solution(
    mesh: Mesh, partition: Partition, u_h: Array, lambda_H: Array, form: Form
) -> None:
    """Raises InputError unless u_h is in V_h, lambda_H in Lambda_H, lambda_H >= 0, and 0 where it has to be.

    It is raised, too, where the mesh is too far from the exact one.
    """
    if not np.array_equal(mesh.polygon.vertices, partition.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    exact_mesh.check_distortion(mesh.polygon, mesh.points, mesh.triangles, mesh.distortion)
    for name, values, n in (("u_h", u_h, mesh.n_nodes), ("lambda_H", lambda_H, partition.n_cells)):
        if np.shape(values) != (n,) or not np.all(np.isfinite(values)):
            raise InputError(f"{name} must hold {n} finite numbers; it has the shape {np.shape(values)}")
    if np.min(lambda_H) < 0:
        raise InputError(f"lambda_H has the value {np.min(lambda_H):.4g}; it must not be negative")
    cells = np.flatnonzero(~form.has_multiplier(partition.side) & (lambda_H > 0))
    if cells.size:
        raise InputError(
            f"lambda_H is not 0 on side {partition.side[cells[0]]}, which has no contact; it must be 0 there"
        )
