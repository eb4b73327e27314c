"""A P2 function v made to satisfy v >= g on the boundary: what changes of it, and what is missing then.

g is within `doubt` of a continuous piecewise polynomial p (`obstacle`). v is raised to p at the nodes and
midpoints of the boundary edges, or at a midpoint above p. On an edge where v is in contact r = p - v is left,
of any sign, elsewhere r = (p - v)_+, p there less its rounding; both vanish at the edge's ends. The extension
w of r into the triangle T at the edge e, homogeneous of degree 1 about the vertex off e, vanishes on the
other edges of T. With k the height of T over e and q the foot of that vertex on e,

    |w|_{1,T}^2 = (k ||r'||_e^2 + (||(s - q) r'||_e^2 + 2 ||r||_e^2) / k) / 2,   ||w||_T^2 = k ||r||_e^2 / 4,

for w(q + t (s - q), k (1 - t)) = t r(s) has the gradient (r', ((s - q) r' - r) / k) and dx dy is t k ds dt.
Where g is smooth r' = O(h^2), and ||w||_1 = O(h^{5/2}). At last a function of V_h is added that is at least
the doubt on every edge where v + w >= g needs it.

Nothing is left to quadrature. Integrals of polynomials are exact, and where the sign of p - v is not that of
all its coefficients in Bernstein's basis, that of (p - v)_+^2 is taken to be that of (p - v)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import comb

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.problems.obstacle import ORDER, Obstacle

PARTS = 8
"""Of an edge: intervals on which the sign of p - v is asked for."""
DEAR = 16.0
"""What the square of ||w||_1 counts against that of a raised midpoint. Only the sharpness depends on it."""
SPARE = 1.05
"""Times what a midpoint has to be raised at least: v > p between the points of the rule, too."""
JUMP = 1e-13
"""Of |g|: by what it has to jump at a vertex."""


class Missing(NamedTuple):
    """||w||_1, a bound of <q.n, v + w + added - g>, and the nodal values (n_nodes,) added for the doubt."""

    norm: float
    slack: float
    added: Array


class _Short(NamedTuple):
    """On every edge (nb,): bounds of ||w||_1^2 and <q.n, v + w - g>, and the doubt where v + w needs it."""

    squares: Array
    slack: Array
    doubt: Array


@dataclass(frozen=True, eq=False)
class Constraint:
    """g on the boundary edges of a mesh, those on free sides left out.

    `unknowns` (nb, 3) are P2's at the start, the end and the midpoint of every edge, `at_unknowns` (n,) is p
    there, -inf where there is none; `jumps` (nb,): p differs from that of the side before or after at an end.
    On K intervals of edges, with Q points each: the edge (K,), the places x (K, Q) in [0, 1] on it, their
    weights, p and its derivative; the doubt, in which the `rounding` (nb,) of p is, and an upper bound of g
    (K,).
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

    def raised(
        self, v: Array, contact: Mask, triangle: Index, flux: Array, stiffness: Array
    ) -> tuple[Array, Mask]:
        """v (n,), at least p at the unknowns, and (nb,) the edges on which r has any sign: what costs least.

        v = p at the unknowns in `contact` (n,), and r may have any sign where all three of an edge are; or
        there, as elsewhere, it is (p - v)_+; or the midpoint is raised above p. `stiffness` (nb,) are the
        squared norms of the midpoints' basis functions; see `missing` for the others.
        """
        v = np.maximum(v, self.at_unknowns)
        touching = contact[self.unknowns].all(axis=1) & ~self.jumps
        above, by = v.copy(), self._bubbles(v)
        above[self.unknowns[:, 2]] += by
        none = np.zeros_like(touching)
        extended, kept, lifted = (
            DEAR * short.squares + 2 * short.slack
            for short in (
                self._short(v, touching, triangle, flux),
                self._short(v, none, triangle, flux),
                self._short(above, none, triangle, flux),
            )
        )
        lifted += stiffness * by**2
        lift = lifted < np.where(touching, np.minimum(extended, kept), kept)
        v[self.unknowns[lift, 2]] = above[self.unknowns[lift, 2]]
        return v, touching & ~lift & (extended <= kept)

    def missing(self, v: Array, touching: Mask, triangle: Index, flux: Array) -> Missing:
        """What a raised v (n,) is short of; r has any sign on the edges `touching` (nb,).

        `triangle` (nb,) is the one at each edge; q.n is linear there, with the values `flux` (nb, 2) at its
        ends.
        """
        short = self._short(v, touching, triangle, flux)
        shared = np.bincount(triangle, minlength=len(self.mesh.triangles))[triangle]
        added, at_ends = np.zeros(self.mesh.n_nodes), np.maximum(short.doubt, np.roll(short.doubt, 1))
        added[self.mesh.boundary] = at_ends
        most, push = np.maximum(at_ends, np.roll(at_ends, -1)), 0.5 * np.diff(self.mesh.s) * flux.sum(axis=1)
        slack = float(short.slack.sum() + most @ push)
        return Missing(math.sqrt(float(shared @ short.squares)), slack, added)

    def _bubbles(self, v: Array) -> Array:
        """(nb,) by how much midpoints have to be raised for v > p, seen at the points of the rule."""
        by, bubble = np.zeros(len(self.unknowns)), 4 * self.x * (1 - self.x)
        ratio = np.where(bubble > 0, (self.p - self._trace(v)[0]) / np.where(bubble > 0, bubble, 1.0), 0.0)
        np.maximum.at(by, self.edge, np.max(ratio, axis=1))
        return SPARE * by

    def _short(self, v: Array, touching: Mask, triangle: Index, flux: Array) -> _Short:
        value, slope = self._trace(v)
        any_sign = touching[self.edge]
        of_v = ROUNDING * np.abs(v[self.unknowns]).max(axis=1)
        doubts = self.doubt + 2 * of_v[self.edge]
        r = self.p - value - np.where(any_sign, 0.0, (self.rounding + of_v)[self.edge])[:, None]
        low, high = _bounds(r)
        foot, height = _vertex_off_edge(self.mesh, triangle)
        arm = self.x * np.diff(self.mesh.s)[self.edge][:, None] - foot[self.edge][:, None]
        r_prime, counts = self.slope - slope, (any_sign | (high > 0))[:, None]
        of_r, of_slope, of_arm = (self._sum(y**2 * counts) for y in (r, r_prime, arm * r_prime))
        squares = 0.5 * (height * of_slope + (of_arm + 2 * of_r) / height) + 0.25 * height * of_r
        above = np.where(counts, np.maximum(-low, 0.0)[:, None], -r)
        above = np.where(any_sign[:, None], 0.0, above) + doubts[:, None]
        q_n = flux[self.edge, :1] * (1 - self.x) + flux[self.edge, 1:] * self.x
        slack = self._sum(np.where(q_n > 0, above, 0.0) * q_n)
        needed = any_sign | ((high + doubts > 0) & ~(_bounds(value)[0] >= self.upper))
        doubt = np.zeros(len(self.unknowns))
        np.maximum.at(doubt, self.edge, np.where(needed, doubts, 0.0))
        return _Short(squares, slack, doubt)

    def _trace(self, v: Array) -> tuple[Array, Array]:
        """v and its derivative along the edges, (K, Q) each."""
        x, (start, end, middle) = self.x, (a[:, None] for a in v[self.unknowns][self.edge].T)
        value = start * (1 - x) * (1 - 2 * x) + end * x * (2 * x - 1) + middle * 4 * x * (1 - x)
        slope = start * (4 * x - 3) + end * (4 * x - 1) + middle * 4 * (1 - 2 * x)
        return value, slope / np.diff(self.mesh.s)[self.edge][:, None]

    def _sum(self, values: Array) -> Array:
        """(nb,) integrals over the edges."""
        of = np.bincount(self.edge, np.sum(self.weight * values, axis=1), len(self.unknowns))
        return np.asarray(of, dtype=float)


