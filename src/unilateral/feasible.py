"""A P2 function v made to satisfy v >= g: which of its values are those of g, and what is still missing.

At the nodes and midpoints of the boundary edges v >= g is arranged by raising values, and along edges with a
singular point of the data by raising the midpoint. On every other edge r = (g - v)_+ is left, and where v = g
at both ends and at the midpoint r = g - v of any sign, so that v + r = g there. r vanishes at the ends of its
edge e. Its extension w into the triangle T at e, homogeneous of degree 1 about the vertex off e, then
vanishes on the other edges of T. With k the height of T over e and p the foot of that vertex on e,

    |w|_{1,T}^2 = (k ||r'||_e^2 + (||(s - p) r'||_e^2 + 2 ||r||_e^2) / k) / 2,   ||w||_T^2 = k ||r||_e^2 / 4,

for w(p + t (s - p), k (1 - t)) = t r(s) has the gradient (r', ((s - p) r' - r) / k) and dx dy is t k ds dt.
Where g is smooth r' = O(h^2), and ||w||_1 = O(h^{5/2}).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from unilateral.mesh import Mesh
from unilateral.quadrature import boundary_rule
from unilateral.splitting import Irregular

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
ON_POINT = 1e-12
"""Of the perimeter: how far from an edge a singular point still counts as one of its points."""
ROUNDING = 1e-13
"""Of |g|: what of g - v counts as 0."""
SPARE = 1.05
"""The factor on what a midpoint is raised by, found at the points of a rule: v > g between them, too."""


class Obstacle(Irregular, Protocol):
    """g of a unilateral problem."""

    def obstacle(self, side: Index, s: Array) -> tuple[Array, Array]:
        """g and its derivative along the side, (k,) each, at the arc lengths s of the sides."""


class Missing(NamedTuple):
    """||w||_1 for the w that is to be added, and the moments (nb, 2) of v + w - g with the edges' hats."""

    norm: float
    slack: Array


@dataclass(frozen=True, eq=False)
class Constraint:
    """g on the boundary edges of a mesh, those on free sides left out.

    `unknowns` (nb, 3) are P2's at the start, the end and the midpoint of every edge; `at_unknowns` (n,) is g
    there, -inf where there is none. At the Q points of a rule: the edge, the place x in [0, 1] on it, the
    weight, g and its derivative. `jumps` (nb,): g differs from the one on the side before or after at an end;
    `singular` (nb,): a singular point of the data lies on the edge.
    """

    mesh: Mesh
    unknowns: Index
    at_unknowns: Array
    edge: Index
    x: Array
    weight: Array
    g: Array
    slope: Array
    jumps: Mask
    singular: Mask

    def lifted(self, v: Array) -> Array:
        """v (n,) raised until v >= g at the unknowns and along the edges with singular points."""
        raised = np.maximum(v, self.at_unknowns)
        below = self.g - self._trace(raised)[0]
        bubble = 4 * self.x * (1 - self.x)
        ratio = np.divide(below, bubble, out=np.zeros_like(below), where=self._counts(below) & (bubble > 0))
        by = np.zeros(len(self.unknowns))
        np.maximum.at(by, self.edge, ratio)
        raised[self.unknowns[self.singular, 2]] += SPARE * by[self.singular]
        return raised

    def missing(self, v: Array, contact: Mask, triangle: Index) -> Missing:
        """What a lifted v (n,) is short of; v = g at the unknowns in `contact` (n,)."""
        value, slope = self._trace(v)
        below = self.g - value
        on_g = contact[self.unknowns].all(axis=1) & ~self.singular & ~self.jumps
        counts = on_g[self.edge] | self._counts(below)
        r, r_prime = np.where(counts, below, 0.0), np.where(counts, self.slope - slope, 0.0)
        foot, height = _vertex_off_edge(self.mesh, triangle)
        arm = self.x * np.diff(self.mesh.s)[self.edge] - foot[self.edge]
        of_r, of_slope, of_arm = (self._integrals(y**2) for y in (r, r_prime, arm * r_prime))
        squares = 0.5 * (height * of_slope + (of_arm + 2 * of_r) / height) + 0.25 * height * of_r
        shared = np.bincount(triangle, minlength=len(self.mesh.triangles))[triangle]
        slack = [self._integrals(shape * (r - below)) for shape in (1 - self.x, self.x)]
        return Missing(math.sqrt(float(shared @ squares)), np.column_stack(slack))

    def _counts(self, below: Array) -> Mask:
        return below > ROUNDING * np.abs(self.g)

    def _trace(self, v: Array) -> tuple[Array, Array]:
        """v and its derivative along the edges, (Q,) each."""
        x, (start, end, middle) = self.x, v[self.unknowns][self.edge].T
        value = start * (1 - x) * (1 - 2 * x) + end * x * (2 * x - 1) + middle * 4 * x * (1 - x)
        slope = start * (4 * x - 3) + end * (4 * x - 1) + middle * 4 * (1 - 2 * x)
        return value, slope / np.diff(self.mesh.s)[self.edge]

    def _integrals(self, values: Array) -> Array:
        return np.bincount(self.edge, self.weight * values, len(self.unknowns)).astype(float)


