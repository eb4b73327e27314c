"""How a P2 function v is made to satisfy v >= g on the boundary, and what is still missing then.

g is within `doubt` of a continuous piecewise polynomial p (`Obstacle`). v is raised to p at the nodes and
midpoints of the boundary edges, or at a midpoint above p. On an edge where v is in contact r = p - v is left,
of any sign, elsewhere r = (p - v)_+, p there less its rounding; both vanish at the edge's ends. The extension
w of r into a triangle T at the edge e, homogeneous of degree 1 about the vertex off e, vanishes on the
other edges of T. With l the height of T over e and x the foot of that vertex on e,

    |w|_{1,T}^2 = (l ||r'||_e^2 + (||(s - x) r'||_e^2 + 2 ||r||_e^2) / l) / 2,   ||w||_T^2 = l ||r||_e^2 / 4,

for w(x + t (s - x), l (1 - t)) = t r(s) has the gradient (r', ((s - x) r' - r) / l) and dx dy is t l ds dt.
T is the mesh's triangle at e, or, where that is higher than 2 (k/c)^{1/2}, the one of this height whose third
vertex lies on the line from the midpoint of e to the vertex of the mesh's triangle.
Where g is smooth r' = O(h^2), and |w|_1 = O(h^{5/2}). At last a function of V_h is added that is at least
the doubt on every edge where v + w >= g needs it. (u_h, lambda_H) says where there is contact.

On clamped edges v + w + more = u_D. As in contact r = p - v has any sign, and u_D - p is known up to its
doubt, and its derivative in L2. At the nodes there the last function may have either sign. What is left of
u_D - p then vanishes at the ends of e. Beside a vertex at which u_D is known to be above g only up to the
doubt, g counts as lower by the doubt, as data that jump there by as little do. For such a function rho,
||rho||_e <= |e| ||rho'||_e / pi, so that the norm of its extension is at most a multiple of ||rho'||_e.

Nothing is left to quadrature. Integrals of polynomials are exact, and where the sign of p - v is not that of
all its coefficients in Bernstein's basis, that of (p - v)_+^2 is taken to be that of (p - v)^2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.bounds.boundary_flux import NormalFlux
from unilateral.bounds.constraint import BERNSTEIN_ROUNDING, Constraint, bernstein_bounds
from unilateral.fem.form import Form
from unilateral.fem.p2 import BoundaryLayer, boundary_layer
from unilateral.geometry.mesh import Mesh

CONTACT_GAP_RATIO = 0.5
"""u_h counts as in contact where it is less than this times H_i lambda_i / k above g (`NormalFlux.contact_scale`).

Only the sharpness of the bounds depends on it.
"""
EXTENSION_COST_RATIO = 16.0
"""The squared norm of w counts this many times as much as that of a raised midpoint when one is chosen.

