"""The triangulations of V_h: made from arrays, made by gmsh, and refined, uniformly or not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, Int32, read_floats, read_indices
from unilateral.errors import InputError
from unilateral.geometry import exact_mesh, refinement, triangulation_checks
from unilateral.geometry import partition as partitions
from unilateral.geometry.partition import Partition
from unilateral.geometry.plane import centroid_circles, longest_edges, signed_areas
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.refinement import RefinementStep, Triangulation
from unilateral.system.optional import require

MAX_ROUNDING_PER_H = 1e-6
"""The rounding of coordinates may be this part of the longest boundary edge; a larger one shows in A_3."""
MAX_ROUNDING_PER_EDGE = exact_mesh.MAX_DISTORTION
"""The rounding of coordinates may be this part of any edge; then Proposition S14 holds."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulation of a polygon, as `build_conforming_mesh` makes it.

    `points` (n, 2); `triangles` (m, 3), anticlockwise, in the order of `refinement`; `boundary` (nb,) the
    nodes along the boundary, anticlockwise from the polygon's vertex 0; `s` (nb + 1,) their arc lengths,
    exact at the polygon's vertices, the perimeter last. Boundary edge k joins boundary[k] and
    boundary[(k + 1) % nb]. A mesh that was refined knows the `coarse` one, the `steps` from there, and its
    edges, in the `stored_triangulation`.
    """

    polygon: Polygon
    points: Array
    triangles: Index
    boundary: Index
    s: Array
    coarse: Mesh | None = None
    steps: tuple[RefinementStep, ...] = ()
    stored_triangulation: Triangulation | None = None

    def __post_init__(self) -> None:
        for array in (self.points, self.triangles, self.boundary, self.s):
            array.setflags(write=False)

    def __repr__(self) -> str:
        n = self.n_nodes
        m = len(self.triangles)
        sides = self.polygon.n_sides
        return f"Mesh of '{self.polygon.name}': {sides} sides, {n} nodes, {m} triangles, h = {self.h:.4g}"

    @property
    def n_nodes(self) -> int:
        """The number of nodes."""
        return len(self.points)

    @cached_property
    def side(self) -> Index:
        """The side of the polygon on which each boundary edge lies, (nb,)."""
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
        """The longest edge of each triangle, (m,)."""
        return longest_edges(self.points, self.triangles)

    @property
    def halvings(self) -> int:
        """How often the coarse mesh was refined, if always uniformly; else 0."""
        return 0 if self.is_adapted else len(self.steps)

    @property
    def is_adapted(self) -> bool:
        """Whether it was refined, and not always uniformly."""
        return not all(step.refined_triangulation for step in self.steps)

    @cached_property
    def triangulation(self) -> Triangulation:
        """The triangulation with its edges, whose midpoints are the new nodes of a finer mesh."""
        return self.stored_triangulation or refinement.build_triangulation(
            self.points, self.triangles, self.boundary
        )

    @cached_property
    def opposite_edges(self) -> Int32:
        """The numbers of the edges opposite to the triangles' nodes, (m, 3)."""
        return self.triangulation.edges

    @cached_property
    def boundary_triangles(self) -> Index:
        """The triangle at each boundary edge, (nb,)."""
        triangulation = self.triangulation
        return triangulation.edge_triangles[triangulation.boundary_edges, 0].astype(np.intp)

    def select_triangles(self, triangles: Index) -> Mesh:
        """Some of the triangles (k,), with the same node numbers; it is no mesh of the polygon."""
        return replace(
            self, triangles=self.triangles[triangles], coarse=None, steps=(), stored_triangulation=None
        )

    @cached_property
    def enclosing_circles(self) -> tuple[Array, Array]:
        """Centroids (m, 2) of the triangles, and radii (m,) of the circles about them that contain them."""
        return centroid_circles(self.points.take(self.triangles, axis=0))

    @cached_property
    def areas(self) -> Array:
        """Areas of the triangles, (m,)."""
        return signed_areas(self.points, self.triangles)

    @cached_property
    def node_shifts(self) -> Array:
        """Bounds on the distances of the nodes from those of the exact mesh, (n,)."""
        shift = np.zeros(self.n_nodes)
        places = self.points[self.boundary]
        shift[self.boundary] = exact_mesh.boundary_node_shifts(self.polygon, places, self.side, self.s[:-1])
        return shift

    @cached_property
    def distortion(self) -> Array:
        """Bounds (m,) on |D Phi - I|, Phi the map from each triangle to that of the exact mesh."""
        return exact_mesh.distortion_bounds(self.node_shifts, self.triangles, self.longest_edges, self.areas)

    @property
    def exact_mesh_factor(self) -> float:
        """The factor gamma by which norms, constants and lengths may be larger on the exact mesh."""
        # gamma = 1 + 6 (epsilon + kappa), Proposition S14
        change = float(self.distortion.max() + self.polygon.stretch.max())
        return 1 + exact_mesh.FACTOR_PER_DISTORTION * change


