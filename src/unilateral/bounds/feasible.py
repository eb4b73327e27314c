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
from unilateral.bounds.boundary_flux import EdgeFlux
from unilateral.bounds.constraint import ROUNDING, Constraint, bernstein_bounds
from unilateral.fem.form import Form
from unilateral.fem.p2 import Layer, layer
from unilateral.geometry.mesh import Mesh

PUSH = 0.5
"""u_h counts as in contact where it is less than this times H_i lambda_i / k above g (`EdgeFlux.push`).

Only the sharpness of the bounds depends on it.
"""
DEAR = 16.0
"""The squared norm of w counts this many times as much as that of a raised midpoint when one is chosen.

Only the sharpness of the bounds depends on it.
"""
LAYERS = 2.0
"""Extensions reach this far into the domain, in units of (k/c)^{1/2}. Only the sharpness depends on it."""
SPARE = 1.05
"""A midpoint is raised by this times what the points of the rule need, for v > p between them, too."""


class Missing(NamedTuple):
    """Bounds on ||w||^2 and on <q.n, v + w + added - g>, edge by edge, and what is added for the doubt.

    The sum of `squares` (nb,) is at least ||w||^2, the energy norm, and the sum of `slack` (nb,) is a bound
    on the product; `added` (nb,) are values at the boundary nodes. At those of clamped sides any value may be
    added whose size is at most that in `either` (nb,), which is 0 at the others.
    """

    squares: Array
    slack: Array
    added: Array
    either: Array

    @property
    def norm(self) -> float:
        """A bound on the energy norm of w."""
        return math.sqrt(float(self.squares.sum()))

    @property
    def product(self) -> float:
        """A bound on <q.n, v + w + added - g>."""
        return max(float(self.slack.sum()), 0.0)


def raised(
    g: Constraint, form: Form, v: Array, contact: Mask, flux: Array, stiffness: Array
) -> tuple[Array, Mask]:
    """v (n,), raised to at least p at the unknowns, and (nb,) the edges on which r has any sign.

    v = p at the unknowns in `contact` (n,). On every edge the cheapest of these is taken: r has any sign,
    which is for edges with all three unknowns in contact and without a jump of p; r is (p - v)_+; or the
    midpoint is raised above p. `stiffness` (nb,) are the squared norms of the midpoints' basis functions, and
    `flux` is that of `missing`.
    """
    v = np.where(contact, g.at_unknowns, np.maximum(v, g.at_unknowns))
    touching = g.clamped | contact[g.unknowns].all(axis=1) & ~g.jumps
    g = g.near(v, touching | flux.any(axis=1))
    above = v.copy()
    by = _bubbles(g, v)
    above[g.unknowns[:, 2]] += by
    none = np.zeros_like(touching)

    def cost(v: Array, any_sign: Mask) -> Array:
        squares, slack, _ = _short(g, form, v, any_sign, flux)
        return DEAR * squares + 2 * slack

    extended = cost(v, touching)
    kept = cost(v, none)
    lifted = cost(above, none) + stiffness * by**2
    lift = (lifted < np.where(touching, np.minimum(extended, kept), kept)) & ~g.clamped
    v[g.unknowns[lift, 2]] = above[g.unknowns[lift, 2]]
    return v, g.clamped | touching & ~lift & (extended <= kept)


def missing(g: Constraint, form: Form, v: Array, touching: Mask, flux: Array) -> Missing:
    """What a raised v (n,) is short of; r has any sign on the edges `touching` (nb,).

    q.n is linear on every edge, with the values `flux` (nb, 2) at its ends.
    """
    mesh = g.mesh
    triangle = g.mesh.boundary_triangles
    squares, slack, doubt = _short(g.near(v, touching | flux.any(axis=1)), form, v, touching, flux)
    shared = np.bincount(triangle, minlength=len(mesh.triangles))[triangle]
    added = np.maximum(doubt, np.roll(doubt, 1))
    fixed = g.clamped | np.roll(g.clamped, 1)
    most = np.maximum(added, np.roll(added, -1))
    push = 0.5 * np.diff(mesh.s) * flux.sum(axis=1)
    # u_D that jumps, or may for all that rounding shows, is no trace: there is no u then, and no v
    squares = np.where(g.clamped & g.jumps, math.inf, shared * squares)
    return Missing(squares, slack + most * push, np.where(fixed, 0.0, added), np.where(fixed, added, 0.0))


def _bubbles(g: Constraint, v: Array) -> Array:
    """(nb,) by how much midpoints have to be raised for v > p, seen at the points of the rule."""
    by = np.zeros(len(g.unknowns))
    bubble = 4 * g.x * (1 - g.x)
    ratio = np.where(bubble > 0, (g.p - g.trace(v)[0]) / np.where(bubble > 0, bubble, 1.0), 0.0)
    np.maximum.at(by, g.edge, np.max(ratio, axis=1))
    return SPARE * by


