"""How a P2 function v is made to satisfy v >= g on the boundary, and what is still missing then.

g is within `remainder` of a continuous piecewise polynomial p (`Obstacle`). v is raised to p at the nodes and
midpoints of the boundary edges, or at a midpoint above p. On an edge where v is in contact r = p - v is left,
of any sign, elsewhere r = (p - v)_+, p there less its rounding; both vanish at the edge's ends. The extension
w of r into a triangle T at the edge e, homogeneous of degree 1 about the vertex off e, vanishes on the
other edges of T. With l the height of T over e and x the foot of that vertex on e,

    |w|_{1,T}^2 = (l ||r'||_e^2 + (||(s - x) r'||_e^2 + 2 ||r||_e^2) / l) / 2,   ||w||_T^2 = l ||r||_e^2 / 4,

for w(x + t (s - x), l (1 - t)) = t r(s) has the gradient (r', ((s - x) r' - r) / l) and dx dy is t l ds dt.
T is the mesh's triangle at e, or, where that is higher than 2 (k/c)^{1/2}, the one of this height whose third
vertex lies on the line from the midpoint of e to the vertex of the mesh's triangle.
Where g is smooth r' = O(h^2), and |w|_1 = O(h^{5/2}). At last a function of V_h is added that is at least
the remainder on every edge where v + w >= g needs it.

On clamped edges v + w + more = u_D. As in contact r = p - v has any sign, and u_D - p is known up to its
remainder, and its derivative in L2. At the nodes there the last function may have either sign. What is left
of u_D - p then vanishes at the ends of e. Beside a vertex at which u_D is known to be above g only up to the
remainder, g counts as lower by that, as data that jump there by as little do. For such a function rho,
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
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, underflow_allowance
from unilateral.fem.form import Form
from unilateral.fem.p2 import BoundaryLayer, boundary_layer
from unilateral.geometry.mesh import Mesh

CONTACT_GAP_RATIO = 0.5
"""u_h is in contact where it is less than this times H_i lambda_i / k above g (`NormalFlux.contact_scale`).

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
    """Bounds on ||w||^2 and on <q.n, v + w + added - g>, edge by edge, and what is added for the remainder.

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
    """v (2 nb,), raised to at least p at the unknowns, and (nb,) the edges on which r has any sign.

    v = p at the unknowns in `contact` (2 nb,), which has all those of clamped edges, where p = u_D. On every
    edge the cheapest of these is taken: r has any sign, which is for edges with all three unknowns in contact
    and without a jump of p; r is (p - v)_+; or the midpoint is raised above p. `bubble_square_norms` (nb,)
    are the squared norms of the midpoints' basis functions, and `sigma` is that of `bound_shortfall`.
    """
    v = np.where(contact, constraint.p_at_unknowns, np.maximum(v, constraint.p_at_unknowns))
    touching = constraint.clamped_edges | (contact[constraint.unknowns].all(axis=1) & ~constraint.has_jump)
    # where q.n = 0 and v is above g nothing is missing; with q.n > 0 the gap costs complementarity
    constraint = constraint.select_near_edges(v, touching | sigma.any(axis=1))
    v_lifted = v.copy()
    midpoint_raise = _midpoint_raises(constraint, v)
    v_lifted[constraint.unknowns[:, 2]] += midpoint_raise
    nowhere = np.zeros_like(touching)

    def cost(v: Array, any_sign: Mask) -> Array:
        """The cost of w and of the complementarity in eta^2, edge by edge."""
        squares, complementarity, _ = _edge_shortfalls(constraint, form, v, any_sign, sigma)
        return EXTENSION_COST_RATIO * squares + 2 * complementarity

    contact_cost = cost(v, touching)
    plain_cost = cost(v, nowhere)
    lifted_cost = cost(v_lifted, nowhere) + bubble_square_norms * midpoint_raise**2
    unlifted_cost = np.where(touching, np.minimum(contact_cost, plain_cost), plain_cost)
    is_lifted = (lifted_cost < unlifted_cost) & ~constraint.clamped_edges
    v[constraint.unknowns[is_lifted, 2]] = v_lifted[constraint.unknowns[is_lifted, 2]]
    return v, constraint.clamped_edges | (touching & ~is_lifted & (contact_cost <= plain_cost))


def bound_shortfall(
    constraint: Constraint, form: Form, v: Array, contact_edges: Mask, sigma: Array
) -> Shortfall:
    """Bounds on all that a raised v lacks of being feasible.

    q.n is linear on every edge, with the values `sigma` (nb, 2) at its ends.
    """
    mesh = constraint.mesh
    triangle = mesh.boundary_triangles
    # where q.n = 0 and v is above g nothing is missing
    near = constraint.select_near_edges(v, contact_edges | sigma.any(axis=1))
    squares, complementarity, remainder = _edge_shortfalls(near, form, v, contact_edges, sigma)
    # ||w||^2 of a triangle with two boundary edges is at most twice the sum of both squares
    shared = np.bincount(triangle, minlength=len(mesh.triangles))[triangle]
    # each node gets the larger remainder of its two edges, edge i - 1 and edge i
    nodal_raise = np.maximum(remainder, np.roll(remainder, 1))
    is_clamped = constraint.clamped_edges | np.roll(constraint.clamped_edges, 1)
    # what is added at the nodes raises v on an edge by at most the larger value
    edge_raise = np.maximum(nodal_raise, np.roll(nodal_raise, -1))
    sigma_integral = 0.5 * np.diff(mesh.s) * sigma.sum(axis=1)
    # u_D that jumps, or may for all that rounding shows, is no trace: there is no u then, and no v
    squares = np.where(constraint.clamped_edges & constraint.has_jump, math.inf, shared * squares)
    return Shortfall(
        extension_squares=squares,
        edge_complementarity=complementarity + edge_raise * sigma_integral,
        nodal_raise=np.where(is_clamped, 0.0, nodal_raise),
        nodal_change=np.where(is_clamped, nodal_raise, 0.0),
    )


def _midpoint_raises(constraint: Constraint, v: Array) -> Array:
    """The t (nb,) for which v + 4 t x (1 - x) > p on each edge, as far as the points of the rule show it."""
    bubble = 4 * constraint.x * (1 - constraint.x)
    lacking = constraint.p - constraint.trace_and_slope(v)[0]
    # at an edge's ends the bubble is 0, and v is at least p already
    ratio = np.where(bubble > 0, lacking / np.where(bubble > 0, bubble, 1.0), 0.0)
    return MIDPOINT_OVERSHOOT * _largest_per_edge(constraint, np.max(ratio, axis=1))


def _edge_shortfalls(
    constraint: Constraint, form: Form, v: Array, contact_edges: Mask, sigma: Array
) -> tuple[Array, Array, Array]:
    """Bounds (nb,) on ||w||^2 and <q.n, v + w - g> per edge, and the remainder of g where v + w needs it.

    The `constraint` may have the intervals of some edges alone; the numbers of the others are 0. On
    `contact_edges` (nb,) r has any sign. `sigma` (nb, 2) is q.n at the edges' ends.
    """
    value, slope = constraint.trace_and_slope(v)
    any_sign = contact_edges[constraint.edge]
    v_rounding = BERNSTEIN_ROUNDING * np.abs(v[constraint.unknowns]).max(axis=1)
    remainder = constraint.remainder + 2 * v_rounding[constraint.edge]
    # r = p - v, less the rounding where it stands for (p - v)_+, which then is 0 where v = p
    rounding = (constraint.rounding + v_rounding)[constraint.edge]
    r = constraint.p - value - np.where(any_sign, 0.0, rounding)[:, None]
    low, high = bernstein_bounds(r)
    # where r is positive somewhere on an interval its square is at least that of (p - v)_+
    is_extended = (any_sign | (high > 0))[:, None]
    squares = _extension_squares(constraint, form, r, constraint.slope - slope, is_extended)
    # v + w - p is -r where r is not extended, at most (-low)_+ where r_+ is, and 0 in contact
    gap = np.where(is_extended, np.maximum(-low, 0.0)[:, None], -r)
    gap = np.where(any_sign[:, None], 0.0, gap) + remainder[:, None]
    q_n = sigma[constraint.edge, :1] * (1 - constraint.x) + sigma[constraint.edge, 1:] * constraint.x
    complementarity = constraint.edge_integrals(np.where(q_n > 0, gap, 0.0) * q_n)
    # v + w >= g up to the remainder, which is needed where v is not above g as it is
    is_needed = any_sign | ((high + remainder > 0) & ~(bernstein_bounds(value)[0] >= constraint.g_upper))
    return squares, complementarity, _largest_per_edge(constraint, np.where(is_needed, remainder, 0.0))


def _largest_per_edge(constraint: Constraint, values: Array) -> Array:
    """The largest of 0 and the `values` (K,) on the intervals of each edge, (nb,)."""
    largest = np.zeros(len(constraint.unknowns))
    np.maximum.at(largest, constraint.edge, values)
    return largest


def _extension_squares(
    constraint: Constraint, form: Form, r: Array, r_prime: Array, is_extended: Mask
) -> Array:
    """Bounds (nb,) on k |w|_1^2 + c ||w||^2, by the formulas of the module's docstring.

    r and r' (K, Q) are extended from the intervals that `is_extended` (K, 1) marks. On clamped edges what p
    leaves of u_D is extended, too, by the bound on its derivative.
    """
    foot, height = _extension_apexes(constraint.mesh, form)
    arm = constraint.x * np.diff(constraint.mesh.s)[constraint.edge][:, None] - foot[constraint.edge][:, None]
    r_squares = constraint.edge_integrals(r**2 * is_extended)
    slope_squares = constraint.edge_integrals(r_prime**2 * is_extended)
    arm_squares = constraint.edge_integrals((arm * r_prime) ** 2 * is_extended)
    squares = form.k * 0.5 * (height * slope_squares + (arm_squares + 2 * r_squares) / height)
    squares += form.c * 0.25 * height * r_squares
    constants = _extension_constants(constraint.mesh, form, foot, height)
    return np.asarray((np.sqrt(squares) + constraint.slope_remainder * np.sqrt(constants)) ** 2)


def _extension_constants(mesh: Mesh, form: Form, foot: Array, height: Array) -> Array:
    """Bounds on ||w||^2 for an r that vanishes at the ends of each edge, with ||r'||_e = 1, (nb,)."""
    lengths = np.diff(mesh.s)
    arm = np.maximum(np.abs(foot), np.abs(lengths - foot))
    # ||r||_e <= |e| / pi, and |s - x| <= arm, in the formulas of the module's docstring
    r_square = (lengths / math.pi) ** 2
    gradient_square = 0.5 * (height + (arm**2 + 2 * r_square) / height)
    return np.asarray(form.k * gradient_square + form.c * 0.25 * height * r_square)


