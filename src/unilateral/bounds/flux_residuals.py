"""grad u_h - q and u_h - f - div q for a flux q that is given on edges, as by `equilibrated`.

What the exact mesh adds to their norms (`geometry.exact_mesh`) is counted with the rounding. On a triangle
with the `distortion` eps it is eps |q| and eps |div q|. At the boundary it is also what the sides' `stretch`
changes of the flow through an edge, so that q.n on the exact boundary is what it is on this one (Proposition
S7).
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array, Index, blocks
from unilateral.bounds.equilibrated_flux import flows
from unilateral.bounds.source import Source
from unilateral.fem.form import H1, Form
from unilateral.fem.p2 import linear_squares
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.refinement import CORNERS

ROUNDING = 2.0**-45
"""The rounding of a sum, over its terms' sizes: 128 units in the last place, for some 20 operations each."""
SUMS = 1e-9
"""At most this fraction of a sum of squares is rounding."""
UNDERFLOW, DIVIDED = 1e-150, 1e-156
"""What squares that underflow take from the root of a sum, at most.

It is UNDERFLOW times the sum of 1 and the squared perimeter, plus, where squares are divided by areas,
DIVIDED over the root of the least area. There are fewer than 10^9 triangles with fewer than 20 squares each,
and each square is off by 2^-1074 at most. Squares are multiplied by areas and squares of lengths, or divided
by areas.
"""


def underflow(mesh: Mesh, form: Form = H1) -> float:
    """What underflow takes on a mesh; it is added to a bound."""
    divided = DIVIDED / math.sqrt(float(mesh.areas.min()))
    return math.hypot(1.0, form.value_constant) * (UNDERFLOW * (1 + mesh.polygon.perimeter**2) + divided)


def misfit(mesh: Mesh, u_h: Array, q: Array, of: Index | slice) -> Array:
    """(k, 3, 2) grad u_h - q at the nodes of those triangles."""
    node = mesh.triangles[of].T
    return _misfit(mesh, node, u_h.take(node), flows(mesh, q, of), mesh.areas[of]).transpose(2, 1, 0)


def _misfit(mesh: Mesh, node: Index, u: Array, ends: tuple[Array, Array], area: Array) -> Array:
    """(2, 3, k) the same, from the nodes, u_h there (3, k), and the `flows`.

    At a node the flow in through the edge to the next node and the flow out through the edge from the node
    before determine q.
    """
    (first, last), found, points = ends, np.empty((2, *u.shape), dtype=u.dtype), mesh.points.ravel()
    x, y = points.take(2 * node), points.take(2 * node + 1)
    along = [[z[k] - z[j] for _, j, k in CORNERS] for z in (x, y)]
    for values, e, sign, f in zip(found, along, (-1, 1), along[::-1], strict=True):
        slope = sign * (u[0] * f[0] + u[1] * f[1] + u[2] * f[2])
        for i, j, k in CORNERS:
            np.add(slope, e[j] * first[k] - e[k] * last[j], out=values[i])
    found *= 0.5 / area
    return found


def defects(source: Source, u_h: Array, q: Array, form: Form) -> tuple[Array, Array, Array]:
    """(m,) ||grad u_h - q||^2 and u_h - f~ - div q on each triangle, and what rounding adds to the norm.

    That includes what the exact mesh adds. Without a reaction u_h is left out of the second one.
    """
    mesh, stretched = source.mesh, _stretched(source.mesh, q)
    squares, residual, *rounding = np.empty((4, len(mesh.triangles)))
    for of in blocks(len(squares)):
        area, node, moments = mesh.areas[of], mesh.triangles[of].T, source.moments(of).T
        u, (first, last) = u_h.take(node), flows(mesh, q, of)
        squares[of] = linear_squares(area, _misfit(mesh, node, form.k * u, (first, last), area).transpose(2, 1, 0))
        flow, steep, over = _sum(first) + _sum(last), mesh.longest_edges[of] / area, 1 / area
        residual[of] = -form.c * _sum(u) / 3 - (0.5 * flow - _sum(moments)) * over
        u, first, last = np.abs(u), np.abs(first), np.abs(last)
        most = _largest([first[k] + last[j] for _, j, k in CORNERS])
        flows_ = _sum(first) + _sum(last)
        root_ = np.sqrt(area)
        rounding[0][of] = root_ * (
            ROUNDING * (form.k * _largest(u) + flows_) * steep + mesh.distortion[of] * 0.5 * most * steep + stretched[of]
        )
        rounding[1][of] = root_ * (
            ROUNDING * (form.c * _largest(u) + flows_ * over + _sum(np.abs(moments)) * over)
            + mesh.distortion[of] * 0.5 * np.abs(flow) * over
            + stretched[of]
        )
    return squares, residual, np.stack(rounding)


def _sum(of: Array) -> Array:
    """(k,) the sum of the three rows; this is faster than a reduction."""
    return np.asarray(of[0] + of[1] + of[2])


def _largest(of: Array | list[Array]) -> Array:
    return np.asarray(np.maximum(np.maximum(of[0], of[1]), of[2]))


def _stretched(mesh: Mesh, q: Array) -> Array:
    """(m,) bounds on |q_T| + |div q_T|, where q_T has the `stretch` of a side times the flow of q there."""
    at, found = mesh.boundary_triangles, np.zeros(len(mesh.triangles))
    flow, tilt = q[:, mesh.triangulation.boundary]
    flow = mesh.polygon.stretch[mesh.side] * (np.abs(flow + tilt) + np.abs(flow - tilt))
    np.add.at(found, at, 0.5 * flow * (mesh.longest_edges[at] + 1) / mesh.areas[at])
    return found


def root(squares: Array) -> float:
    """The square root of the sum."""
    return math.sqrt(float(squares.sum()))