def constraint(obstacle: Obstacle, mesh: Mesh, unknowns: Index, n: int, on: Mask) -> Constraint:
    """The constraint v >= g on the edges `on` (nb,) for P2 with n unknowns, those (nb, 3) on the edges."""
    lengths = np.diff(mesh.s)
    inner = mesh.s[:-1, None] + lengths[:, None] * np.arange(PARTS) / PARTS
    cuts = np.union1d(np.append(inner.ravel(), mesh.s[-1]), obstacle.points)
    middle, half = 0.5 * (cuts[1:] + cuts[:-1]), 0.5 * np.diff(cuts)
    edge = np.searchsorted(mesh.s, middle) - 1
    held = on[edge]
    middle, half, edge = middle[held], half[held], edge[held]
    nodes, weights = np.polynomial.legendre.leggauss(ORDER + 1)
    s, piece = middle[:, None] + half[:, None] * nodes, obstacle.on(middle)
    p, slope = obstacle.at(piece[:, None], s)
    x = np.clip((s - mesh.s[edge][:, None]) / lengths[edge][:, None], 0.0, 1.0)
    at_unknowns, rise, jumps = _at_ends(_at_unknowns(obstacle, mesh), unknowns, n, on)
    p += rise[edge, :1] * (1 - x) + rise[edge, 1:] * x
    slope += (np.diff(rise)[:, 0] / lengths)[edge][:, None]
    rounding = np.zeros(len(lengths))
    np.maximum.at(rounding, edge, ROUNDING * np.abs(p).max(axis=1))
    return Constraint(
        mesh,
        unknowns,
        at_unknowns,
        jumps,
        edge,
        x=x,
        weight=half[:, None] * weights,
        p=p,
        slope=slope,
        rounding=rounding,
        doubt=obstacle.doubt[piece] + 2 * rounding[edge] + rise.max(axis=1)[edge],
        upper=obstacle.upper[piece],
    )


