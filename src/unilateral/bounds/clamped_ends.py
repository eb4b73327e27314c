"""What the bounds know of the ends of clamped sides, for forces and reactions next to them (`forces`).

lambda is a functional of functions that vanish on clamped sides. Near a vertex between such a side and one
with contact, forces can only be told from reactions where lambda is known to be small. With the feasible v
of `local_bounds`, its residual R, and S at least the norm of R on functions that vanish on clamped sides,

    |||u - v|||^2 = R(u - v) + <lambda - sigma, u - v>
                 <= S |||u - v||| + <lambda, u - v> + <sigma, v - g>,

since <sigma, u - g> >= 0. Let v - g be at least gamma on a part of the boundary, and w have values from 0 to
1 and vanish on the rest. v - gamma w is admissible, so <lambda, u - v> <= -gamma <lambda, w>, and

    gamma <lambda, w> <= <sigma, v - g> + S^2 / 4.

The right side is small. The integral of lambda over that part is at most this over gamma (supplement,
Proposition S16).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.boundary_flux import EdgeFlux
from unilateral.bounds.feasible import Lifting
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh

ADDED = 4.0
"""v is below u_h at a node by less than this times the larger doubt of the edges there, see `feasible`."""
HALF = 0.5
"""Of a side with contact the part at a clamped vertex counts on which the gap is this part of that there."""


class ClampedEnds(NamedTuple):
    """For every vertex, (n,) each, how far the gap is at least `gamma` along the side with contact there.

    `reach` is 0 where no clamped side meets one with contact, and where nothing is known. `product` is at
    least the integral of lambda over such a part, times its gamma.
    """

    reach: Array
    gamma: Array
    product: float


def none(n: int) -> ClampedEnds:
    """That of a polygon with n sides, none of which is clamped."""
    return ClampedEnds(np.zeros(n), np.ones(n), 0.0)


class Clamps(NamedTuple):
    """What is known of clamped sides: the form, and the `outflows` (2, n) and the `ends` of a `Bound`.

    `bound` is the bound on the functional of reactions, which is `of_fluxes` of the bounds. The `balance` is
    that of `forces`, if c = 0.
    """

    form: Form
    outflows: Array
    ends: ClampedEnds
    bound: float
    balance: tuple[float, float] | None = None

    @property
    def depth(self) -> float:
        """The length d in N(w)^2 = k (|w|_1^2 + d^-2 ||w||_0^2): the smaller of (k/c)^(1/2) and C.

        C is Friedrichs' constant. N is the norm on H^1 by which reactions are bounded (`forces`); on
        functions that vanish on clamped sides it is at least the energy norm.
        """
        return float(max(self.form.c / self.form.k, self.form.friedrichs**-2) ** -0.5)


def unclamped(n: int) -> Clamps:
    """That of a polygon with n sides, none of which is clamped."""
    return Clamps(H1, np.zeros((2, n)), none(n), 0.0)


def clamped_ends(
    mesh: Mesh, form: Form, lift: Lifting, u_h: Array, flux: EdgeFlux, product: float
) -> ClampedEnds:
    """Those of u_h (n,), with its lifting; v is not below u_h where there is no contact."""
    n = mesh.polygon.n_sides
    found = none(n)._replace(product=product)
    upper = np.full(len(mesh.side), -np.inf)
    doubt = np.zeros(len(mesh.side))
    np.maximum.at(upper, lift.g.edge, lift.g.upper)
    np.maximum.at(doubt, lift.g.edge, lift.g.doubt)
    # v is lowered at a node by the larger doubt of the two edges there, and one of them may be clamped
    lowered = ADDED * np.maximum(doubt, np.maximum(np.roll(doubt, 1), np.roll(doubt, -1)))
    trace = u_h[mesh.boundary]
    gap = np.minimum(trace, np.roll(trace, -1)) - upper - lowered
    pushed = flux.push > 0
    gap[pushed | np.roll(pushed, 1) | np.roll(pushed, -1)] = 0.0
    clamped = np.isin(np.arange(n), form.clamped)
    lengths = np.diff(mesh.s)
    for vertex in np.flatnonzero(clamped != np.roll(clamped, 1)).tolist():
        side = (vertex - 1) % n if clamped[vertex] else vertex
        edges = np.flatnonzero(mesh.side == side)[:: -1 if clamped[vertex] else 1]
        wide = gap[edges] > HALF * max(gap[edges[0]], 0.0)
        edges = edges[: len(edges) if wide.all() else int(np.argmin(wide))]
        if edges.size and np.isfinite(gap[edges]).all():
            found.reach[vertex] = lengths[edges].sum()
            found.gamma[vertex] = gap[edges].min()
    return found


def outflows(mesh: Mesh, form: Form, q: Array) -> Array:
    """(2, n) the integrals of q.n over the clamped sides, 0 on others, for q as `equilibrated` gives it.

    Beside them are the sums of their magnitudes on edges, which rounding is measured by.
    """
    through = -q[0, mesh.triangulation.boundary] * form.edges(mesh)
    n = mesh.polygon.n_sides
    return np.array([np.bincount(mesh.side, each, n) for each in (through, np.abs(through))])


def place(mesh: Mesh, vertex: int) -> int:
    """The place of that vertex of the polygon in `mesh.boundary`."""
    return int(np.searchsorted(mesh.side, vertex))


def inside_reach(mesh: Mesh, vertex: int, clamps: Clamps) -> Index:
    """The places in `mesh.boundary` of nodes on the side with contact whose next edges lie within reach."""
    forward = vertex not in clamps.form.clamped
    edges = np.flatnonzero(mesh.side == (vertex if forward else (vertex - 1) % mesh.polygon.n_sides))
    edges = edges if forward else edges[::-1]
    within = np.cumsum(np.diff(mesh.s)[edges]) <= clamps.ends.reach[vertex]
    return edges[1:][within[1:]] if forward else edges[:-1][within[1:]]


def conflicts(part: Index, clamps: Clamps) -> list[tuple[int, int]]:
    """The vertices between a clamped side and one with contact at which the part ends.

    Each comes with the bound for which w cannot pass from one side to the other: 0 is that below, 1 above.
    """
    found = []
    n = len(clamps.ends.reach)
    for vertex in range(n):
        pair = {vertex, (vertex - 1) % n}
        inside = pair & {*part.tolist()}
        clamped = pair & {*clamps.form.clamped}
        if len(inside) == len(clamped) == 1 and not pair & {*clamps.form.free}:
            found.append((vertex, int(inside != clamped)))
    return found


def missing(mesh: Mesh, part: Index, clamps: Clamps) -> tuple[float, float]:
    """What the bounds below and above lack for their `conflicts`, at the ends of the part."""
    most = [0.0, 0.0]
    edges = np.diff(mesh.s)
    for vertex, which in conflicts(part, clamps):
        first = edges[place(mesh, vertex) - (vertex in clamps.form.clamped)]
        known = first <= clamps.ends.reach[vertex]
        amount = clamps.ends.product / clamps.ends.gamma[vertex] if known else np.inf
        most[which] = max(most[which], amount)
    return most[0], most[1]