def _short(g: Constraint, form: Form, v: Array, touching: Mask, flux: Array) -> tuple[Array, Array, Array]:
    """(nb,) bounds on ||w||^2 and on <q.n, v + w - g>, edge by edge, and the doubt where v + w needs it."""
    value, slope = g.trace(v)
    any_sign = touching[g.edge]
    of_v = ROUNDING * np.abs(v[g.unknowns]).max(axis=1)
    doubts = g.doubt + 2 * of_v[g.edge]
    r = g.p - value - np.where(any_sign, 0.0, (g.rounding + of_v)[g.edge])[:, None]
    low, high = bernstein_bounds(r)
    foot, height = _apex(g.mesh, form)
    arm = g.x * np.diff(g.mesh.s)[g.edge][:, None] - foot[g.edge][:, None]
    r_prime = g.slope - slope
    counts = (any_sign | (high > 0))[:, None]
    of_r = g.integrals(r**2 * counts)
    of_slope = g.integrals(r_prime**2 * counts)
    of_arm = g.integrals((arm * r_prime) ** 2 * counts)
    squares = form.k * 0.5 * (height * of_slope + (of_arm + 2 * of_r) / height)
    squares += form.c * 0.25 * height * of_r
    squares = (np.sqrt(squares) + g.steep * np.sqrt(_per_slope(g.mesh, form, foot, height))) ** 2
    above = np.where(counts, np.maximum(-low, 0.0)[:, None], -r)
    above = np.where(any_sign[:, None], 0.0, above) + doubts[:, None]
    q_n = flux[g.edge, :1] * (1 - g.x) + flux[g.edge, 1:] * g.x
    slack = g.integrals(np.where(q_n > 0, above, 0.0) * q_n)
    needed = any_sign | ((high + doubts > 0) & ~(bernstein_bounds(value)[0] >= g.upper))
    doubt = np.zeros(len(g.unknowns))
    np.maximum.at(doubt, g.edge, np.where(needed, doubts, 0.0))
    return squares, slack, doubt


def _per_slope(mesh: Mesh, form: Form, foot: Array, height: Array) -> Array:
    """(nb,) bounds on ||w||^2 for an r that vanishes at the ends of the edge, with ||r'||_e = 1."""
    lengths = np.diff(mesh.s)
    arm = np.maximum(np.abs(foot), np.abs(lengths - foot))
    of_r = (lengths / math.pi) ** 2
    of_gradient = 0.5 * (height + (arm**2 + 2 * of_r) / height)
    return np.asarray(form.k * of_gradient + form.c * 0.25 * height * of_r)


def _apex(mesh: Mesh, form: Form) -> tuple[Array, Array]:
    """(nb,), (nb,) the centres of extensions, by their place along the edge and their distance from it."""
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    off = mesh.points[mesh.triangles[mesh.boundary_triangles].sum(axis=1) - start - end] - mesh.points[start]
    along = np.sum(off * mesh.polygon.tangents[mesh.side], axis=1)
    height = -np.sum(off * mesh.polygon.normals[mesh.side], axis=1)
    deepest = LAYERS * math.sqrt(form.k / form.c) if form.c else math.inf
    depth = np.minimum(height, deepest)
    middle = 0.5 * np.diff(mesh.s)
    return middle + (along - middle) * (depth / height), depth


def in_contact(g: Constraint, u_h: Array, push: Array) -> Mask:
    """(n,) P2's unknowns in contact: u_h - g is below PUSH H_i lambda_i / k of a cell there."""
    largest = np.zeros(len(u_h))
    np.maximum.at(largest, g.unknowns, push[:, None])
    return u_h - g.at_unknowns < PUSH * largest


class Lifting(NamedTuple):
    """What makes a function of P2 feasible on the boundary.

    `contact` (2 nb,) marks the unknowns of P2 in contact, and `flux` (nb, 2) is q.n at the edges' ends.
    """

    of: Layer
    g: Constraint
    form: Form
    contact: Mask
    flux: Array

    def met(self, nodal: Array) -> tuple[Array, Array]:
        """(nb,), (nb,) the hats and bubbles to add to values at boundary nodes, to be g in contact."""
        before = _trace(nodal, np.zeros_like(nodal))
        return _coefficients(np.where(self.contact, self.g.at_unknowns - before, 0.0))

    def lifted(self, nodal: Array, bubbles: Array) -> tuple[Array, Array, Missing]:
        """(nb,), (nb,) what to add to these coefficients to make them feasible, and what is missing then."""
        before = _trace(nodal, bubbles)
        v, touching = raised(
            self.g, self.form, before, self.contact, self.flux, self.of.bubble_squares(self.form)
        )
        return *_coefficients(v - before), missing(self.g, self.form, v, touching, self.flux)

    def added(self, short: Missing) -> Array:
        """(k,) bounds on the squared norms of what is added for the doubt on the layer's triangles."""
        none = np.zeros_like(short.added)
        of_added = self.of.squares(self.form, *self.of.function(short.added, none))
        if not np.any(short.either):
            return of_added
        values, _ = self.of.function(short.either, none)
        hats = (
            self.of.squares(self.form, np.broadcast_to(hat, values.shape), 0 * values) for hat in np.eye(3)
        )
        of_either = sum(np.sqrt(of_hat) * value for of_hat, value in zip(hats, values.T, strict=True))
        return (np.sqrt(of_added) + of_either) ** 2


def lifting(g: Constraint, form: Form, u_h: Array, flux: EdgeFlux) -> Lifting:
    """The lifting for u_h (n,), whose values on the edges that the constraint clamps are to be u_D."""
    nodal = u_h[g.mesh.boundary]
    contact = in_contact(g, _trace(nodal, np.zeros_like(nodal)), flux.push)
    contact[g.unknowns[g.clamped]] = True
    return Lifting(layer(g.mesh), g, form, contact, flux.ends)


def _trace(nodal: Array, bubbles: Array) -> Array:
    """(2 nb,) values at the boundary nodes, then at the midpoints of the edges."""
    return np.concatenate([nodal, 0.5 * (nodal + np.roll(nodal, -1)) + bubbles])


def _coefficients(trace: Array) -> tuple[Array, Array]:
    """(nb,), (nb,) the coefficients of hats and of bubbles with that trace (2 nb,)."""
    nodal, middle = np.split(trace, 2)
    return nodal, middle - 0.5 * (nodal + np.roll(nodal, -1))
