"""V_h's triangulations: structured, by gmsh, uniformly refined, from arrays and from files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from unilateral.errors import InputError
from unilateral.geometry import mesh_io
from unilateral.geometry.mesh_io import Integers
from unilateral.geometry.polygon import Array, Polygon, square

MOST_SQUARES = 1000
"""Whole numbers up to which a polygon is taken to consist of unit squares."""
STRAIGHT = 1e-9
"""The sine of the angle up to which a boundary runs on."""
ROUNDED = 1e-6
"""How much of the longest boundary edge the rounding of coordinates may be; larger, it shows in A_3."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulation of a polygon, made by the functions of this module only.

    `points` (n, 2); `triangles` (m, 3), anticlockwise; `boundary` (nb,) the nodes along the boundary,
    anticlockwise from the polygon's vertex 0; `s` (nb + 1,) their arc lengths, exact at the polygon's
    vertices, the perimeter last. Boundary edge k joins boundary[k] and boundary[(k + 1) % nb].
    """

    polygon: Polygon
    points: Array
    triangles: Integers
    boundary: Integers
    s: Array
    coarse: Mesh | None = None
    halvings: int = 0

    @property
    def origin(self) -> tuple[Mesh, int]:
        """The mesh that this one was refined from, and how often; itself and 0 if it was not."""
        return self.coarse or self, self.halvings

    @property
    def n_nodes(self) -> int:
        return len(self.points)

    @cached_property
    def side(self) -> Integers:
        """(nb,) the side of the polygon each boundary edge lies on."""
        return np.searchsorted(self.polygon.starts, self.s[:-1], side="right") - 1

    @cached_property
    def h(self) -> float:
        """The longest boundary edge."""
        return float(np.diff(self.s).max())

    @cached_property
    def diameter(self) -> float:
        """The longest edge of any triangle: the paper's h."""
        return float(mesh_io.longest_edges(self.points, self.triangles).max())

    @cached_property
    def areas(self) -> Array:
        """(m,) areas of the triangles."""
        return mesh_io.signed_areas(self.points, self.triangles)


def from_arrays(polygon: Polygon, points: ArrayLike, triangles: ArrayLike, where: str = "mesh") -> Mesh:
    """The mesh with the nodes (n, 2) and the triangles (m, 3), anticlockwise.

    Raises InputError, beginning with `where`, unless this is a triangulation of the polygon: conforming,
    without degenerate triangles, repeated or unused nodes, its boundary the polygon's.
    """
    nodes, cells = mesh_io.as_array(points, float, where), mesh_io.as_array(triangles, np.intp, where)
    mesh_io.check_arrays(nodes, cells, where)
    mesh_io.check_triangles(polygon, nodes, cells, where)
    mesh = _with_boundary(polygon, nodes, cells, where)
    excess = abs(float(mesh.areas.sum()) - polygon.area)
    if excess > mesh_io.TOLERANCE * polygon.area + polygon.perimeter * mesh_io.round_off(polygon):
        raise InputError(
            f"{where}: the triangles' total area {mesh.areas.sum():.17g} is not the area {polygon.area:.17g} "
            f"of polygon '{polygon.name}'"
        )
    return mesh


def structured(polygon: Polygon, h: float) -> Mesh:
    """Squares of side 1 / ceil(1 / h), each cut from lower left to upper right.

    Raises InputError unless the polygon consists of unit squares between whole numbers.
    """
    if not _consists_of_squares(polygon):
        raise InputError(
            f"polygon '{polygon.name}' has no structured mesh, for that its sides have to be parallel to the "
            "axes, between whole numbers; use an unstructured one"
        )
    n = int(square().counts(h)[0])
    (left, right), (low, high) = ((int(x.min()), int(x.max())) for x in polygon.vertices.T)
    of_x, of_y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(low, high) + 0.5)
    kept = _inside(polygon, of_x, of_y).repeat(n, axis=0).repeat(n, axis=1)
    x, y = (np.arange(n * first, n * last + 1) / n for first, last in ((left, right), (low, high)))
    return _with_boundary(polygon, *_grid(x, y, kept), "mesh")


def natural_kind(polygon: Polygon) -> str:
    """The kind of mesh that a polygon gets if nobody asks for another one."""
    return "structured" if _consists_of_squares(polygon) else "unstructured"


def _consists_of_squares(polygon: Polygon) -> bool:
    whole = np.array_equal(polygon.vertices, np.round(polygon.vertices))
    small = np.abs(polygon.vertices).max() <= MOST_SQUARES
    return bool(whole and small and np.all(np.any(polygon.edges == 0, axis=1)))


def _inside(polygon: Polygon, x: Array, y: Array) -> np.ndarray:
    """Whether points x, y (...), on no side's line, lie inside: an odd number of sides is to the right."""
    (x_0, y_0), (_, dy) = polygon.vertices.T, polygon.edges.T
    above = (y[..., None] > np.minimum(y_0, y_0 + dy)) & (y[..., None] < np.maximum(y_0, y_0 + dy))
    return np.count_nonzero(above & (x[..., None] < x_0), axis=-1) % 2 == 1