def _at_ends(on_edges: Array, unknowns: Index, n: int, on: Mask) -> tuple[Array, Array, Mask]:
    """p (n,) at the unknowns, from its values (nb, 3) on the edges; by what p is raised at their ends; jumps.

    The larger value counts at a vertex. What lacks of it by rounding (nb, 2) is added to p linearly along the
    edge, or else w would not vanish there; where more lacks p jumps (nb,).
    """
    on_edges = np.where(on[:, None], on_edges, -np.inf)
    at_unknowns = np.full(n, -np.inf)
    np.maximum.at(at_unknowns, unknowns, on_edges)
    lacking = np.where(
        on[:, None], at_unknowns[unknowns[:, :2]] - np.where(on[:, None], on_edges, 0)[:, :2], np.inf
    )
    jumps = np.any(lacking > JUMP * np.max(np.abs(on_edges[on]), initial=0.0), axis=1)
    rise = np.where(jumps[:, None], 0.0, lacking)
    at_unknowns[unknowns[:, 2]] += rise.mean(axis=1)
    return at_unknowns, rise, jumps


def _at_unknowns(obstacle: Obstacle, mesh: Mesh) -> Array:
    """(nb, 3) p at the start, the end and the midpoint of every edge, from inside the edge."""
    inner = np.stack([mesh.s[:-1], mesh.s[1:], 0.5 * (mesh.s[1:] + mesh.s[:-1])], axis=1)
    piece = obstacle.on(inner)
    piece[:, 1] = np.searchsorted(obstacle.points, mesh.s[1:]) - 1
    return obstacle.at(np.clip(piece, 0, len(obstacle.side) - 1), inner)[0]


@cache
def _to_bernstein() -> Array:
    """Coefficients in Bernstein's basis of degree ORDER from the values at Gauss points."""
    x, k = 0.5 * (np.polynomial.legendre.leggauss(ORDER + 1)[0] + 1), np.arange(ORDER + 1)
    return np.linalg.inv(comb(ORDER, k) * x[:, None] ** k * (1 - x[:, None]) ** (ORDER - k))


ROUNDING = 4 * EPS * float(np.abs(_to_bernstein()).sum(axis=1).max())
"""Of |p|: that of its coefficients in that basis."""


def _bounds(values: Array) -> tuple[Array, Array]:
    """(K,), (K,) those of the polynomials with the values (K, Q)."""
    coefficients = values @ _to_bernstein().T
    return coefficients.min(axis=1), coefficients.max(axis=1)


def _vertex_off_edge(mesh: Mesh, triangle: Index) -> tuple[Array, Array]:
    """(nb,), (nb,) the triangles' vertices off the edges: their place along the edge, their distance."""
    start, end = mesh.boundary, np.roll(mesh.boundary, -1)
    off = mesh.points[mesh.triangles[triangle].sum(axis=1) - start - end] - mesh.points[start]
    along = np.sum(off * mesh.polygon.tangents[mesh.side], axis=1)
    return along, -np.sum(off * mesh.polygon.normals[mesh.side], axis=1)