def _extension_apexes(mesh: Mesh, form: Form) -> tuple[Array, Array]:
    """The place of the foot x on each edge, and the height l, of the extensions' triangles, (nb,) each."""
    # the vertex off the edge, whose number is the sum of the triangle's numbers less both ends
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    apex = mesh.points[mesh.triangles[mesh.boundary_triangles].sum(axis=1) - start - end] - mesh.points[start]
    along = np.sum(apex * mesh.polygon.tangents[mesh.side], axis=1)
    height = -np.sum(apex * mesh.polygon.normals[mesh.side], axis=1)
    deepest = MAX_EXTENSION_LAYERS * math.sqrt(form.k / form.c) if form.c else math.inf
    depth = np.minimum(height, deepest)
    # the third vertex moves down on the line to the edge's midpoint
    middle = 0.5 * np.diff(mesh.s)
    return middle + (along - middle) * (depth / height), depth


def find_contact(constraint: Constraint, trace: Array, contact_scale: Array) -> Mask:
    """Which P2 unknowns (2 nb,) of u_h are in contact: u_h - g < CONTACT_GAP_RATIO H_i lambda_i / k there."""
    # H_i lambda_i / k of an edge; of a node it is the larger one of both edges
    largest = np.zeros(len(trace))
    np.maximum.at(largest, constraint.unknowns, contact_scale[:, None])
    return trace - constraint.p_at_unknowns < CONTACT_GAP_RATIO * largest


