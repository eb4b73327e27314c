"""The guaranteed total error of a discrete solution by problems on vertex patches.

Theorem 8 of the paper (`bound_total_errors`): let sigma >= 0 on sides with contact, and let u_h + y be >= g
there and u_D on clamped sides. Let S be a bound on the residual of u_h with sigma in the dual of the energy
norm, B = <sigma, u_h + y - g>, and D the energy norm of y. Then

    ||u - u_h||^2 <= S^2 + 2 B + D^2,    ||lambda - sigma|| <= D + (S^2 + 2 B + D^2)^{1/2}.

With v = u_h + y in place of u_h, and 0 in place of y, the second says ||lambda - sigma||^2 <= S^2 + 2 B;
the smaller one is taken.

S is that of `residual_norm` for a flux q with q.n = sigma on these sides, made by `equilibrate_flux` with the
flux tau~ near the one that is given on free sides (`boundary_flux`). What tau~ leaves of that, what the
enclosure of f misses (`source`), and what rounding may have done on a triangle are parts of the residual. y
is what makes u_h feasible (`shift_to_feasible`); it is 0 but on the triangles at boundary nodes. Nothing is
assumed of u_h and lambda_H.

u_h stands for the function with its nodal values on the exact mesh (`geometry.exact_mesh`), a triangulation
of the polygon itself. What that changes of differences is added like rounding, and `growth` has the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import build_normal_flux
from unilateral.bounds.clamped_ends import ClampedEnds, find_clamped_ends, no_clamped_ends, outflows
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.equilibrated_flux import equilibrate_flux
from unilateral.bounds.feasible import build_lifting
from unilateral.bounds.flux_residuals import add_lift_to_residual, residual_parts
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, underflow_allowance
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import bound_residual, bound_total_errors
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.geometry import exact_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition


@dataclass(frozen=True)
class Bound:
    """Guaranteed bounds on the errors of (u_h, lambda_H), and what they are made of.

    Parameters
    ----------
    u, lambda_
        Bounds on the energy norm of u - u_h, and on its dual norm of lambda - lambda_H.
    lifting
        A bound on the energy norm of y.
    unknown, irreducible
        A bound on the part of both that would be 0 if f, g and tau were the polynomials by which they are
        enclosed, and the part of that which hardly falls on finer meshes.
    outflows : (2, sides)
        Those of `find_clamped_ends`.
    of_fluxes
        A bound on lambda - lambda_H and, on clamped sides, k du/dn - q.n, as one functional on H^1, in the
        norm of `ReactionData`.
    eta
        That of `bound_total_errors`, for the v of this bound.
    shares : (triangles,)
        Of the cheap bound: the triangles' parts of S^2 + 2 B + D^2. Their sum is at most that and, but for
        rounding, at least u^2 / 6.
    lift : (2, boundary edges)
        Of the cheap bound: the coefficients of y at boundary nodes, and of the bubbles of boundary edges.
    ends
        Of the cheap bound: what is known of lambda at the ends of clamped sides.
    steps
        Of the sharp bound: those of v and q, see `sharp_bounds`.
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

    On the free ones the flux is that of the `data`, which are enclosed for the same form. The flux q is made
    from the `potential` (n,), by default u_h. Around each node it can only be in equilibrium if the potential
    solves the discrete equation with lambda_H. So for a u_h of another program the potential is that
    solution: q made from u_h itself would be away from grad u by the residual of u_h divided by h.

    The nearer the potential and lambda_H are to the discrete solution, the sharper the bounds are. Raises
    InputError if the arrays do not fit the mesh and the cells, or lambda_H is negative somewhere or not 0 on
    such a side.
    """
    mesh = data.mesh
    source = data.source
    tau = data.given_flux
    check_discrete_solution(mesh, partition, u_h, lambda_H, form)
    w = u_h if potential is None else potential
    flux = build_normal_flux(mesh, partition, lambda_H, w, form)
    q = equilibrate_source(source, w, flux.end_values + tau.end_values, form)

    # y, and what is missing of u_h + y >= g; D = ||y||, B = <sigma, u_h + y - g>
    lift = build_lifting(data.constraint, form, u_h, flux)
    layer = lift.layer
    nodal, edges, short = lift.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    hats, bubbles = layer.function(nodal, edges)
    of_y = layer.square_norms(form, hats, bubbles)
    of_added = lift.remainder_squares(short)
    added = math.sqrt(float(of_added.sum()))
    missing = (1 + SQUARES_ROUNDING) * (short.extension_norm + added) + underflow_allowance(mesh, form)
    D = (1 + SQUARES_ROUNDING) * math.sqrt(float(of_y.sum())) + missing

    # the residuals of u_h and of the feasible v = u_h + y, and the norm of what tau~ leaves of tau
    of_tau = tau.projection_error(mesh, form)
    parts = residual_parts(source, tau, u_h, q, form)
    of_u = bound_residual(parts, of_tau, short.complementarity)
    shares = parts.shares()
    add_lift_to_residual(parts, source, tau, u_h, q, layer, hats, bubbles)
    of_v = bound_residual(parts, missing + of_tau, short.complementarity)
    errors = bound_total_errors(
        mesh.exact_mesh_factor,
        of_u,
        of_v,
        D=D,
        D_clamped=D,
        sigma_distance=flux.multiplier_distance(mesh, form),
    )

    # v at the boundary nodes may be below u_h where u_h is above u_D
    least = u_h.copy()
    least[mesh.boundary] += np.minimum(nodal, 0.0)
    ends = find_clamped_ends(mesh, form, lift, least, flux, errors.gamma_force_bound)

    doubt = added + tau.remainder_dual_norm(mesh, form)
    shares[layer.triangles] += of_y + of_added
    on_edges = short.extension_squares + 2 * short.edge_complementarity + tau.shares(mesh, form)
    np.add.at(shares, mesh.boundary_triangles, on_edges)
    return Bound(
        u=errors.u,
        lambda_=errors.lambda_ if form.has_multiplier(mesh.side).any() else 0.0,
        lift_norm=D,
        data_remainder=form.value_constant * source.remainder_norm + doubt,
        irreducible_remainder=doubt + form.value_constant * source.irreducible_remainder,
        outflows=outflows(mesh, form, q),
        reaction_bound=errors.reaction_bound,
        eta=errors.eta,
        shares=shares,
        lift=np.stack([nodal, edges]),
        clamped_ends=ends,
    )


def equilibrate_source(source: Source, u_h: Array, sigma: Array, form: Form) -> Array:
    """The flux by `equilibrate_flux` with q.n = sigma (nb, 2) on the edges that are not clamped."""
    given = np.where(form.clamped_edges(source.mesh)[:, None], math.nan, sigma)
    return equilibrate_flux(source.mesh, u_h, source.moments, given, form)


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
    at = np.flatnonzero(~form.has_multiplier(partition.side) & (lambda_H > 0))
    if at.size:
        raise InputError(
            f"lambda_H is not 0 on side {partition.side[at[0]]}, which has no contact; it must be"
        )