def tensor(ticks: Array) -> Mesh:
    """The rectangles of `square` between the ticks (n + 1,), 0 to 1, in x and y, each cut as a square is."""
    n = len(ticks) - 1
    return _with_boundary(square(), *_grid(ticks, ticks, np.ones((n, n), dtype=bool)), "mesh")


def unstructured(polygon: Polygon, h: float) -> Mesh:
    """A mesh by gmsh, its boundary edges those of the sides divided into ceil(length / h) equal ones."""
    return with_boundary(polygon, polygon.divided(polygon.counts(h))[:-1])


def with_boundary(polygon: Polygon, s: ArrayLike, growth: float | None = None) -> Mesh:
    """A mesh by gmsh whose boundary nodes have the arc lengths s (nb,): from 0, the vertices among them.

    For the `growth` of its triangles see `triangulate`.

    Raises InputError unless they increase strictly and stay below the perimeter.
    """
    from unilateral.geometry.triangulate import triangulate

    nodes = np.asarray(s, dtype=float)
    _check_nodes(polygon, nodes)
    mesh = from_arrays(polygon, *triangulate(polygon, nodes, growth), "gmsh")
    ends = np.append(nodes, polygon.perimeter)
    ends.setflags(write=False)
    return replace(mesh, s=ends)


def refine(mesh: Mesh) -> Mesh:
    """Uniform refinement: triangle k becomes 4k ... 4k + 3, the last of them the middle one.

    Child i < 3 lies at vertex i; vertex i of the middle one is the midpoint opposite vertex i, so that
    every child is its parent halved, the middle one also turned by 180 degrees.
    """
    triangles, edges = split(mesh.triangles, mesh.n_nodes)
    points = np.concatenate([mesh.points, mesh.points[edges].mean(axis=1)])
    refined = _with_boundary(mesh.polygon, points, triangles, "refined mesh")
    coarse, halvings = mesh.origin
    return replace(refined, coarse=coarse, halvings=halvings + 1)


def split(triangles: Integers, n: int) -> tuple[Integers, Integers]:
    """The children (4 t, 3) of triangles (t, 3) of n nodes, as `refine` says, and their edges (e, 2), low node first.

    The midpoint of edge k is node n + k; the edges are in lexical order.
    """
    v = triangles
    opposite = np.stack([np.roll(v, -1, axis=1), np.roll(v, -2, axis=1)])
    edges, number = np.unique(opposite.min(axis=0) * n + opposite.max(axis=0), return_inverse=True)
    m = n + number.reshape(-1, 3)
    children = [
        (v[:, 0], m[:, 2], m[:, 1]),
        (m[:, 2], v[:, 1], m[:, 0]),
        (m[:, 1], m[:, 0], v[:, 2]),
        tuple(m.T),
    ]
    return np.stack([np.column_stack(child) for child in children], axis=1).reshape(-1, 3), np.column_stack(
        np.divmod(edges, n)
    )


