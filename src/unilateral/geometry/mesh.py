"""V_h's triangulations: from arrays, by gmsh, and uniformly refined."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry import checks
from unilateral.geometry.partition import Partition
from unilateral.geometry.plane import circles, longest_edges, signed_areas
from unilateral.geometry.polygon import Polygon

ROUNDED = 1e-6
"""How much of the longest boundary edge the rounding of coordinates may be; larger, it shows in A_3."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulation of a polygon, as `conforming` makes it.

    `points` (n, 2); `triangles` (m, 3), anticlockwise; `boundary` (nb,) the nodes along the boundary,
    anticlockwise from the polygon's vertex 0; `s` (nb + 1,) their arc lengths, exact at the polygon's
    vertices, the perimeter last. Boundary edge k joins boundary[k] and boundary[(k + 1) % nb].
    A mesh that `refine` made, `halvings` times one after the other, knows the `coarse` one.
    """

    polygon: Polygon
    points: Array
    triangles: Index
    boundary: Index
    s: Array
    coarse: Mesh | None = None
    halvings: int = 0

    @property
    def n_nodes(self) -> int:
        return len(self.points)

    @cached_property
    def side(self) -> Index:
        """(nb,) the side of the polygon each boundary edge lies on."""
        return self.polygon.sides_of(self.s[:-1])

    @cached_property
    def h(self) -> float:
        """The longest boundary edge."""
        return float(np.diff(self.s).max())

    @cached_property
    def diameter(self) -> float:
        """The longest edge of any triangle: the paper's h."""
        return float(self.longest_edges.max())

    @cached_property
    def longest_edges(self) -> Array:
        """(m,) the longest edge of each triangle."""
        return longest_edges(self.points, self.triangles)

    @cached_property
    def circles(self) -> tuple[Array, Array]:
        """Centroids (m, 2) of the triangles, and radii (m,) of the circles about them that contain them."""
        return circles(self.points[self.triangles])

    @cached_property
    def areas(self) -> Array:
        """(m,) areas of the triangles."""
        return signed_areas(self.points, self.triangles)


def from_arrays(polygon: Polygon, points: ArrayLike, triangles: ArrayLike, where: str = "mesh") -> Mesh:
    """The mesh with the nodes (n, 2) and the triangles (m, 3), anticlockwise.

    Raises InputError, beginning with `where`, unless this is a triangulation of the polygon: conforming,
    without degenerate triangles, repeated or unused nodes, its boundary the polygon's.
    """
    nodes, cells = np.array(points, dtype=float), np.array(triangles, dtype=np.intp)
    checks.check_arrays(nodes, cells, where)
    checks.check_triangles(polygon, nodes, cells, where)
    mesh = conforming(polygon, nodes, cells, where)
    excess = abs(float(mesh.areas.sum()) - polygon.area)
    if excess > checks.TOLERANCE * polygon.area + polygon.perimeter * checks.round_off(polygon):
        raise InputError(
            f"{where}: the triangles' total area {mesh.areas.sum():.17g} is not the area {polygon.area:.17g} "
            f"of polygon '{polygon.name}'"
        )
    return mesh


def conforming(polygon: Polygon, points: Array, triangles: Index, where: str = "mesh") -> Mesh:
    """The mesh of triangles (m, 3) that are sound, each by itself.

    Boundary nodes that divide a side uniformly up to round-off get exactly uniform arc lengths.
    Raises InputError, beginning with `where`, if the triangles' boundary is not the polygon's.
    """
    edges = checks.boundary_edges(points, triangles, where)
    tolerance = checks.TOLERANCE * polygon.diameter + checks.round_off(polygon)
    missing = np.flatnonzero(cKDTree(points).query(polygon.vertices)[0] > tolerance)
    if missing.size:
        raise InputError(
            f"{where}: no node lies at vertex {missing[0]} of polygon '{polygon.name}', "
            f"{tuple(polygon.vertices[missing[0]].tolist())}; every vertex has to be one"
        )
    side = checks.sides(polygon, points, edges, tolerance, where)
    s = polygon.starts[side] + np.sum(
        (points[edges[:, 0]] - polygon.vertices[side]) * polygon.tangents[side], axis=1
    )
    order = np.lexsort([s, side])
    edges, side, s = edges[order], side[order], s[order]
    gap = np.flatnonzero(edges[:, 1] != np.roll(edges[:, 0], -1))
    if gap.size:
        raise InputError(
            f"{where}: the boundary edges do not cover polygon '{polygon.name}' once; another one has to "
            f"begin where the one that begins at node {checks.node(points, edges[gap[0], 0])} ends"
        )
    uniform = polygon.divided(np.bincount(side, minlength=polygon.n_sides))
    near = np.abs(s - uniform[:-1]) <= checks.round_off(polygon)
    s = np.append(np.where(near | (np.roll(side, 1) != side), uniform[:-1], s), polygon.perimeter)
    _check_rounding(polygon, float(np.diff(s).max()), where)
    for array in (points, triangles, boundary := edges[:, 0].copy(), s):
        array.setflags(write=False)
    return Mesh(polygon, points, triangles, boundary, s)


def _check_rounding(polygon: Polygon, h: float, where: str) -> None:
    largest = float(np.abs(polygon.vertices).max())
    if np.spacing(largest) > ROUNDED * h:
        raise InputError(
            f"{where}: coordinates as large as {largest:.3g} are rounded by {np.spacing(largest):.3g}, "
            f"more than {ROUNDED:g} of the longest boundary edge {h:.3g}; move polygon '{polygon.name}' to "
            "the origin"
        )


def unstructured(polygon: Polygon, h: float) -> Mesh:
    """A mesh by gmsh, its boundary edges those of the sides divided into ceil(length / h) equal ones."""
    return with_boundary(polygon, polygon.divided(polygon.counts(h))[:-1])


def with_boundary(polygon: Polygon, s: ArrayLike, growth: float | None = None) -> Mesh:
    """A mesh by gmsh whose boundary nodes have the arc lengths s (nb,): from 0, the vertices among them.

    For the `growth` of its triangles see `triangulate`. Raises InputError if the edges are no `Partition`.
    """
    from unilateral.geometry.triangulate import triangulate

    edges = Partition(polygon, np.append(s, polygon.perimeter))
    mesh = from_arrays(polygon, *triangulate(edges, growth), "gmsh")
    return replace(mesh, s=edges.points)


def refine(mesh: Mesh) -> Mesh:
    """Uniform refinement, by `split`; the new mesh knows the one that it came from, over all refinements."""
    triangles, edges = split(mesh.triangles, mesh.n_nodes)
    points = np.concatenate([mesh.points, 0.5 * mesh.points[edges].sum(axis=1)])
    refined = conforming(mesh.polygon, points, triangles)
    return replace(refined, coarse=mesh.coarse or mesh, halvings=mesh.halvings + 1)


def split(triangles: Index, n: int) -> tuple[Index, Index]:
    """The children (4 t, 3) of triangles (t, 3) of n nodes, and the edges (e, 2), in lexical order.

    The midpoint of edge k is node n + k. Triangle k becomes 4k ... 4k + 3, the last of them the middle one.
    Child i < 3 lies at vertex i; vertex i of the middle one is the midpoint opposite vertex i, so that
    every child is its parent halved, the middle one also turned by 180 degrees.
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
    halves = np.stack([np.column_stack(child) for child in children], axis=1).reshape(-1, 3)
    return halves, np.column_stack(np.divmod(edges, n))
