"""Structured meshes: rectangles, each cut from lower left to upper right, on polygons along the axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh, build_conforming_mesh, refine_uniformly
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, square
from unilateral.system.optional import find_missing_packages

COARSEST_DIVISIONS = 4
"""With at most this many squares in a unit of length no coarser mesh is sought, for it saves nothing."""
MAX_UNIT_SQUARES = 16
"""A polygon that is wider or higher is not taken to consist of unit squares: these would be many."""
MAX_SQUARE_COORDINATE = 1000
"""The same holds where coordinates are larger than this."""
MIN_SPACING_PER_DIAMETER = 1e-6
"""Coordinates that differ by less than this part of the diameter are no places for lines of a mesh."""


class TensorGrid(NamedTuple):
    """Coordinates x (m + 1,) and y (n + 1,), and into how many equal parts each gap is cut, (m,) and (n,)."""

    x: Array
    y: Array
    x_divisions: Index
    y_divisions: Index


def make_structured_mesh(polygon: Polygon, h: float) -> Mesh:
    """A mesh of rectangles with sides of at most h, refined from the coarsest mesh of which halvings give it.

    On polygons that consist of unit squares, up to MAX_UNIT_SQUARES in a row, these are squares of side
    1 / ceil(1 / h). Else every gap between neighbouring coordinates of vertices is cut into equal parts.
    Raises InputError unless all sides are parallel to the axes.
    """
    return _refine_from_coarsest(polygon, _make_tensor_grid(polygon, h))


def make_structured_cells(
    polygon: Polygon, H: float, edges_per_cell: int, halvings: int = 0
) -> tuple[Mesh, Partition]:
    """A structured mesh with `edges_per_cell` equal boundary edges in every cell of the size H at most.

    The edges and the cells are then halved `halvings` times. Raises InputError as `make_structured_mesh`.
    """
    cells = _make_tensor_grid(polygon, H)
    edges = 2**halvings * edges_per_cell
    grid = cells._replace(x_divisions=edges * cells.x_divisions, y_divisions=edges * cells.y_divisions)
    mesh = _refine_from_coarsest(polygon, grid)
    # every edges_per_cell-th boundary node is an end of a cell
    return mesh, Partition(polygon, mesh.s[::edges_per_cell])


def _make_tensor_grid(polygon: Polygon, size: float) -> TensorGrid:
    """The grid with the least number of equal parts, of the `size` at most, in each gap."""
    ticks = _grid_lines(polygon)
    if ticks is None:
        raise InputError(
            f"polygon '{polygon.name}' has no structured mesh, which needs sides parallel to the axes, and "
            "coordinates that are equal or well apart; use an unstructured one"
        )
    polygon.counts(size)  # which refuses sizes that are too small
    if _consists_of_squares(polygon):
        n = square().counts(size)[0]
        return TensorGrid(*ticks, *(np.full(len(coordinates) - 1, n) for coordinates in ticks))
    # a quotient that rounding puts above a whole number by this part of it counts as that number
    quotients = [np.diff(coordinates) / size * (1 - 1e-12) for coordinates in ticks]
    return TensorGrid(*ticks, *(np.ceil(quotient).astype(np.intp) for quotient in quotients))


def _grid_lines(polygon: Polygon) -> tuple[Array, Array] | None:
    """Increasing coordinates in x and in y, those of all vertices among them.

    None if a side is slanted, or if two of them differ by little more than rounding.
    """
    if not np.all(np.any(polygon.edges == 0, axis=1)):
        return None
    x = np.unique(polygon.vertices[:, 0])
    y = np.unique(polygon.vertices[:, 1])
    if _consists_of_squares(polygon):
        return np.arange(x[0], x[-1] + 1), np.arange(y[0], y[-1] + 1)
    min_spacing = min(np.diff(x).min(), np.diff(y).min())
    return (x, y) if min_spacing > MIN_SPACING_PER_DIAMETER * polygon.diameter else None


def _refine_from_coarsest(polygon: Polygon, grid: TensorGrid) -> Mesh:
    """The mesh of the grid, refined from that of a coarser one."""
    divisions = np.append(grid.x_divisions, grid.y_divisions)
    halvings = 0
    # The grid is made coarser as long as all numbers of parts are even, and not all of them small
    while divisions.max() > COARSEST_DIVISIONS and not np.any(divisions % 2):
        divisions = divisions // 2
        halvings = halvings + 1
    n_x = len(grid.x_divisions)
    coarsest = grid._replace(x_divisions=divisions[:n_x], y_divisions=divisions[n_x:])
    return refine_uniformly(_mesh_rectangles(polygon, coarsest), halvings)


def _mesh_rectangles(polygon: Polygon, grid: TensorGrid) -> Mesh:
    """The mesh of the grid's rectangles in the polygon, each cut into two triangles."""
    x = grid.x
    y = grid.y
    # All rectangles between two neighbouring ticks are in the polygon if the middle is
    middles = np.stack(np.meshgrid(0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])), axis=-1)
    inside = polygon.contains(middles).repeat(grid.y_divisions, axis=0).repeat(grid.x_divisions, axis=1)
    x = _divide_ticks(x, grid.x_divisions)
    y = _divide_ticks(y, grid.y_divisions)
    return build_conforming_mesh(polygon, *_split_rectangles(x, y, inside))