def write(
    mesh: Mesh,
    path: str | os.PathLike[str],
    on_edges: Mapping[str, np.ndarray] | None = None,
    at_nodes: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Writes the triangles and the boundary edges, with their sides as the cell data "side" (triangles: -1).

    Further data of boundary edges (nb,) and of nodes (n,) can be added.

    The file's ending says the format, one of meshio's that can hold both; .vtu keeps every bit.
    Raises InputError if the file cannot be written.
    """
    lines = np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)])
    data = {"side": mesh.side, **(on_edges or {})}
    mesh_io.save(Path(path), mesh.points, mesh.triangles, lines, data, at_nodes)


def read(path: str | os.PathLike[str], polygon: Polygon | None = None) -> Mesh:
    """The mesh in a file of any of meshio's formats, checked as by `from_arrays`.

    Without a polygon it is the one that the triangles' boundary is. Raises InputError, too, if lines with the
    cell data "side" are not the boundary edges of those sides.
    """
    points, triangles, lines, side = mesh_io.load(Path(path))
    polygon = polygon or outline(points, triangles, str(path))
    mesh = from_arrays(polygon, points, triangles, str(path))
    ends = np.sort(np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)]), axis=1) @ [mesh.n_nodes, 1]
    given = np.sort(lines, axis=1) @ [mesh.n_nodes, 1]
    order = np.argsort(ends)
    edge = order[np.searchsorted(ends, given, sorter=order) % len(ends)]
    wrong = np.flatnonzero((ends[edge] != given) | (mesh.side[edge] != side))
    if wrong.size:
        k = wrong[0]
        raise InputError(
            f"{path}: the line from node {lines[k, 0]} to node {lines[k, 1]} is no boundary edge "
            f"on side {side[k]:g} of polygon '{polygon.name}', as the cell data 'side' says"
        )
    return mesh


def outline(points: Array, triangles: Integers, where: str) -> Polygon:
    """The polygon that the triangles' boundary is, from the first of its corners in their order on.

    Raises InputError for a boundary that is not one closed line.
    """
    mesh_io.check_arrays(points, triangles, where)
    edges = mesh_io.boundary_edges(points, triangles, where)
    after = np.full(len(points), -1)
    after[edges[:, 0]] = edges[:, 1]
    line = [int(edges[:, 0].min())]
    while after[line[-1]] >= 0 and after[line[-1]] != line[0] and len(line) < len(edges):
        line.append(int(after[line[-1]]))
    if len(line) < len(edges):
        raise InputError(f"{where}: the triangles' boundary must be one closed line, for there are no holes")
    corners = points[line]
    d, e = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turns = np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]) > STRAIGHT * np.hypot(*d.T) * np.hypot(*e.T)
    return Polygon(corners[turns], Path(where).stem)


def _grid(x: Array, y: Array, kept: np.ndarray) -> tuple[Array, Integers]:
    """Points and triangles of the cells kept[j, i] of the grid with the ticks x (m,) and y (n,)."""
    m = len(x)
    j, i = np.nonzero(kept)
    a = j * m + i
    triangles = np.stack([a, a + 1, a + m + 1, a, a + m + 1, a + m], axis=1).reshape(-1, 3)
    used = np.zeros(m * len(y), dtype=bool)
    used[triangles] = True
    points = np.column_stack([np.tile(x, len(y)), np.repeat(y, m)])
    return points[used], (np.cumsum(used) - 1)[triangles]


def _check_nodes(polygon: Polygon, s: Array) -> None:
    if s.ndim != 1:
        raise InputError(f"boundary nodes: they have the shape {s.shape}; give a plain list of arc lengths")
    missed = np.flatnonzero(~np.isin(polygon.starts[:-1], s))
    if missed.size:
        raise InputError(
            f"boundary nodes: vertex {missed[0]} of polygon '{polygon.name}', at arc length "
            f"{polygon.starts[missed[0]]:.17g}, is missing; every vertex has to be one"
        )
    falls = np.flatnonzero(~(np.diff(s, append=polygon.perimeter) > 0))
    if s[0] != 0 or falls.size:
        first = 0 if s[0] != 0 else falls[0]
        raise InputError(
            f"boundary nodes: node {first} at arc length {s[first]:.17g} is out of order; they have to begin "
            f"with 0, increase strictly and stay below the perimeter {polygon.perimeter:.17g}"
        )


def _check_rounding(polygon: Polygon, h: float, where: str) -> None:
    largest = float(np.abs(polygon.vertices).max())
    if np.spacing(largest) > ROUNDED * h:
        raise InputError(
            f"{where}: coordinates as large as {largest:.3g} are rounded by {np.spacing(largest):.3g}, "
            f"more than {ROUNDED:g} of the longest boundary edge {h:.3g}; move polygon '{polygon.name}' to "
            "the origin"
        )


def _with_boundary(polygon: Polygon, points: Array, triangles: Integers, where: str) -> Mesh:
    """The mesh; boundary nodes that divide a side uniformly up to round-off get exactly uniform arc lengths.

    Raises InputError if the triangles' boundary is not the polygon's.
    """
    edges = mesh_io.boundary_edges(points, triangles, where)
    tolerance = mesh_io.TOLERANCE * polygon.diameter + mesh_io.round_off(polygon)
    missing = np.flatnonzero(cKDTree(points).query(polygon.vertices)[0] > tolerance)
    if missing.size:
        raise InputError(
            f"{where}: no node lies at vertex {missing[0]} of polygon '{polygon.name}', "
            f"{tuple(polygon.vertices[missing[0]].tolist())}; every vertex has to be one"
        )
    side = mesh_io.sides(polygon, points, edges, tolerance, where)
    s = polygon.starts[side] + np.sum(
        (points[edges[:, 0]] - polygon.vertices[side]) * polygon.tangents[side], axis=1
    )
    order = np.lexsort([s, side])
    edges, side, s = edges[order], side[order], s[order]
    gap = np.flatnonzero(edges[:, 1] != np.roll(edges[:, 0], -1))
    if gap.size:
        raise InputError(
            f"{where}: the boundary edges do not cover polygon '{polygon.name}' once; another one has to "
            f"begin where the one that begins at node {mesh_io.node(points, edges[gap[0], 0])} ends"
        )
    uniform = polygon.divided(np.bincount(side, minlength=polygon.n_sides))
    near = np.abs(s - uniform[:-1]) <= mesh_io.round_off(polygon)
    s = np.append(np.where(near | (np.roll(side, 1) != side), uniform[:-1], s), polygon.perimeter)
    _check_rounding(polygon, float(np.diff(s).max()), where)
    for array in (points, triangles, boundary := edges[:, 0].copy(), s):
        array.setflags(write=False)
    return Mesh(polygon, points, triangles, boundary, s)
