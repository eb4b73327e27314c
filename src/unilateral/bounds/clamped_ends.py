"""What the bounds know of the ends of clamped sides, for forces and reactions next to them (`forces`).

Near a vertex between a clamped side and one with contact, forces can only be told from reactions where lambda
is known to be small. With the feasible v of `local_bounds`, its residual R, and S at least the norm of R on
functions that vanish on clamped sides,

    |||u - v|||^2 = R(u - v) + <lambda - sigma, u - v> <= S |||u - v||| + <lambda, u - v> + <sigma, v - g>,

since <sigma, u - g> >= 0. Let v - g be at least gamma on a part of the boundary, and w have values from 0 to
1 and vanish on the rest. v - gamma w is admissible, so <lambda, u - v> <= -gamma <lambda, w>, and

    gamma <lambda, w> <= <sigma, v - g> + S^2 / 4.

So the integral of lambda over that part is at most this over gamma (supplement, Proposition S16).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.boundary_flux import NormalFlux
from unilateral.bounds.feasible import Lifting
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh

LOWERING_PER_REMAINDER = 4.0
"""At a node v is below u_h by less than this times the larger remainder on the edges there."""
MIN_GAP_FRACTION = 0.5
"""Of a side with contact the part at a clamped vertex counts on which the gap is this part of that there."""


class ClampedEnds(NamedTuple):
    """For every vertex, (n,) each, how far the gap is at least `gamma` along the side with contact there.

    `gap_length` is 0 where no clamped side meets one with contact, and where nothing is known.
    `gamma_force_bound` is at least the integral of lambda over such a part, times its gamma.
    """

    gap_length: Array
    gamma: Array
    gamma_force_bound: float


def no_clamped_ends(n: int) -> ClampedEnds:
    """The ClampedEnds of a polygon with n sides at whose vertices nothing is known."""
    return ClampedEnds(np.zeros(n), np.ones(n), 0.0)


class ReactionData(NamedTuple):
    """What is known of clamped sides: the form, and `outflows` (2, n) and `clamped_ends` of a `Bound`.

    `reaction_bound` is that of the `Bound`; the `total_force` is that of `enclose_total_force`, if c = 0.
    """

    form: Form
    outflows: Array
    clamped_ends: ClampedEnds
    reaction_bound: float
    total_force: tuple[float, float] | None = None

    @property
    def depth(self) -> float:
        """The length d in N(w)^2 = k (|w|_1^2 + d^-2 ||w||_0^2): the smaller of (k/c)^(1/2) and C.

        C is Friedrichs' constant. N is the norm on H^1 by which reactions are bounded (`forces`); on
        functions that vanish on clamped sides it is at least the energy norm.
        """
        return float(max(self.form.c / self.form.k, self.form.friedrichs**-2) ** -0.5)


def no_reactions(n: int) -> ReactionData:
    """The ReactionData of a polygon with n sides, none of which is clamped."""
    return ReactionData(H1, np.zeros((2, n)), no_clamped_ends(n), 0.0)


def find_clamped_ends(
    mesh: Mesh,
    form: Form,
    lifting: Lifting,
    v_lower: Array,
    normal_flux: NormalFlux,
    gamma_force_bound: float,
) -> ClampedEnds:
    """How far v - g is known to be positive on the sides with contact beside clamped ones.

    `v_lower` (nb,) is a lower bound on the trace of u_h + y on each edge, by the hats and bubbles of y.
    """
    n = mesh.polygon.n_sides
    clamped_ends = no_clamped_ends(n)._replace(gamma_force_bound=gamma_force_bound)
    gap = _bound_edge_gaps(mesh, lifting, v_lower, normal_flux)
    clamped = np.isin(np.arange(n), form.clamped)
    lengths = np.diff(mesh.s)
    # from each vertex between a clamped side and another one along this, as long as the gap is wide
    for vertex in np.flatnonzero(clamped != np.roll(clamped, 1)).tolist():
        side = (vertex - 1) % n if clamped[vertex] else vertex
        edges = np.flatnonzero(mesh.side == side)[:: -1 if clamped[vertex] else 1]
        wide = gap[edges] > MIN_GAP_FRACTION * max(gap[edges[0]], 0.0)
        edges = edges[: len(edges) if wide.all() else int(np.argmin(wide))]
        # on a free side the gap is infinite: there is no g
        if edges.size and np.isfinite(gap[edges]).all():
            clamped_ends.gap_length[vertex] = lengths[edges].sum()
            clamped_ends.gamma[vertex] = gap[edges].min()
    return clamped_ends


def _bound_edge_gaps(mesh: Mesh, lifting: Lifting, v_lower: Array, normal_flux: NormalFlux) -> Array:
    """A lower bound on v - g on each boundary edge, (nb,): 0 in contact and beside it, infinite without g.

    v is less than `v_lower` (nb,) by what is subtracted at nodes for the remainder of g, and more by w >= 0.
    Clamped edges have u_D for g; their numbers are not used, but their remainders lower v at the vertex.
    """
    upper = np.full(len(mesh.side), -np.inf)
    remainder = np.zeros(len(mesh.side))
    np.maximum.at(upper, lifting.constraint.edge, lifting.constraint.g_upper)
    np.maximum.at(remainder, lifting.constraint.edge, lifting.constraint.remainder)
    # v is lowered at a node by the larger remainder of the two edges there, and one of them may be clamped
    beside = np.maximum(np.roll(remainder, 1), np.roll(remainder, -1))
    lowered = LOWERING_PER_REMAINDER * np.maximum(remainder, beside)
    gap = v_lower - upper - lowered
    # in contact v is p at the nodes: all that is known on its edges, and on those beside them, is v >= g
    in_contact = normal_flux.contact_scale > 0
    gap[in_contact | np.roll(in_contact, 1) | np.roll(in_contact, -1)] = 0.0
    return gap


def outflows(mesh: Mesh, form: Form, q: Array) -> Array:
    """The integrals of q.n over clamped sides, 0 on others, and the sums of their sizes on edges, (2, n).

    Rounding is measured by the sizes.
    """
    # the flow over an edge is that to its left, which is into the domain
    outflow = -q[0, mesh.triangulation.boundary_edges] * form.clamped_edges(mesh)
    n = mesh.polygon.n_sides
    return np.array([np.bincount(mesh.side, values, n) for values in (outflow, np.abs(outflow))])


def boundary_index(mesh: Mesh, vertex: int) -> int:
    """The place of that vertex of the polygon in `mesh.boundary`."""
    return int(np.searchsorted(mesh.side, vertex))


def first_contact_edge(mesh: Mesh, vertex: int, form: Form) -> int:
    """The boundary edge at a vertex between a clamped side and one with contact that lies on the latter."""
    # edge i begins at boundary node i: the side with contact begins at the vertex, or ends there
    return boundary_index(mesh, vertex) - (vertex in form.clamped)


def gap_nodes(mesh: Mesh, vertex: int, reactions: ReactionData) -> Index:
    """The places in `mesh.boundary` of nodes on the side with contact, both edges within the `gap_length`."""
    forward = vertex not in reactions.form.clamped
    edges = np.flatnonzero(mesh.side == (vertex if forward else (vertex - 1) % mesh.polygon.n_sides))
    edges = edges if forward else edges[::-1]
    within = np.cumsum(np.diff(mesh.s)[edges]) <= reactions.clamped_ends.gap_length[vertex]
    return edges[1:][within[1:]] if forward else edges[:-1][within[1:]]


def find_conflicts(sides: Index, reactions: ReactionData) -> list[tuple[int, int]]:
    """The vertices between a clamped side and one with contact at which the part ends.

    Each comes with the bound for which w cannot pass from one side to the other: 0 is that below, 1 above.
    """
    conflicts = []
    n = len(reactions.clamped_ends.gap_length)
    for vertex in range(n):
        pair = {vertex, (vertex - 1) % n}
        inside = pair & {*sides.tolist()}
        clamped = pair & {*reactions.form.clamped}
        if len(inside) == len(clamped) == 1 and not pair & {*reactions.form.free}:
            conflicts.append((vertex, int(inside != clamped)))
    return conflicts


def conflict_allowances(mesh: Mesh, sides: Index, reactions: ReactionData) -> tuple[float, float]:
    """How much the lower and the upper bound on a force lack at its conflicts."""
    allowances = [0.0, 0.0]
    ends = reactions.clamped_ends
    lengths = np.diff(mesh.s)
    for vertex, which in find_conflicts(sides, reactions):
        first_length = lengths[first_contact_edge(mesh, vertex, reactions.form)]
        # int lambda over that part is at most gamma <lambda, w> / gamma (Proposition S16); w falls on an edge
        is_bounded = first_length <= ends.gap_length[vertex]
        amount = ends.gamma_force_bound / ends.gamma[vertex] if is_bounded else np.inf
        allowances[which] = max(allowances[which], amount)
    return allowances[0], allowances[1]
