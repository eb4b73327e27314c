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
from unilateral.problems.obstacle_and_flux import EdgePolynomials, Obstacle
from unilateral.problems.piecewise import ARC_LENGTH_ERROR_ULPS, PIECE_DEGREE

INTERVALS_PER_EDGE = 8
"""Every edge is cut into this many equal intervals, on each of which the sign of p - v is asked for."""
MARKOV_SLOPE = 2 * PIECE_DEGREE**2 * INTERVALS_PER_EDGE
"""The steepest slope, per edge length, of a polynomial of size 1 on an interval (Markov's inequality)."""
INTERVAL_FIELDS = ("edge", "x", "weight", "p", "slope", "remainder", "g_upper")
"""The fields of a `Constraint` that are given for each interval."""


@dataclass(frozen=True, eq=False)
class Constraint:
    """g on the boundary edges of a mesh; edges on free sides are left out.

    The unknowns of P2 on the boundary are those at its nodes, then those at the midpoints of its edges;
    `unknowns` (nb, 3) are the ones at the start, the end and the midpoint of every edge. `p_at_unknowns` (2
    nb,) is p at these, -inf where there is no p. `has_jump` (nb,) says whether p is smaller at an end of the
    edge than on the edge before or after, by more than p of data that fit together can be there, or whether
    rounding hides that. At an end of a clamped side that is u_D > g; on a clamped edge it means that u_D is
    no trace. `rounding` (nb,) is the rounding of p.

    The fields from `edge` to `slope`, `remainder` and `g_upper` belong to K intervals of edges with Q points
    each: the `edge` (K,); the places `x` (K, Q) in [0, 1] on it, their `weight`, `p` and its derivative, the
    `slope`; the `remainder` (K,), which includes the rounding of p; and `g_upper` (K,), an upper bound on g.

    The edges `clamped_edges` (nb,) have v = u_D; `slope_remainder` (nb,) bounds the L2 norm of the derivative
    of u_D - p there. `clamped_values` (n,) is u_D, as p has it, at the nodes on these edges, else 0.
    """

    mesh: Mesh
    unknowns: Index
    p_at_unknowns: Array
    has_jump: Mask
    edge: Index
    x: Array
    weight: Array
    p: Array
    slope: Array
    rounding: Array
    remainder: Array
    g_upper: Array
    clamped_edges: Mask
    clamped_values: Array
    slope_remainder: Array

    @cached_property
    def p_upper(self) -> Array:
        """An upper bound on p plus its remainder on each boundary edge, -inf where there is no p, (nb,)."""
        highest = np.full(len(self.unknowns), -np.inf)
        np.maximum.at(highest, self.edge, bernstein_bounds(self.p)[1] + self.remainder)
        return highest

    def select_near_edges(self, v: Array, always: Mask) -> Constraint:
        """The constraint without edges where v (2 nb,) is above g and its remainder; `always` (nb,) stay.

        On an edge v is at least its least coefficient in Bernstein's basis, and so are its coefficients on an
        interval; `p_upper` bounds p from above likewise. So on the intervals left out the coefficients of
        p - v, with the remainder and the rounding, are below 0.
        """
        start, end, middle = v[self.unknowns].T
        v_lower = quadratic_lower_bounds(start, end, middle)
        rounding = 8 * BERNSTEIN_ROUNDING * np.abs(v[self.unknowns]).max(axis=1)
        selection = (always | ~(self.p_upper + rounding <= v_lower))[self.edge]
        return replace(self, **{name: getattr(self, name)[selection] for name in INTERVAL_FIELDS})

    def trace_and_slope(self, v: Array) -> tuple[Array, Array]:
        """v (2 nb,) and its derivative along the edges at the intervals' points, (K, Q) each."""
        # the shape functions of P2 on [0, 1], and their derivatives
        x = self.x
        start, end, middle = v[self.unknowns][self.edge].T[..., None]
        value = start * (1 - x) * (1 - 2 * x) + end * x * (2 * x - 1) + middle * 4 * x * (1 - x)
        slope = start * (4 * x - 3) + end * (4 * x - 1) + middle * 4 * (1 - 2 * x)
        return value, slope / np.diff(self.mesh.s)[self.edge][:, None]

    def edge_integrals(self, values: Array) -> Array:
        """The integrals (nb,) over the boundary edges of a function with these `values` (K, Q)."""
        integrals = np.bincount(self.edge, np.sum(self.weight * values, axis=1), len(self.unknowns))
        return np.asarray(integrals, dtype=float)


def build_constraint(obstacle: Obstacle, mesh: Mesh, form: Form) -> Constraint:
    """The constraint v >= g on the edges with multipliers, and v = u_D on those that the form clamps."""
    clamped = form.clamped_edges(mesh)
    constrained = form.has_multiplier(mesh.side) | clamped
    samples = obstacle.sample_on_edges(mesh.s, mesh.side, constrained, INTERVALS_PER_EDGE)
    edge = samples.edge
    lengths = np.diff(mesh.s)
    nodes = np.arange(len(lengths))
    unknowns = np.column_stack([nodes, np.roll(nodes, -1), len(nodes) + nodes])

    # at a vertex the larger of two values of p counts, and p rises linearly along the other edge
    p_at_unknowns, rise, has_jump = _join_at_vertices(
        samples.ends, unknowns, constrained, allowed_jumps=samples.allowed_jumps[unknowns[:, :2]]
    )
    x = np.clip((samples.s - mesh.s[edge][:, None]) / lengths[edge][:, None], 0.0, 1.0)
    p = samples.value + (rise[edge, :1] * (1 - x) + rise[edge, 1:] * x)
    slope = samples.slope + (np.diff(rise)[:, 0] / lengths)[edge][:, None]
    rounding = _p_rounding(mesh, edge, p, slope)
    return Constraint(
        mesh,
        unknowns,
        p_at_unknowns,
        has_jump,
        edge,
        x=x,
        weight=samples.half_length[:, None] * samples.weights,
        p=p,
        slope=slope,
        rounding=rounding,
        # `feasible` takes p less its rounding: twice the rounding may be missing
        remainder=samples.remainder + 2 * rounding[edge] + rise.max(axis=1)[edge],
        g_upper=samples.upper,
        clamped_edges=clamped,
        clamped_values=_collect_clamped_values(mesh, clamped, samples.ends),
        slope_remainder=_bound_slope_remainder(
            samples, lengths, p_change=np.where(clamped, rounding + rise.max(axis=1), 0.0)
        ),
    )


