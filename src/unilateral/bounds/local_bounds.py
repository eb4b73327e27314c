"""The guaranteed total error of a discrete solution by problems on vertex patches.

Theorem 8 of the paper (`total_errors`): let sigma >= 0 on sides with contact, and let u_h + y be >= g there
and u_D on clamped sides. Let S be a bound on the residual of u_h with sigma in the dual of the energy norm,
B = <sigma, u_h + y - g>, and D the energy norm of y. Then

    ||u - u_h||^2 <= S^2 + 2 B + D^2,    ||lambda - sigma|| <= D + (S^2 + 2 B + D^2)^{1/2}.

With v = u_h + y in place of u_h, and 0 in place of y, the second says ||lambda - sigma||^2 <= S^2 + 2 B;
the smaller one is taken.

S is that of `residual_norm` for a flux q with q.n = sigma on these sides, made by `equilibrated` with the
flux tau~ near the one that is given on free sides (`boundary_flux`). What tau~ leaves of that, what the
enclosure of f misses (`source`), and what rounding may have done on a triangle are parts of the residual.
y is what makes u_h feasible (`feasible`); it is 0 but on the triangles at boundary nodes. Nothing is assumed
of u_h and lambda_H.

u_h stands for the function with its nodal values on the exact mesh (`geometry.exact_mesh`), a triangulation
of the polygon itself. What that changes of differences is added like rounding, and `growth` has the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import edge_flux
from unilateral.bounds.clamped_ends import ClampedEnds, clamped_ends, none, outflows
from unilateral.bounds.equilibrated_flux import equilibrated
from unilateral.bounds.feasible import lifting
from unilateral.bounds.flux_residuals import move_parts, residual_parts
from unilateral.bounds.mesh_data import MeshData
from unilateral.bounds.residual_norm import SUMS, underflow
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import defect, total_errors
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
        Those of `clamped_ends`.
    of_fluxes
        A bound on lambda - lambda_H and, on clamped sides, k du/dn - q.n, as one functional on H^1, in the
        norm of `Clamps`.
    eta
        That of `total_errors`, for the v of this bound.
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
    lifting: float
    unknown: float
    irreducible: float
    outflows: Array
    of_fluxes: float
    eta: float
    shares: Array = field(default_factory=lambda: np.zeros(0))
    lift: Array = field(default_factory=lambda: np.zeros((2, 0)))
    ends: ClampedEnds = field(default_factory=lambda: none(0))
    steps: int = 0


def local_bound(
    data: MeshData,
    cells: Partition,
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
    tau = data.tau
    check(mesh, cells, u_h, lambda_H, form)
    w = u_h if potential is None else potential
    flux = edge_flux(mesh, cells, lambda_H, w, form)
    q = flux_of(source, w, flux.ends + tau.ends, form)

    # y, and what is missing of u_h + y >= g; D = ||y||, B = <sigma, u_h + y - g>
    lift = lifting(data.constraint, form, u_h, flux)
    layer = lift.of
    nodal, edges, short = lift.lifted(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    hats, bubbles = layer.function(nodal, edges)
    of_y = layer.squares(form, hats, bubbles)
    of_added = lift.added(short)
    added = math.sqrt(float(of_added.sum()))
    missing = (1 + SUMS) * (short.norm + added) + underflow(mesh, form)
    D = (1 + SUMS) * math.sqrt(float(of_y.sum())) + missing

    # the residuals of u_h and of the feasible v = u_h + y, and the norm of what tau~ leaves of tau
    of_tau = tau.distance(mesh, form)
    parts = residual_parts(source, tau, u_h, q, form)
    of_u = defect(parts, of_tau, short.product)
    shares = parts.shares()
    move_parts(parts, source, tau, u_h, q, layer, hats, bubbles)
    of_v = defect(parts, missing + of_tau, short.product)
    errors = total_errors(mesh.growth, of_u, of_v, D=D, D_clamped=D, of_sigma=flux.distance(mesh, form))

    # v at the boundary nodes may be below u_h where u_h is above u_D
    least = u_h.copy()
    least[mesh.boundary] += np.minimum(nodal, 0.0)
    ends = clamped_ends(mesh, form, lift, least, flux, errors.product)

    doubt = added + tau.unknown(mesh, form)
    shares[layer.triangles] += of_y + of_added
    on_edges = short.squares + 2 * short.slack + tau.shares(mesh, form)
    np.add.at(shares, mesh.boundary_triangles, on_edges)
    return Bound(
        u=errors.u,
        lambda_=errors.lambda_ if form.held(mesh.side).any() else 0.0,
        lifting=D,
        unknown=form.value_constant * source.unknown + doubt,
        irreducible=doubt + form.value_constant * source.irreducible,
        outflows=outflows(mesh, form, q),
        of_fluxes=errors.fluxes,
        eta=errors.eta,
        shares=shares,
        lift=np.stack([nodal, edges]),
        ends=ends,
    )


def flux_of(source: Source, u_h: Array, sigma: Array, form: Form) -> Array:
    """The flux by `equilibrated` with q.n = sigma (nb, 2) on the edges that are not clamped."""
    given = np.where(form.edges(source.mesh)[:, None], math.nan, sigma)
    return equilibrated(source.mesh, u_h, source.moments, given, form)


def check(mesh: Mesh, cells: Partition, u_h: Array, lambda_H: Array, form: Form) -> None:
    """Raises InputError unless u_h is in V_h, lambda_H in Lambda_H, lambda_H >= 0, and 0 where it has to be.

    It is raised, too, where the mesh is too far from the exact one.
    """
    if not np.array_equal(mesh.polygon.vertices, cells.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    exact_mesh.check(mesh.polygon, mesh.points, mesh.triangles, mesh.distortion)
    for name, values, n in (("u_h", u_h, mesh.n_nodes), ("lambda_H", lambda_H, cells.n_cells)):
        if np.shape(values) != (n,) or not np.all(np.isfinite(values)):
            raise InputError(f"{name} must hold {n} finite numbers; it has the shape {np.shape(values)}")
    if np.min(lambda_H) < 0:
        raise InputError(f"lambda_H has the value {np.min(lambda_H):.4g}; it must not be negative")
    at = np.flatnonzero(~form.held(cells.side) & (lambda_H > 0))
    if at.size:
        raise InputError(f"lambda_H is not 0 on side {cells.side[at[0]]}, which has no contact; it must be")
