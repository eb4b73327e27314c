"""Structured meshes: rectangles, each cut from lower left to upper right."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh, conforming, refine
from unilateral.geometry.polygon import Polygon, square

FEWEST = 4
"""With at most this many squares in a unit of length no coarser mesh is sought, for it saves nothing."""
MANY = 16
"""Polygons that are wider or higher get no structured mesh unless asked for: even unit squares are many."""
MOST_SQUARES = 1000
"""A polygon is taken to consist of unit squares if its coordinates are whole numbers up to this."""


def structured(polygon: Polygon, h: float) -> Mesh:
    """A mesh of squares of side 1 / ceil(1 / h), made by halving those of as coarse a mesh as leads to it.

    Raises InputError unless the polygon consists of unit squares between whole numbers.
    """
    if not _consists_of_squares(polygon):
        raise InputError(
            f"polygon '{polygon.name}' has no structured mesh, which needs sides that are parallel to the "
            "axes, between whole numbers; use an unstructured one"
        )
    n, halvings = int(square().counts(h)[0]), 0
    while n % 2 == 0 and n > FEWEST:
        n, halvings = n // 2, halvings + 1
    return refine(_squares(polygon, n), halvings)


def _squares(polygon: Polygon, n: int) -> Mesh:
    """The mesh with n squares in a unit of length."""
    (left, right), (low, high) = ((int(x.min()), int(x.max())) for x in polygon.vertices.T)
    middles = np.stack(np.meshgrid(np.arange(left, right) + 0.5, np.arange(low, high) + 0.5), axis=-1)
    kept = polygon.contains(middles).repeat(n, axis=0).repeat(n, axis=1)
    x, y = (np.arange(n * first, n * last + 1) / n for first, last in ((left, right), (low, high)))
    return conforming(polygon, *_grid(x, y, kept))


def natural_kind(polygon: Polygon) -> str:
    """The kind of mesh that a polygon gets if nobody asks for another one."""
    small = np.ptp(polygon.vertices, axis=0).max() <= MANY
    return "structured" if small and _consists_of_squares(polygon) else "unstructured"


def _consists_of_squares(polygon: Polygon) -> bool:
    whole = np.array_equal(polygon.vertices, np.round(polygon.vertices))
    small = polygon.largest <= MOST_SQUARES
    return bool(whole and small and np.all(np.any(polygon.edges == 0, axis=1)))


def tensor(ticks: Array) -> Mesh:
    """The mesh of the unit `square` with rectangles between the ticks (n + 1,), from 0 to 1, in x and y."""
    n = len(ticks) - 1
    return conforming(square(), *_grid(ticks, ticks, np.ones((n, n), dtype=bool)))


def _grid(x: Array, y: Array, kept: Mask) -> tuple[Array, Index]:
    """Points and triangles of the cells kept[j, i] of the grid with the ticks x (m,) and y (n,)."""
    m = len(x)
    j, i = np.nonzero(kept)
    a = j * m + i
    triangles = np.stack([a, a + 1, a + m + 1, a, a + m + 1, a + m], axis=1).reshape(-1, 3)
    used = np.zeros(m * len(y), dtype=bool)
    used[triangles] = True
    points = np.column_stack([np.tile(x, len(y)), np.repeat(y, m)])
    return points[used], (np.cumsum(used) - 1)[triangles]