def _divide_ticks(ticks: Array, divisions: Index) -> Array:
    """The ticks with each spacing cut into so many equal ones, (sum(divisions) + 1,)."""
    # Point i of the n equal parts of a gap between a and b is (a (n - i) + b i) / n
    gap = np.repeat(np.arange(len(divisions)), divisions)
    i = np.arange(len(gap)) - (np.cumsum(divisions) - divisions)[gap]
    n = divisions[gap]
    return np.append((ticks[gap] * (n - i) + ticks[gap + 1] * i) / n, ticks[-1])


def default_mesh_kind(polygon: Polygon) -> str:
    """The kind of mesh that a polygon gets if nobody asks for another one.

    It is structured if the polygon consists of unit squares and, where gmsh is not installed, also if its
    sides are parallel to the axes.
    """
    has_one = _consists_of_squares(polygon) or (find_missing_packages("gmsh") and _grid_lines(polygon))
    return "structured" if has_one else "unstructured"


def _consists_of_squares(polygon: Polygon) -> bool:
    """Whether sides are parallel to the axes and run between whole numbers, of which there are few."""
    has_integers = np.array_equal(polygon.vertices, np.round(polygon.vertices))
    width = np.ptp(polygon.vertices, axis=0).max()
    is_small = polygon.largest <= MAX_SQUARE_COORDINATE and width <= MAX_UNIT_SQUARES
    return bool(has_integers and is_small and np.all(np.any(polygon.edges == 0, axis=1)))


def make_tensor_mesh(ticks: Array) -> Mesh:
    """The mesh of the unit `square` with rectangles between the ticks (n + 1,), from 0 to 1, in x and y."""
    n = len(ticks) - 1
    return build_conforming_mesh(square(), *_split_rectangles(ticks, ticks, np.ones((n, n), dtype=bool)))


def _split_rectangles(x: Array, y: Array, inside: Mask) -> tuple[Array, Index]:
    """Points and triangles of the rectangles inside[j, i] of the grid with the ticks x (m,) and y (n,)."""
    m = len(x)
    j, i = np.nonzero(inside)
    # Node (i, j) of the grid has the number j m + i; a is the lower left one of a rectangle
    a = j * m + i
    triangles = np.stack([a, a + 1, a + m + 1, a, a + m + 1, a + m], axis=1).reshape(-1, 3)
    used = np.zeros(m * len(y), dtype=bool)
    used[triangles] = True
    points = np.column_stack([np.tile(x, len(y)), np.repeat(y, m)])
    return points[used], (np.cumsum(used) - 1)[triangles]