def constraint(problem: Obstacle, mesh: Mesh, unknowns: Index, n: int, on: Mask) -> Constraint:
    """The constraint v >= g on the edges `on` (nb,) for P2 with n unknowns, those (nb, 3) on the edges."""
    lengths = np.diff(mesh.s)
    start = mesh.s[:-1] - mesh.polygon.starts[mesh.side]
    rule = boundary_rule(mesh.polygon, mesh.s, problem.singular())
    held = on[rule.interval]
    edge, s, side, weight = _with_places(
        mesh, problem, on, (rule.interval[held], rule.s[held], rule.side[held], rule.weight[held])
    )
    g, slope = problem.obstacle(side, s)
    places = np.stack([start, start + lengths, start + 0.5 * lengths], axis=1)
    on_edges = problem.obstacle(np.repeat(mesh.side, 3), places.ravel())[0].reshape(-1, 3)
    on_edges[~on] = -np.inf
    at_unknowns = np.full(n, -np.inf)
    np.maximum.at(at_unknowns, unknowns, on_edges)
    tolerance = ROUNDING * np.max(np.abs(g), initial=0.0)
    return Constraint(
        mesh,
        unknowns,
        at_unknowns,
        edge,
        x=np.clip((s - start[edge]) / lengths[edge], 0.0, 1.0),
        weight=weight,
        g=g,
        slope=slope,
        jumps=np.any(at_unknowns[unknowns] > on_edges + tolerance, axis=1),
        singular=_with_points(mesh, [mesh.polygon.arc_length(p.side, p.t) for p in problem.singular()]),
    )


def _with_places(
    mesh: Mesh, problem: Obstacle, on: Mask, rule: tuple[Index, Array, Index, Array]
) -> tuple[Index, Array, Index, Array]:
    """A rule with the singular points, of weight 0, where g may peak: edges, arc lengths, sides, weights."""
    points, lengths = problem.singular(), mesh.polygon.lengths
    side = np.array([point.side for point in points], dtype=np.intp)
    s = np.array([point.t for point in points]) * lengths[side]
    edge = np.searchsorted(mesh.s, mesh.polygon.starts[side] + s, side="right") - 1
    edge = np.minimum(edge, len(mesh.side) - 1)
    kept = on[edge] & (mesh.side[edge] == side)
    places = (edge[kept], s[kept], side[kept], np.zeros(np.count_nonzero(kept)))
    edge, s, side, weight = (np.append(*pair) for pair in zip(rule, places, strict=True))
    return edge, s, side, weight


def _with_points(mesh: Mesh, points: list[float]) -> Mask:
    """(nb,) the edges on which one of the points lies, in arc length."""
    perimeter = mesh.polygon.perimeter
    near = ON_POINT * perimeter
    at = np.sort(np.add.outer(np.array(points), [-perimeter, 0.0, perimeter]).ravel())
    first, last = np.searchsorted(at, mesh.s[:-1] - near), np.searchsorted(at, mesh.s[1:] + near)
    return last > first


def _vertex_off_edge(mesh: Mesh, triangle: Index) -> tuple[Array, Array]:
    """(nb,), (nb,) the triangles' vertices off the edges: their place along the edge, their distance."""
    start, end = mesh.boundary, np.roll(mesh.boundary, -1)
    off = mesh.points[mesh.triangles[triangle].sum(axis=1) - start - end] - mesh.points[start]
    along = np.sum(off * mesh.polygon.tangents[mesh.side], axis=1)
    return along, -np.sum(off * mesh.polygon.normals[mesh.side], axis=1)
