"""How far a mesh in memory is from the exact one, whose boundary nodes lie on the sides of the exact polygon.

The exact mesh has the same triangles, nodes inside and nodal values. Its boundary node at the arc length s of
side i is the point that divides the side as s divides the interval from starts[i] to starts[i + 1]. The exact
polygon is the one that was given. The bounds are computed on the mesh in memory, and what they need for the
exact one is the supplement's Proposition S14.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS
from unilateral.geometry.polygon import Polygon

MAX_DISTORTION = 1e-3
"""epsilon, kappa <= 10^-3 in Proposition S14, of `distortion_bounds` and `stretch`."""
FACTOR_PER_DISTORTION = 6.0
"""gamma of Proposition S14 is 1 + FACTOR_PER_DISTORTION (distortion + stretch)."""


def boundary_node_shifts(polygon: Polygon, points: Array, side: Index, s: Array) -> Array:
    """Bounds on the distances of boundary nodes in memory from the exact ones at the arc lengths s, (nb,).

    Places relative to the side's first vertex are rounded relative to its distance, however far the origin.
    """
    # x* = a + t e on the side from a along e: |x - x*| as computed, and the rounding of t e
    t = (s - polygon.starts[side]) / np.diff(polygon.starts)[side]
    along = t[:, None] * polygon.edges[side]
    error = points - polygon.vertices[side] - along
    return np.hypot(*error.T) + 4 * EPS * np.hypot(*along.T)


def distortion_bounds(node_shifts: Array, triangles: Index, longest_edges: Array, areas: Array) -> Array:
    """Bounds (m,) on |D Phi - I|, Phi the affine map from each triangle in memory to the exact one.

    That is at most the sum over the nodes of their `node_shifts` (n,) times the gradient of the hat, which is
    an edge over twice the area. The second term is the rounding of areas and edges, computed from
    coordinates.
    """
    # epsilon_T = sum_j delta_j |grad phi_j|, |grad phi_j| <= longest edge / (2 |T|) (Proposition S14)
    shifts = np.add.reduce([node_shifts.take(nodes) for nodes in triangles.T])
    return np.asarray((0.5 * shifts + 4 * EPS * longest_edges) * longest_edges / areas)


def check_distortion(polygon: Polygon, points: Array, triangles: Index, distortion: Array) -> None:
    """Raises InputError where one of the triangles (m, 3) is `distortion` (m,) too much for a bound."""
    worst = int(distortion.argmax())
    short = int(polygon.stretch.argmax())
    if not distortion[worst] <= MAX_DISTORTION:
        x, y = points[triangles[worst]].mean(axis=0)
        raise InputError(
            f"polygon '{polygon.name}': no bound is guaranteed on so fine a mesh, because rounding "
            f"of coordinates may change the shape of triangle {worst} at ({x:.6g}, {y:.6g}) by "
            f"{distortion[worst]:.1g}, more than {MAX_DISTORTION:g}; move the polygon to the origin, or take "
            "larger or less flat triangles"
        )
    if not polygon.stretch[short] <= MAX_DISTORTION:
        raise InputError(
            f"polygon '{polygon.name}': no bound is guaranteed, because rounding changes side {short} by "
            f"{polygon.stretch[short]:.1g} of its length, more than {MAX_DISTORTION:g}; leave out so short a "
            "side, or move the polygon to the origin"
        )