def from_arrays(
    polygon: Polygon,
    points: ArrayLike,
    triangles: ArrayLike,
    where: str = "mesh",
    may_be_rounded: bool = False,
) -> Mesh:
    """The mesh with the nodes (n, 2) and the triangles (m, 3), whose nodes run either way round.

    Nodes a little beside the boundary are moved onto it, see `triangulation_checks.MAX_MOVE_PER_HEIGHT`, and
    by as much as rounding explains if coordinates of another program `may_be_rounded`. Raises InputError,
    beginning with `where`, unless this is then a triangulation of the polygon: conforming, without degenerate
    triangles, repeated or unused nodes, its boundary the polygon's.
    """
    nodes = read_floats(points, f"{where}, points")
    cells = read_indices(triangles, f"{where}, triangles")
    triangulation_checks.check_arrays(nodes, cells, where)
    cells = triangulation_checks.orient_anticlockwise(nodes, cells)
    triangulation_checks.check_areas(nodes, cells, where)
    triangulation_checks.check_distinct_nodes(polygon.diameter, nodes, where)
    mesh = build_conforming_mesh(polygon, nodes, cells, where, may_be_rounded)
    # Once more, for nodes may have been moved
    triangulation_checks.check_areas(mesh.points, cells, where)
    return mesh


def build_conforming_mesh(
    polygon: Polygon, points: Array, triangles: Index, where: str = "mesh", may_be_rounded: bool = False
) -> Mesh:
    """The mesh of triangles (m, 3) that are sound, each by itself, and anticlockwise.

    Boundary nodes that divide a side uniformly up to round-off get exactly uniform arc lengths.
    Raises InputError, beginning with `where`, if the triangles' boundary is not the polygon's.

    If it is, they triangulate the polygon: their boundary goes round each point of it once, and the sum of
    their indices about a point, all of them positive, is 1.
    """
    edges = triangulation_checks.find_boundary_edges(points, triangles, where)
    heights = triangulation_checks.min_heights(points, triangles, edges)
    reach = triangulation_checks.allowed_distances(polygon, points, edges, heights, may_be_rounded)
    triangulation_checks.check_vertices_are_nodes(polygon, points, edges[:, 0], reach, where)
    # Edge ab lies at s = (x - p).t after the start p of its side, with x = a and the side's direction t
    side = triangulation_checks.assign_sides(polygon, points, edges, reach, heights, where)
    from_start = points[edges[:, 0]] - polygon.vertices[side]
    s = polygon.starts[side] + np.sum(from_start * polygon.tangents[side], axis=1)
    # In the order along the boundary each edge has to begin where the one before ends
    order = np.lexsort([s, side])
    boundary = edges[order, 0]
    gap = np.flatnonzero(edges[order, 1] != np.roll(boundary, -1))
    if gap.size:
        raise InputError(
            f"{where}: the boundary edges do not cover polygon '{polygon.name}' once; an edge is missing "
            "after the edge that begins at node "
            f"{triangulation_checks.describe_node(points, boundary[gap[0]])}"
        )
    points = triangulation_checks.snap_to_sides(polygon, points, boundary, side[order], reach, where)
    s = _snap_arc_lengths(polygon, side[order], s[order])
    _check_coordinate_rounding(polygon, float(np.diff(s).max()), where)
    return Mesh(polygon, points, refinement.rotate_corners(points, triangles), boundary, s)


def _snap_arc_lengths(polygon: Polygon, side: Index, s: Array) -> Array:
    """Arc lengths s (nb,) made exact at vertices and on uniform sides, and the perimeter, (nb + 1,)."""
    # A uniform side is cut into equal edges, up to round-off; a vertex is where the side changes
    uniform = polygon.divided(np.bincount(side, minlength=polygon.n_sides))
    near = np.abs(s - uniform[:-1]) <= triangulation_checks.round_off(polygon)
    return np.append(np.where(near | (np.roll(side, 1) != side), uniform[:-1], s), polygon.perimeter)