class Lift(NamedTuple):
    """y, which makes a function feasible: hats and bubbles, extensions w, and hats for the remainder of g.

    `nodal` and `bubbles` (nb,) are the coefficients of the first part at boundary nodes and edges. Of the
    other two only norms are known: that of w by `shortfall`, and that of the hats, squared, by triangles of
    the layer, `remainder_squares` (k,). Underflow takes at most `underflow` from a norm.
    """

    nodal: Array
    bubbles: Array
    shortfall: Shortfall
    remainder_squares: Array
    underflow: float

    @property
    def remainder_norm(self) -> float:
        """A bound on the energy norm of the hats for the remainder of g."""
        return math.sqrt(float(self.remainder_squares.sum()))

    @property
    def missing_norm(self) -> float:
        """A bound on the energy norm of what y is beside its hats and bubbles."""
        return (1 + SQUARES_ROUNDING) * (self.shortfall.extension_norm + self.remainder_norm) + self.underflow


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
        """The hats and bubbles, (nb,) each, to add to a trace of V_h for it to be g where in contact."""
        before = _p2_trace(nodal, np.zeros_like(nodal))
        return _p2_coefficients(np.where(self.contact, self.constraint.p_at_unknowns - before, 0.0))

    def make_feasible(self, nodal: Array, bubbles: Array) -> Lift:
        """The lift to add to a function with these hats and bubbles (nb,) on the boundary to be feasible."""
        before = _p2_trace(nodal, bubbles)
        v, contact_edges = raise_to_obstacle(
            self.constraint,
            self.form,
            v=before,
            contact=self.contact,
            sigma=self.sigma,
            bubble_square_norms=self.layer.bubble_square_norms(self.form),
        )
        shortfall = bound_shortfall(self.constraint, self.form, v, contact_edges, self.sigma)
        nodal, bubbles = _p2_coefficients(v - before)
        underflow = underflow_allowance(self.layer.mesh, self.form)
        return Lift(nodal, bubbles, shortfall, self.remainder_squares(shortfall), underflow)

    def remainder_squares(self, shortfall: Shortfall) -> Array:
        """Bounds (k,) on the squared energy norms, by triangles of the layer, of what the remainder adds."""
        no_bubbles = np.zeros_like(shortfall.nodal_raise)
        hats, bubbles = self.layer.expand(shortfall.nodal_raise, no_bubbles)
        raise_squares = self.layer.square_norms(self.form, hats, bubbles)
        # at clamped nodes the sign is not known: the norms of the hats, times the sizes, are added
        if not np.any(shortfall.nodal_change):
            return raise_squares
        values, _ = self.layer.expand(shortfall.nodal_change, no_bubbles)
        change_norms = sum(
            np.sqrt(self.layer.square_norms(self.form, np.broadcast_to(hat, values.shape), 0 * values)) * size
            for hat, size in zip(np.eye(3), values.T, strict=True)
        )
        return (np.sqrt(raise_squares) + change_norms) ** 2


def build_lifting(constraint: Constraint, form: Form, u_h: Array, normal_flux: NormalFlux) -> Lifting:
    """The lifting for u_h (n,), whose values on the edges that the constraint clamps are to be u_D."""
    nodal = u_h[constraint.mesh.boundary]
    contact = find_contact(constraint, _p2_trace(nodal, np.zeros_like(nodal)), normal_flux.contact_scale)
    contact[constraint.unknowns[constraint.clamped_edges]] = True
    return Lifting(boundary_layer(constraint.mesh), constraint, form, contact, normal_flux.end_values)


def _p2_trace(nodal: Array, bubbles: Array) -> Array:
    """The values (2 nb,) at nodes, then at midpoints of edges, from coefficients of hats and bubbles."""
    return np.concatenate([nodal, 0.5 * (nodal + np.roll(nodal, -1)) + bubbles])


def _p2_coefficients(trace: Array) -> tuple[Array, Array]:
    """The coefficients of hats and of bubbles with that trace, (nb,) each."""
    nodal, middle = np.split(trace, 2)
    return nodal, middle - 0.5 * (nodal + np.roll(nodal, -1))
