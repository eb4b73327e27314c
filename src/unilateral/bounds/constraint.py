"""The constraint v >= g on the boundary edges of a mesh, for v of P2: g as a piecewise polynomial p on them.

On clamped edges it is v = u_D, and p is near u_D.

On every edge p is known at Gauss points of intervals, which determine a polynomial; its sign there is found
from its coefficients in Bernstein's basis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.form import Form
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.problems.obstacle_and_flux import Obstacle
from unilateral.problems.piecewise import ORDER, PLACES

PARTS = 8
"""Every edge is cut into this many equal intervals, on each of which the sign of p - v is asked for."""
SLOPE = 2 * ORDER**2 * PARTS
"""The steepest slope, per edge length, of a polynomial of degree ORDER of size 1 on a PARTS-th of an edge.

That is Markov's inequality. So rounding of p by an amount changes slopes by this times that amount.
"""
ON_INTERVALS = ("edge", "x", "weight", "p", "slope", "doubt", "upper")
"""The fields of a `Constraint` that are given for each interval."""


@dataclass(frozen=True, eq=False)
class Constraint:
    """g on the boundary edges of a mesh; edges on free sides are left out.

    The unknowns of P2 on the boundary are those at its nodes, then those at the midpoints of its edges;
    `unknowns` (nb, 3) are the ones at the start, the end and the midpoint of every edge. `at_unknowns`
    (2 nb,) is p at these, -inf where there is no p. `jumps` (nb,) says whether p is smaller at an end of
    the edge than on the edge before or after, by more than p of data that fit together can be there
    (`allowed_jumps`), or whether rounding hides that. So it may be at a clamped side, where v = u_D > g; on a
    clamped edge it is a u_D that is no trace. `rounding` (nb,) is that of p. The other fields belong to K
    intervals of edges with Q points each: the `edge` (K,); the places `x` (K, Q) in [0, 1] on it, their
    `weight`, `p` and its derivative, the `slope`; the `doubt` (K,), which includes the rounding of p; and an
    `upper` bound (K,) on g. The edges `clamped` (nb,) have v = u_D, and `steep` (nb,) bounds the L2 norm of
    the derivative of u_D - p there. `clamped_values` (n,) is u_D, as p has it, at the nodes on these edges,
    and 0 at the others.
    """

    mesh: Mesh
    unknowns: Index
    at_unknowns: Array
    jumps: Mask
    edge: Index
    x: Array
    weight: Array
    p: Array
    slope: Array
    rounding: Array
    doubt: Array
    upper: Array
    clamped: Mask
    clamped_values: Array
    steep: Array

    @cached_property
    def highest(self) -> Array:
        """(nb,) upper bounds on p plus its doubt on the edges, -inf where there is no p."""
        highest = np.full(len(self.unknowns), -np.inf)
        np.maximum.at(highest, self.edge, bernstein_bounds(self.p)[1] + self.doubt)
        return highest

    def near(self, v: Array, also: Mask) -> Constraint:
        """The constraint without edges where v (2 nb,) is above g and its doubt; those `also` (nb,) stay.

        On an edge v is at least its least coefficient in Bernstein's basis, and so are its coefficients on an
        interval; `highest` bounds p from above likewise. So on the intervals left out the coefficients of
        p - v, with the doubt and the rounding, are below 0.
        """
        start, end, middle = v[self.unknowns].T
        least = np.minimum(np.minimum(start, end), 2 * middle - 0.5 * (start + end))
        rounding = 8 * ROUNDING * np.abs(v[self.unknowns]).max(axis=1)
        of = (also | ~(self.highest + rounding <= least))[self.edge]
        return replace(self, **{name: getattr(self, name)[of] for name in ON_INTERVALS})

    def trace(self, v: Array) -> tuple[Array, Array]:
        """v and its derivative along the edges, (K, Q) each."""
        x = self.x
        start, end, middle = v[self.unknowns][self.edge].T[..., None]
        value = start * (1 - x) * (1 - 2 * x) + end * x * (2 * x - 1) + middle * 4 * x * (1 - x)
        slope = start * (4 * x - 3) + end * (4 * x - 1) + middle * 4 * (1 - 2 * x)
        return value, slope / np.diff(self.mesh.s)[self.edge][:, None]

    def integrals(self, values: Array) -> Array:
        """(nb,) integrals over the edges."""
        of = np.bincount(self.edge, np.sum(self.weight * values, axis=1), len(self.unknowns))
        return np.asarray(of, dtype=float)


def constraint(obstacle: Obstacle, mesh: Mesh, form: Form) -> Constraint:
    """The constraint v >= g on the edges with multipliers, and v = u_D on those that the form clamps."""
    clamped = form.edges(mesh)
    constrained = form.held(mesh.side) | clamped
    known = obstacle.on_edges(mesh.s, mesh.side, constrained, PARTS)
    edge = known.edge
    lengths = np.diff(mesh.s)
    start = np.arange(len(lengths))
    unknowns = np.column_stack([start, np.roll(start, -1), len(start) + start])

    # At a vertex the larger of two values of p counts, and p rises linearly along the other edge
    allowed = np.column_stack([known.allowed_jumps, np.roll(known.allowed_jumps, -1)])
    at_unknowns, rise, jumps = _at_ends(known.ends, unknowns, constrained, allowed)
    x = np.clip((known.s - mesh.s[edge][:, None]) / lengths[edge][:, None], 0.0, 1.0)
    p = known.value + (rise[edge, :1] * (1 - x) + rise[edge, 1:] * x)
    slope = known.slope + (np.diff(rise)[:, 0] / lengths)[edge][:, None]

    # p is rounded, and so are the places at which it is known
    rounding = np.zeros(len(lengths))
    moved = PLACES * np.spacing(mesh.polygon.perimeter) * np.abs(slope).max(axis=1)
    np.maximum.at(rounding, edge, ROUNDING * np.abs(p).max(axis=1) + moved)

    # u_D at a node is p on the edge that begins there, if that is clamped
    clamped_values = np.zeros(mesh.n_nodes)
    clamped_values[np.roll(mesh.boundary, -1)[clamped]] = known.ends[clamped, 1]
    clamped_values[mesh.boundary[clamped]] = known.ends[clamped, 0]

    # On clamped edges the squares of |u_D' - p'|, with what a change of p by its rounding makes of p'
    changed = np.where(clamped, SLOPE * ((rounding + rise.max(axis=1)) / lengths), 0.0)[edge]
    steep = 2 * known.half * (known.steep + changed) ** 2
    steep += np.minimum(2 * known.half, 2 * known.reach) * (known.kinks + changed) ** 2
    return Constraint(
        mesh,
        unknowns,
        at_unknowns,
        jumps,
        edge,
        x=x,
        weight=known.half[:, None] * known.weights,
        p=p,
        slope=slope,
        rounding=rounding,
        doubt=known.doubt + 2 * rounding[edge] + rise.max(axis=1)[edge],
        upper=known.upper,
        clamped=clamped,
        clamped_values=clamped_values,
        steep=np.sqrt(np.bincount(edge, steep, len(lengths))),
    )


def _at_ends(on_edges: Array, unknowns: Index, on: Mask, allowed: Array) -> tuple[Array, Array, Mask]:
    """p (n,) at the unknowns, what p is raised by at the edges' ends (nb, 2), and where it jumps (nb,).

    p has the values `on_edges` (nb, 3). At a vertex the larger of two values counts. If the other one lacks
    what is `allowed` (nb, 2), that is added to p linearly along its edge, or else w (`feasible`) would not
    vanish at the vertex. If it lacks more, p jumps.
    """
    at_unknowns = np.full(unknowns.max() + 1, -np.inf)
    np.maximum.at(at_unknowns, unknowns[on], on_edges[on])
    lacking = np.full((len(on), 2), np.inf)
    lacking[on] = at_unknowns[unknowns[on, :2]] - on_edges[on, :2]
    jumps = np.any(lacking > allowed, axis=1)
    rise = np.where(jumps[:, None], 0.0, lacking)
    at_unknowns[unknowns[:, 2]] += rise.mean(axis=1)
    return at_unknowns, rise, jumps


@cache
def _to_bernstein() -> Array:
    """Coefficients in Bernstein's basis of degree ORDER from the values at Gauss points."""
    x = 0.5 * (np.polynomial.legendre.leggauss(ORDER + 1)[0] + 1)
    k = np.arange(ORDER + 1)
    binomials = np.array([math.comb(ORDER, i) for i in range(ORDER + 1)])
    return np.asarray(np.linalg.inv(binomials * x[:, None] ** k * (1 - x[:, None]) ** (ORDER - k)))


ROUNDING = 4 * EPS * float(np.abs(_to_bernstein()).sum(axis=1).max())
"""The rounding of the coefficients of p in Bernstein's basis, as a multiple of the largest |p|."""


def bernstein_bounds(values: Array) -> tuple[Array, Array]:
    """(K,), (K,) lower and upper bounds on the polynomials with the values (K, Q) at Gauss points."""
    coefficients = values @ _to_bernstein().T
    return coefficients.min(axis=1), coefficients.max(axis=1)