def _collect_clamped_values(mesh: Mesh, clamped: Mask, edge_values: Array) -> Array:
    """u_D at the nodes of the `clamped` edges, 0 at others, (n,); p has `edge_values` at the edges' ends."""
    # u_D at a node is p on the edge that begins there, if that is clamped, else on the one that ends there
    clamped_values = np.zeros(mesh.n_nodes)
    clamped_values[np.roll(mesh.boundary, -1)[clamped]] = edge_values[clamped, 1]
    clamped_values[mesh.boundary[clamped]] = edge_values[clamped, 0]
    return clamped_values


def _join_at_vertices(
    edge_values: Array, unknowns: Index, constrained: Mask, allowed_jumps: Array
) -> tuple[Array, Array, Mask]:
    """p (n,) at the unknowns, what p is raised by at the edges' ends (nb, 2), and where it jumps (nb,).

    p has the values `edge_values` (nb, 3) at the start, the end and the midpoint of each edge. At a vertex
    the larger of two values counts. If the other one lacks no more than `allowed_jumps` (nb, 2), what it
    lacks is added to p linearly along its edge, or else w (`feasible`) would not vanish at the vertex. If it
    lacks more, p jumps.
    """
    p_at_unknowns = np.full(unknowns.max() + 1, -np.inf)
    np.maximum.at(p_at_unknowns, unknowns[constrained], edge_values[constrained])
    lacking = np.full((len(constrained), 2), np.inf)  # edges that are not constrained count as jumps
    lacking[constrained] = p_at_unknowns[unknowns[constrained, :2]] - edge_values[constrained, :2]
    has_jump = np.any(lacking > allowed_jumps, axis=1)
    rise = np.where(has_jump[:, None], 0.0, lacking)
    p_at_unknowns[unknowns[:, 2]] += rise.mean(axis=1)
    return p_at_unknowns, rise, has_jump


def _p_rounding(mesh: Mesh, edge: Index, p: Array, slope: Array) -> Array:
    """The rounding of p on the boundary edges, and of the places at which it is known, (nb,)."""
    rounding = np.zeros(len(mesh.boundary))
    place_rounding = ARC_LENGTH_ERROR_ULPS * np.spacing(mesh.polygon.perimeter) * np.abs(slope).max(axis=1)
    np.maximum.at(rounding, edge, BERNSTEIN_ROUNDING * np.abs(p).max(axis=1) + place_rounding)
    return rounding


def _bound_slope_remainder(samples: EdgePolynomials, lengths: Array, p_change: Array) -> Array:
    """Bounds on the L2 norms of u_D' - p' over the boundary edges, (nb,).

    The samples have bounds on |u_D' - p'| for p before it changed by up to `p_change` (nb,), and other bounds
    near ends of pieces, within the `reach` of places that are rounded.
    """
    slope_rounding = (MARKOV_SLOPE * (p_change / lengths))[samples.edge]
    slope_squares = 2 * samples.half_length * (samples.slope_remainder + slope_rounding) ** 2
    near_ends = np.minimum(2 * samples.half_length, 2 * samples.reach)
    slope_squares += near_ends * (samples.end_slope_remainder + slope_rounding) ** 2
    return np.sqrt(np.bincount(samples.edge, slope_squares, len(lengths)))


@cache
def _bernstein_matrix() -> Array:
    """The matrix from values at PIECE_DEGREE + 1 Gauss points to the coefficients in Bernstein's basis."""
    x = 0.5 * (np.polynomial.legendre.leggauss(PIECE_DEGREE + 1)[0] + 1)
    k = np.arange(PIECE_DEGREE + 1)
    binomials = np.array([math.comb(PIECE_DEGREE, i) for i in range(PIECE_DEGREE + 1)])
    return np.asarray(np.linalg.inv(binomials * x[:, None] ** k * (1 - x[:, None]) ** (PIECE_DEGREE - k)))


def quadratic_lower_bounds(start: Array, end: Array, middle: Array) -> Array:
    """Lower bounds on quadratic functions on edges, from their values at the ends and the midpoints."""
    # the least coefficient in Bernstein's basis, where these are v(a), v(b) and 2 v(m) - (v(a) + v(b)) / 2
    return np.minimum(np.minimum(start, end), 2 * middle - 0.5 * (start + end))


BERNSTEIN_ROUNDING = 4 * EPS * float(np.abs(_bernstein_matrix()).sum(axis=1).max())
"""The rounding of the coefficients of p in Bernstein's basis, as a multiple of the largest |p|."""


def bernstein_bounds(values: Array) -> tuple[Array, Array]:
    """Lower and upper bounds on polynomials, from their `values` (K, Q) at Gauss points, (K,) each."""
    coefficients = values @ _bernstein_matrix().T
    return coefficients.min(axis=1), coefficients.max(axis=1)