def _check_coordinate_rounding(polygon: Polygon, h: float, where: str) -> None:
    """Raises InputError if rounding of coordinates is more than MAX_ROUNDING_PER_H of h."""
    largest = polygon.largest
    if np.spacing(largest) > MAX_ROUNDING_PER_H * h:
        raise InputError(
            f"{where}: coordinates as large as {largest:.3g} are rounded by {np.spacing(largest):.3g}, "
            f"more than {MAX_ROUNDING_PER_H:g} of the longest boundary edge {h:.3g}; move polygon "
            f"'{polygon.name}' to the origin"
        )


def make_unstructured_mesh(polygon: Polygon, h: float) -> Mesh:
    """A mesh by gmsh, whose boundary edges divide each side into ceil(length / h) equal ones."""
    return triangulate_from_boundary(polygon, polygon.divided(polygon.counts(h))[:-1])


def triangulate_from_boundary(polygon: Polygon, s: ArrayLike, growth: float | None = None) -> Mesh:
    """A mesh by gmsh whose boundary nodes have the arc lengths s (nb,), from 0 on and with all vertices.

    For the `growth` of its triangles see `triangulate`. Raises InputError if the edges are no `Partition`.
    """
    require(f"the mesh of '{polygon.name}' needs", "gmsh")
    from unilateral.geometry.triangulate import triangulate

    edges = Partition(polygon, np.append(s, polygon.perimeter))
    _check_coordinate_rounding(polygon, float(edges.lengths.max()), "gmsh")
    mesh = from_arrays(polygon, *triangulate(edges, growth), "gmsh")
    # in place of the arc lengths that were computed from coordinates
    return replace(mesh, s=edges.points)


def triangulate_from_cells(
    partition: Partition, edges_per_cell: int, halvings: int = 0, growth: float | None = None
) -> tuple[Mesh, Partition]:
    """A mesh by gmsh with `edges_per_cell` equal boundary edges in every cell, and the partition.

    The edges of both are then halved `halvings` times.
    """
    edges = partitions.divide_cells(partition, edges_per_cell)
    mesh = triangulate_from_boundary(partition.polygon, edges.points[:-1], growth)
    return refine_uniformly(mesh, halvings), partitions.divide_cells(partition, 2**halvings)


def refine_uniformly(mesh: Mesh, times: int = 1) -> Mesh:
    """Uniform refinement. Raises InputError as `refine_triangles`."""
    for _ in range(times):
        mesh = refine_triangles(mesh)
    return mesh


def refine_triangles(mesh: Mesh, marked: Index | None = None) -> Mesh:
    """The mesh with the chosen triangles, by default all, cut in four, and others as that needs.

    Nodes keep their numbers. The new mesh knows the one from which all refinements began. Raises InputError
    where edges become as short as rounding.
    """
    triangulation, step = refinement.refine_triangulation(mesh.triangulation, marked)
    # The new nodes are the midpoints of the halved edges; an edge must not be as short as rounding
    start = mesh.points[step.ends[:, 0]]
    end = mesh.points[step.ends[:, 1]]
    shortest = 0.5 * float(np.hypot(*(end - start).T).min())
    rounding = float(np.spacing(mesh.polygon.largest))
    if rounding > MAX_ROUNDING_PER_EDGE * shortest:
        raise InputError(
            f"the mesh of '{mesh.polygon.name}' gets an edge of {shortest:.2g}, as short as rounding allows "
            f"where coordinates are rounded by {rounding:.2g}; take a larger accuracy, or move the polygon "
            "to the origin"
        )
    points = np.concatenate([mesh.points, 0.5 * (start + end)])
    boundary = triangulation.ends[triangulation.boundary_edges, 0].astype(np.intp)
    # Each half of a boundary edge is on the edge's side; the second one starts at the middle
    halved = find_halved_edges(boundary, step.n_old_nodes)
    s = np.insert(mesh.s, halved + 1, 0.5 * (mesh.s[halved] + mesh.s[halved + 1]))
    side = np.insert(mesh.side, halved + 1, mesh.side[halved])
    s = _snap_arc_lengths(mesh.polygon, side, s[:-1])
    _check_coordinate_rounding(mesh.polygon, float(np.diff(s).max()), "mesh")
    coarse = mesh.coarse or mesh
    steps = (*mesh.steps, step)
    return Mesh(mesh.polygon, points, triangulation.nodes, boundary, s, coarse, steps, triangulation)


def find_halved_edges(new_boundary: Index, n_old_nodes: int) -> Index:
    """The old numbers of the boundary edges that were halved, from the nodes along the new boundary, (k,)."""
    # The i-th new node, counted from 0, comes after i others and the start of its edge
    new = np.flatnonzero(new_boundary >= n_old_nodes)
    return new - np.arange(1, len(new) + 1)
