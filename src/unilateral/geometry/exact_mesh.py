"""How far a mesh in memory is from the exact one, whose boundary nodes lie on the sides of the exact polygon.

The exact mesh has the same triangles, nodes inside and nodal values. Its boundary node at the arc length s of
side i is the point that divides the side as s divides the interval from starts[i] to starts[i + 1]. The exact
polygon is the one that was given. The bounds are computed on the mesh in memory, and what they need for the
exact one is the supplement's Proposition S7.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS
from unilateral.geometry.polygon import Polygon

MOST = 1e-3
"""Proposition S7 of the supplement holds if `distortion` and `stretch` are at most this."""
GROWTH = 6.0
"""gamma of Proposition S7 is 1 + GROWTH (distortion + stretch)."""


def shifts(polygon: Polygon, places: Array, side: Index, s: Array) -> Array:
    """(nb,) how far nodes at the `places` (nb, 2) may be from the exact ones, of arc lengths s on the sides.

    Places relative to the side's first vertex are rounded relative to its distance, however far the origin.
    """
    t = (s - polygon.starts[side]) / np.diff(polygon.starts)[side]
    along = t[:, None] * polygon.edges[side]
    off = places - polygon.vertices[side] - along
    return np.hypot(*off.T) + 4 * EPS * np.hypot(*along.T)


def distortion(shift: Array, triangles: Index, longest: Array, areas: Array) -> Array:
    """(m,) bounds on |D Phi - I|, Phi the affine map from a triangle in memory to the exact one.

    That is at most the sum over the nodes of their `shift` (n,) times the gradient of the hat, which is an
    edge over twice the area. The second term is the rounding of areas and edges, computed from coordinates.
    """
    return (0.5 * shift[triangles].sum(axis=1) + 4 * EPS * longest) * longest / areas


def check(polygon: Polygon, points: Array, triangles: Index, distorted: Array) -> None:
    """Raises InputError where one of the triangles (m, 3) is `distorted` (m,) too much for a bound."""
    worst = int(distorted.argmax())
    short = int(polygon.stretch.argmax())
    if not distorted[worst] <= MOST:
        x, y = points[triangles[worst]].mean(axis=0)
        raise InputError(
            f"polygon '{polygon.name}': no bound is guaranteed on so fine a mesh, because rounding "
            f"of coordinates may change the shape of triangle {worst} at ({x:.6g}, {y:.6g}) by "
            f"{distorted[worst]:.1g}, more than {MOST:g}; move the polygon to the origin, or take larger or "
            "less flat triangles"
        )
    if not polygon.stretch[short] <= MOST:
        raise InputError(
            f"polygon '{polygon.name}': no bound is guaranteed, because rounding changes side {short} by "
            f"{polygon.stretch[short]:.1g} of its length, more than {MOST:g}; leave out so short a side, or "
            "move the polygon to the origin"
        )
