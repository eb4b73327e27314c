"""grad u_h - q and u_h - f - div q for a flux q that is told as by `equilibrated`.

What the exact mesh adds to their norms (`geometry.exact`) is told with the rounding: on a triangle with the
`distortion` eps that is eps |q| and eps |div q|, and at the boundary what the sides' `stretch` changes of the
flow through an edge, so that q.n on the exact boundary is what it is on this one (Proposition S5).
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.quadratic import linear_squares
from unilateral.bounds.source import Source
from unilateral.geometry.mesh import Mesh

BLOCK = 8192
"""Triangles at a time, whose numbers fit into a processor's cache."""
ROUNDING = 2.0**-45
"""Of the sizes of the terms of a sum: 64 units in the last place, for some 20 operations each."""
UNDERFLOW, DIVIDED = 1e-150, 1e-156
"""What vanishing squares take from the root of a sum, at most.

The first one times 1 and the square of the perimeter; and, where squares are divided by areas, the second one
over the root of the least area. There are fewer than 10^9 triangles with fewer than 20 squares each, and each
square is off by 2^-1074 at most. Squares are multiplied by areas and squares of lengths, or divided by areas.
"""


def underflow(mesh: Mesh) -> float:
    """That of a mesh: it is added to a bound."""
    return UNDERFLOW * (1 + mesh.polygon.perimeter**2) + DIVIDED / math.sqrt(float(mesh.areas.min()))


def misfit(mesh: Mesh, u_h: Array, q: Array, of: Index | slice) -> Array:
    """(k, 3, 2) grad u_h - q at the nodes of those triangles.

    At a node flow in through the edge to the next node and out through that from the node before determine q.
    """
    node = np.ascontiguousarray(mesh.triangles[of].T)
    x, y = mesh.points[node].transpose(2, 0, 1)
    e, f = (z[[2, 0, 1]] - z[[1, 2, 0]] for z in (x, y))
    u, into, out = u_h[node], q[0][:, of], -q[1][:, of][[2, 0, 1]]
    found = [
        sign * np.sum(u * along, axis=0) + across[[1, 2, 0]] * into + across[[2, 0, 1]] * out
        for sign, along, across in ((-1, f, e), (1, e, f))
    ]
    return (np.stack(found) / (2 * mesh.areas[of])).transpose(2, 1, 0)


def defects(source: Source, u_h: Array, q: Array) -> tuple[Array, Array, float]:
    """(m,) ||grad u_h - q||^2 and u_h - f~ - div q on each triangle, and what rounding adds to the norm.

    The exact mesh's part is in that, too.
    """
    mesh, sizes, stretched = source.mesh, 0.0, _stretched(source.mesh, q)
    squares, residual = np.empty((2, len(mesh.triangles)))
    for begin in range(0, len(squares), BLOCK):
        of = slice(begin, begin + BLOCK)
        area, u, moments = mesh.areas[of], u_h[mesh.triangles[of]], source.moments[of]
        squares[of] = linear_squares(area, misfit(mesh, u_h, q, of))
        flow, steep = q[:, :, of].sum(axis=(0, 1)), mesh.longest_edges[of] / area
        residual[of] = u.mean(axis=1) + (0.5 * flow - moments.sum(axis=1)) / area
        into, out = np.abs(q[0][:, of]), np.abs(q[1][:, of])
        size = np.abs(u).max(axis=1) * (1 + steep) + (into + out).sum(axis=0) * (steep + 1 / area)
        exact = 0.5 * ((into + out[[2, 0, 1]]).max(axis=0) * steep + np.abs(flow) / area)
        added = ROUNDING * (size + np.abs(moments).sum(axis=1) / area) + mesh.distortion[of] * exact
        sizes += float(area @ (added + stretched[of]) ** 2)
    return squares, residual, math.sqrt(sizes)


def _stretched(mesh: Mesh, q: Array) -> Array:
    """(m,) |q_T| + |div q_T| at most, q_T having the `stretch` of the sides times the flow of q there."""
    at, found = mesh.boundary_triangles, np.zeros(len(mesh.triangles))
    node = np.argmax(mesh.triangles[at] == mesh.boundary[:, None], axis=1)
    flow = mesh.polygon.stretch[mesh.side] * np.abs(q[:, node, at]).sum(axis=0)
    np.add.at(found, at, 0.5 * flow * (mesh.longest_edges + 1)[at] / mesh.areas[at])
    return found


def root(squares: Array) -> float:
    """Of their sum."""
    return math.sqrt(float(squares.sum()))