Only the sharpness of the bounds depends on it.
"""
MAX_EXTENSION_LAYERS = 2.0
"""Extensions reach this far into the domain, in units of (k/c)^{1/2}. Only the sharpness depends on it."""
MIDPOINT_OVERSHOOT = 1.05
"""A midpoint is raised by this times what the points of the rule need, for v > p between them, too."""


class Shortfall(NamedTuple):
    """Bounds on ||w||^2 and on <q.n, v + w + added - g>, edge by edge, and what is added for the doubt.

    The sum of `extension_squares` (nb,) is at least ||w||^2, the energy norm, and the sum of
    `edge_complementarity` (nb,) is a bound on the product; `nodal_raise` (nb,) are values at the boundary
    nodes. At those of clamped sides any value may be added whose size is at most that in `nodal_change`
    (nb,), which is 0 at the others.
    """

    extension_squares: Array
    edge_complementarity: Array
    nodal_raise: Array
    nodal_change: Array

    @property
    def extension_norm(self) -> float:
        """A bound on the energy norm of w."""
        return math.sqrt(float(self.extension_squares.sum()))

    @property
    def complementarity(self) -> float:
        """A bound on <q.n, v + w + added - g>."""
        return max(float(self.edge_complementarity.sum()), 0.0)


def raise_to_obstacle(
    constraint: Constraint, form: Form, v: Array, contact: Mask, sigma: Array, bubble_square_norms: Array
) -> tuple[Array, Mask]:
    """v (n,), raised to at least p at the unknowns, and (nb,) the edges on which r has any sign.

    v = p at the unknowns in `contact` (n,). On every edge the cheapest of these is taken: r has any sign,
    which is for edges with all three unknowns in contact and without a jump of p; r is (p - v)_+; or the
    midpoint is raised above p. `bubble_square_norms` (nb,) are the squared norms of the midpoints' basis
    functions, and `sigma` is that of `bound_shortfall`.
    """
    v = np.where(contact, constraint.p_at_unknowns, np.maximum(v, constraint.p_at_unknowns))
    touching = constraint.clamped_edges | contact[constraint.unknowns].all(axis=1) & ~constraint.has_jump
    constraint = constraint.select_near_edges(v, touching | sigma.any(axis=1))
    above = v.copy()
    by = _midpoint_raises(constraint, v)
    above[constraint.unknowns[:, 2]] += by
    none = np.zeros_like(touching)

    def cost(v: Array, any_sign: Mask) -> Array:
        squares, slack, _ = _edge_shortfalls(constraint, form, v, any_sign, sigma)
        return EXTENSION_COST_RATIO * squares + 2 * slack

    extended = cost(v, touching)
    kept = cost(v, none)
    lifted = cost(above, none) + bubble_square_norms * by**2
    lift = (lifted < np.where(touching, np.minimum(extended, kept), kept)) & ~constraint.clamped_edges
    v[constraint.unknowns[lift, 2]] = above[constraint.unknowns[lift, 2]]
    return v, constraint.clamped_edges | touching & ~lift & (extended <= kept)


def bound_shortfall(
    constraint: Constraint, form: Form, v: Array, contact_edges: Mask, sigma: Array
) -> Shortfall:
    """Bounds on all that a raised v lacks of being feasible.

    q.n is linear on every edge, with the values `sigma` (nb, 2) at its ends.
    """
    mesh = constraint.mesh
    triangle = constraint.mesh.boundary_triangles
    squares, slack, doubt = _edge_shortfalls(
        constraint.select_near_edges(v, contact_edges | sigma.any(axis=1)), form, v, contact_edges, sigma
    )
    shared = np.bincount(triangle, minlength=len(mesh.triangles))[triangle]
    added = np.maximum(doubt, np.roll(doubt, 1))
    fixed = constraint.clamped_edges | np.roll(constraint.clamped_edges, 1)
    most = np.maximum(added, np.roll(added, -1))
    push = 0.5 * np.diff(mesh.s) * sigma.sum(axis=1)
    # u_D that jumps, or may for all that rounding shows, is no trace: there is no u then, and no v
    squares = np.where(constraint.clamped_edges & constraint.has_jump, math.inf, shared * squares)
    return Shortfall(squares, slack + most * push, np.where(fixed, 0.0, added), np.where(fixed, added, 0.0))


def _midpoint_raises(constraint: Constraint, v: Array) -> Array:
    """By how much each midpoint has to be raised for v > p, seen at the points of the rule.

    The shape is (nb,).
    """
    by = np.zeros(len(constraint.unknowns))
    bubble = 4 * constraint.x * (1 - constraint.x)
    ratio = np.where(
        bubble > 0, (constraint.p - constraint.trace_and_slope(v)[0]) / np.where(bubble > 0, bubble, 1.0), 0.0
    )
    np.maximum.at(by, constraint.edge, np.max(ratio, axis=1))
    return MIDPOINT_OVERSHOOT * by


def _edge_shortfalls(
    constraint: Constraint, form: Form, v: Array, contact_edges: Mask, sigma: Array
) -> tuple[Array, Array, Array]:
    """Bounds on ||w||^2 and on <q.n, v + w - g>, edge by edge, and the remainder of g where v + w needs it.

    The shape is (nb,).
    """
    value, slope = constraint.trace_and_slope(v)
    any_sign = contact_edges[constraint.edge]
    of_v = BERNSTEIN_ROUNDING * np.abs(v[constraint.unknowns]).max(axis=1)
    doubts = constraint.remainder + 2 * of_v[constraint.edge]
    r = constraint.p - value - np.where(any_sign, 0.0, (constraint.rounding + of_v)[constraint.edge])[:, None]
    low, high = bernstein_bounds(r)
    foot, height = _extension_apexes(constraint.mesh, form)
    arm = constraint.x * np.diff(constraint.mesh.s)[constraint.edge][:, None] - foot[constraint.edge][:, None]
    r_prime = constraint.slope - slope
    counts = (any_sign | (high > 0))[:, None]
    of_r = constraint.edge_integrals(r**2 * counts)
    of_slope = constraint.edge_integrals(r_prime**2 * counts)
    of_arm = constraint.edge_integrals((arm * r_prime) ** 2 * counts)
    squares = form.k * 0.5 * (height * of_slope + (of_arm + 2 * of_r) / height)
    squares += form.c * 0.25 * height * of_r
    squares = (
        np.sqrt(squares)
        + constraint.slope_remainder * np.sqrt(_extension_constants(constraint.mesh, form, foot, height))
    ) ** 2
    above = np.where(counts, np.maximum(-low, 0.0)[:, None], -r)
    above = np.where(any_sign[:, None], 0.0, above) + doubts[:, None]
    q_n = sigma[constraint.edge, :1] * (1 - constraint.x) + sigma[constraint.edge, 1:] * constraint.x
    slack = constraint.edge_integrals(np.where(q_n > 0, above, 0.0) * q_n)
    needed = any_sign | ((high + doubts > 0) & ~(bernstein_bounds(value)[0] >= constraint.g_upper))
    doubt = np.zeros(len(constraint.unknowns))
    np.maximum.at(doubt, constraint.edge, np.where(needed, doubts, 0.0))
    return squares, slack, doubt


def _extension_constants(mesh: Mesh, form: Form, foot: Array, height: Array) -> Array:
    """Bounds on ||w||^2 for an r that vanishes at the ends of each edge, with ||r'||_e = 1.

    The shape is (nb,).
    """
    lengths = np.diff(mesh.s)
    arm = np.maximum(np.abs(foot), np.abs(lengths - foot))
    of_r = (lengths / math.pi) ** 2
    of_gradient = 0.5 * (height + (arm**2 + 2 * of_r) / height)
    return np.asarray(form.k * of_gradient + form.c * 0.25 * height * of_r)


def _extension_apexes(mesh: Mesh, form: Form) -> tuple[Array, Array]:
    """The centres of extensions, by their place along each edge and their distance from it.

    Returns arrays of the shapes (nb,), (nb,).
    """
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    off = mesh.points[mesh.triangles[mesh.boundary_triangles].sum(axis=1) - start - end] - mesh.points[start]
    along = np.sum(off * mesh.polygon.tangents[mesh.side], axis=1)
    height = -np.sum(off * mesh.polygon.normals[mesh.side], axis=1)
    deepest = MAX_EXTENSION_LAYERS * math.sqrt(form.k / form.c) if form.c else math.inf
    depth = np.minimum(height, deepest)
    middle = 0.5 * np.diff(mesh.s)
    return middle + (along - middle) * (depth / height), depth


def find_contact(constraint: Constraint, trace: Array, contact_scale: Array) -> Mask:
    """Which P2 unknowns on the boundary are in contact: u_h - g is below CONTACT_GAP_RATIO H_i lambda_i / k of a cell there.

    The shape is (n,).
    """
    largest = np.zeros(len(trace))
    np.maximum.at(largest, constraint.unknowns, contact_scale[:, None])
    return trace - constraint.p_at_unknowns < CONTACT_GAP_RATIO * largest


class Lifting(NamedTuple):
    """What makes a function of P2 feasible on the boundary.

    `contact` (2 nb,) marks the unknowns of P2 in contact, and `sigma` (nb, 2) is q.n at the edges' ends.
    """

    layer: BoundaryLayer
    constraint: Constraint
    form: Form
    contact: Mask
    sigma: Array

    def meet_obstacle(self, nodal: Array) -> tuple[Array, Array]:
        """The hats and bubbles to add to values at boundary nodes, to be g in contact.

        Returns arrays of the shapes (nb,), (nb,).
        """
        before = _p2_trace(nodal, np.zeros_like(nodal))
        return _p2_coefficients(np.where(self.contact, self.constraint.p_at_unknowns - before, 0.0))

    def make_feasible(self, nodal: Array, bubbles: Array) -> tuple[Array, Array, Shortfall]:
        """The hats and bubbles to add to these coefficients to make them feasible, and the shortfall that is left then.

        Returns arrays of the shapes (nb,), (nb,).
        """
        before = _p2_trace(nodal, bubbles)
        v, touching = raise_to_obstacle(
            self.constraint,
            self.form,
            before,
            self.contact,
            self.sigma,
            self.layer.bubble_square_norms(self.form),
        )
        return *_p2_coefficients(v - before), bound_shortfall(
            self.constraint, self.form, v, touching, self.sigma
        )

    def remainder_squares(self, shortfall: Shortfall) -> Array:
        """Bounds on the squared energy norms, on the layer's triangles, of what is added for the remainder of g.

        The shape is (k,).
        """
        none = np.zeros_like(shortfall.nodal_raise)
        of_added = self.layer.square_norms(self.form, *self.layer.function(shortfall.nodal_raise, none))
        if not np.any(shortfall.nodal_change):
            return of_added
        values, _ = self.layer.function(shortfall.nodal_change, none)
        hats = (
            self.layer.square_norms(self.form, np.broadcast_to(hat, values.shape), 0 * values)
            for hat in np.eye(3)
        )
        of_either = sum(np.sqrt(of_hat) * value for of_hat, value in zip(hats, values.T, strict=True))
        return (np.sqrt(of_added) + of_either) ** 2


def build_lifting(constraint: Constraint, form: Form, u_h: Array, normal_flux: NormalFlux) -> Lifting:
    """The lifting for u_h (n,), whose values on the edges that the constraint clamps are to be u_D."""
    nodal = u_h[constraint.mesh.boundary]
    contact = find_contact(constraint, _p2_trace(nodal, np.zeros_like(nodal)), normal_flux.contact_scale)
    contact[constraint.unknowns[constraint.clamped_edges]] = True
    return Lifting(boundary_layer(constraint.mesh), constraint, form, contact, normal_flux.end_values)


def _p2_trace(nodal: Array, bubbles: Array) -> Array:
    """The values at the boundary nodes, then at the midpoints of the edges, from coefficients of hats and bubbles.

    The shape is (2 nb,).
    """
    return np.concatenate([nodal, 0.5 * (nodal + np.roll(nodal, -1)) + bubbles])


def _p2_coefficients(trace: Array) -> tuple[Array, Array]:
    """The coefficients of hats and of bubbles with that trace.

    Returns arrays of the shapes (nb,), (nb,).
    """
    nodal, middle = np.split(trace, 2)
    return nodal, middle - 0.5 * (nodal + np.roll(nodal, -1))
