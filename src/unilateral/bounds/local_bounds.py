"""The guaranteed total error of a discrete solution by problems on vertex patches.

Theorem 8 of the paper: let sigma >= 0 on sides with contact, and let u_h + d be >= g there and u_D on
clamped sides. With the functional r, the residual of u_h and sigma, with R = ||r||^2 + 2 <sigma, u_h + d - g>
and D = ||d||,

    ||u - u_h||^2 <= R + D^2,    ||lambda - sigma||_{-1/2} <= D + (R + D^2)^{1/2}.

With u_h + d in place of u_h, and 0 in place of d, the second says ||lambda - sigma||_{-1/2} <= eta, whose
square is R for u_h + d; the smaller one is taken.

r is bounded by f~ and tau~, which are near f and the flux tau that is given on free sides (`boundary_flux`).
For q in H(div) with q.n = sigma, and tau~ on free sides,

    ||r|| <= (||grad u_h - q||^2 + ||u_h - f~ - div q||^2)^{1/2} + e,

with e the norm of the functional of f - f~ and tau - tau~. As ((A + e)^2 + B)^{1/2} <= (A^2 + B)^{1/2} + e,
the bounds are those for f~ and tau~ plus e, which is `data` (supplement, S8.1). Those on lambda - sigma bound
the distance of q and the gradient of the solution for f~ and tau~ in L2, too (Proposition S14 there).

f - f~ is what `source` leaves of f and, on each triangle, u_h less its mean. So u_h - f~ - div q is constant
there, and by the div q of `equilibrated` it is the mean of u_h less the potential of q, up to what this one
and lambda_H leave of the discrete equation. For a discrete solution u_h is the potential. d is what
makes u_h feasible (`feasible`); it is 0 but on the triangles at boundary nodes. Nothing is assumed of u_h
and lambda_H. What rounding may have done to the sums over triangles is added to them.

u_h stands for the function with its nodal values on the exact mesh (`geometry.exact_mesh`), a triangulation
of the polygon itself. What that changes of differences is added like rounding, and `growth` has the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array, blocks
from unilateral.bounds.boundary_flux import edge_flux
from unilateral.bounds.clamped_ends import ClampedEnds, clamped_ends, none, outflows
from unilateral.bounds.equilibrated_flux import equilibrated
from unilateral.bounds.feasible import lifting
from unilateral.bounds.flux_residuals import SUMS, defects, misfit, root, underflow
from unilateral.bounds.mesh_data import MeshData
from unilateral.bounds.source import Source, norm
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p2 import Layer, linear_squares, slopes_at_nodes, squares
from unilateral.geometry import exact_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition


@dataclass(frozen=True)
class Bound:
    """Guaranteed bounds on the errors of (u_h, lambda_H), and what they are made of.

    Parameters
    ----------
    u, lambda_
        Bounds on ||u - u_h||_1 and on ||lambda - lambda_H||_{-1/2}.
    lifting, data
        Bounds on ||d||_1, and on what f - f~ and tau - tau~ can add.
    unknown, irreducible
        The part of both bounds that would be 0 if f, g and tau were the polynomials by which they are
        enclosed, and the part of that which hardly falls on finer meshes.
    outflows : (2, sides)
        Those of `clamped_ends`.
    of_fluxes
        A bound on lambda - lambda_H and, on clamped sides, du/dn - q.n, as one functional on H^1: f - f~ and
        tau - tau~ count once more for u - u~. The square of its norm there is |v|_1^2 + ||v||_0^2 / C^2, C
        that of `Form.friedrichs`.
    flux, residual
        Of the cheap bound: ||grad u_h - q|| and ||u_h - f~ - div q||.
    shares : (triangles,)
        Of the cheap bound: the triangles' parts of u^2, which are the squares of flux, residual, lifting and
        data, and 2 <sigma, u_h + d - g>. Their sum is at most u^2 and, but for rounding, at least u^2 / 6.
    lift : (2, boundary edges)
        Of the cheap bound: the coefficients of d at boundary nodes, and of the bubbles of boundary edges.
    ends
        Of the cheap bound: what is known of lambda at the ends of clamped sides.
    eta, steps
        Of the sharp bound: those of v and q, see `sharp_bounds`.
    """

    u: float
    lambda_: float
    lifting: float
    data: float
    unknown: float
    irreducible: float
    outflows: Array
    of_fluxes: float
    flux: float = math.nan
    residual: float = math.nan
    shares: Array = field(default_factory=lambda: np.zeros(0))
    lift: Array = field(default_factory=lambda: np.zeros((2, 0)))
    ends: ClampedEnds = field(default_factory=lambda: none(0))
    eta: float = math.nan
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
    flux = edge_flux(mesh, cells, lambda_H)
    q = flux_of(source, u_h if potential is None else potential, flux.ends + tau.ends, form)
    lift = lifting(data.constraint, u_h, flux)
    *of_boundary, short = lift.lifted(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    of, d = lift.of, lift.of.function(*of_boundary)
    of_gradient, residual, rounding = defects(source, u_h, q, form.c)
    of_d, of_added = of.norms(*d), lift.added(short)
    more = short.norm + root(of_added)
    distance = (1 + SUMS) * (root(of_d) + more)
    unbalanced, residual = of_divergence(form, mesh.areas, residual, rounding, misfit=root(of_gradient))
    inside = of_gradient + mesh.areas * residual**2
    defect, slack = root(inside) + rounding, 2 * short.product
    of_u = (1 + SUMS) * math.hypot(defect, distance, math.sqrt(slack))
    moved = _of_feasible(of, u_h, q, inside, form.c, residual, d)
    eta = (1 + SUMS) * math.hypot(root(moved) + rounding + more, math.sqrt(slack))
    of_data = _of_data(source, u_h, form)
    data_error = (1 + SUMS) * (norm(of_data) + tau.distance + unbalanced) + underflow(mesh, form)
    energy = mesh.growth * (root(moved) + rounding + more + data_error)
    product = slack + (1 + SUMS) * (energy * energy) / 4  # energy**2 would raise what is infinite here
    # v at the boundary nodes may be below u_h where u_h is above u_D
    least = u_h.copy()
    least[mesh.boundary] += np.minimum(of_boundary[0], 0.0)
    ends = clamped_ends(mesh, form, lift, least, flux, product)
    doubt, shares = root(of_added) + tau.unknown, inside + of_data.sum(axis=0)
    shares[of.triangles] += of_d + of_added
    np.add.at(shares, mesh.boundary_triangles, short.squares + 2 * short.slack + tau.squares.sum(axis=0))
    of_lambda = mesh.growth * (min(distance + of_u, eta) + flux.distance(mesh) + data_error)
    return Bound(
        u=mesh.growth * (of_u + data_error),
        lambda_=of_lambda if form.held(mesh.side).any() else 0.0,
        lifting=distance,
        data=data_error,
        unknown=form.value_constant * source.unknown + doubt,
        irreducible=doubt + form.value_constant * source.irreducible,
        flux=root(of_gradient),
        residual=math.sqrt(mesh.areas @ residual**2),
        shares=shares,
        lift=np.stack(of_boundary),
        outflows=outflows(mesh, form, q),
        of_fluxes=of_lambda + mesh.growth * data_error,
        ends=ends,
    )


def flux_of(source: Source, u_h: Array, sigma: Array, form: Form) -> Array:
    """The flux by `equilibrated` with q.n = sigma (nb, 2) on the edges that are not clamped."""
    given = np.where(form.edges(source.mesh)[:, None], math.nan, sigma)
    return equilibrated(source.mesh, form.k * u_h, source.moments, given, form.c / form.k)


def of_divergence(
    form: Form, areas: Array, residual: Array, rounding: float, misfit: float = 0.0
) -> tuple[float, Array]:
    """What a `residual` (m,), u_h - f~ - div q, adds to the data, and what is left of it (m,).

    Beside clamped sides f~ can be taken to be u_h - div q, or -div q without a reaction. The functional of
    what that changes has at most the norm r of the residual times Friedrichs' constant C. With a reaction r
    may as well stay beside the `misfit` M = ||grad u_h - q||, where the square root of M^2 + r^2 is less than
    M + C r.
    """
    C, r = form.value_constant, root(areas * residual**2)
    if form.clamped and (not form.c or (1 - C * C) * r > 2 * C * misfit):
        return C * (r + rounding), np.zeros_like(residual)
    return 0.0, residual


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


def _of_feasible(
    of: Layer, u_h: Array, q: Array, inside: Array, reaction: float, residual: Array, d: tuple[Array, Array]
) -> Array:
    """(m,) ||grad v - q||^2 + ||v - f~ - div q||^2 for v = u_h + d, from that for u_h, `inside`.

    Without a reaction it is the first of both.
    """
    here, (hats, bubbles) = of.triangles, d
    gradient = misfit(of.mesh, u_h, q, here) + slopes_at_nodes(of.slopes, hats, bubbles)
    moved = inside.copy()
    of_values = squares(of.areas, hats + residual[here, None], bubbles)
    moved[here] = linear_squares(of.areas, gradient) + reaction * of_values
    return moved


def _of_data(source: Source, u_h: Array, form: Form) -> Array:
    """(r, m) the squares whose `norm` bounds that of f - f~ as a functional."""
    mesh, squares = source.mesh, np.empty((2 if form.clamped else 1, len(source.f_h)))
    for of in blocks(squares.shape[1]):
        a, b, c = source.f_h[of].T - form.c * u_h.take(mesh.triangles[of].T)
        more = np.sqrt(mesh.areas[of] / 36 * ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2))
        squares[:, of] = source.squares(form, more, of)
    return squares
