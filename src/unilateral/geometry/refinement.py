"""Triangulations that know their edges, and their refinement without sorting anything.

A triangle (a, b, c) has the reference edge bc, opposite to its first node, a longest edge in the beginning.
If any of its edges is halved, bc is. With m_i the midpoint opposite to node i it is then cut into

    bc             (m_0, a, b), (m_0, c, a)
    bc, ab         (m_2, m_0, a), (m_2, b, m_0), (m_0, c, a);    bc, ca likewise
    all            (a, m_2, m_1), (m_2, b, m_0), (m_1, m_0, c), (m_0, m_1, m_2)

called green, blue and red (I. G. Rosenberg and F. Stenger, Math. Comp. 29, 1975; R. Verfuerth, A Posteriori
Error Estimation Techniques for Finite Element Methods, 2013, section 2.1.2). In variables in which a triangle
of the first mesh is right and isosceles, with its reference edge as the hypotenuse, all its descendants are
so, too. So there are finitely many shapes. If all triangles are red, refinement is uniform.

Triangles, edges and nodes that stay keep their numbers. The first child takes its parent's number, the first
half of an edge that of the edge; others get the next ones, and so do new nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from unilateral.arrays import Array, Index, Int16, Int32, Mask
from unilateral.geometry.plane import corner_coordinates

TriangleValues = TypeVar("TriangleValues", Array, Int16, Int32, Mask)

CYCLIC_CORNERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Each node of a triangle and the two after it."""
CONGRUENCE_TOLERANCE = 1e-13
"""Rounding may leave edges of congruent triangles apart by this part of the longest edge of them all."""
LONGEST_EDGE_TOLERANCE = 1e-12
"""Because of rounding the reference edge may be shorter than the longest edge by this part of it."""
PROBE_TRIANGLES = 1000
"""This many triangles are looked at first: if these are not alike, all are not."""


@dataclass(frozen=True, eq=False)
class Triangulation:
    """n nodes, the triangles' nodes (T, 3) and opposite edges (T, 3), and the edges' ends (E, 2).

    `edge_triangles` (E, 2) are the triangles at each edge, first the one in which it runs from its first end
    to its second; -1 stands for none. `boundary_edges` (nb,) are the edges along the boundary, which run with
    it. `all_alike` says whether all triangles are so, see `rotate_to_pattern`.
    """

    n_nodes: int
    nodes: Int32
    edges: Int32
    ends: Int32
    edge_triangles: Int32
    boundary_edges: Int32
    all_alike: bool = False


@dataclass(frozen=True, eq=False)
class RefinementStep:
    """A refinement: `ends` (k, 2) are those of the halved edges, whose midpoints are the nodes n, n + 1, ...

    `edge_triangles` (k, 2) are the triangles at these edges, the second one -1 if there is none. The new
    triangles have the `nodes` (c, 3). There were `n_old_triangles` triangles. After a uniform step the
    `refined_triangulation` is known, and the new triangles are all of its triangles, in order. Otherwise
    `children` has their numbers (c,), the triangles that they come from (c,), and how often the areas of
    these were halved to make them, 1 or 2, (c,).
    """

    n_old_nodes: int
    ends: Int32
    edge_triangles: Int32
    nodes: Int32
    n_old_triangles: int
    children: tuple[Int32, Int32, Int16] | None
    refined_triangulation: Triangulation | None = None

    @property
    def triangles(self) -> Int32:
        """The numbers of the new triangles, (c,)."""
        return self.children[0] if self.children else np.arange(len(self.nodes), dtype=np.int32)

    @property
    def parent(self) -> Int32:
        """The triangles from which the new ones come, (c,)."""
        if self.children:
            return self.children[1]
        return np.tile(np.arange(self.n_old_triangles, dtype=np.int32), RED_CHILDREN)

    @property
    def halvings_from_parent(self) -> Int16:
        """How often a parent's area was halved to make each new triangle, 1 or 2, (c,)."""
        return self.children[2] if self.children else np.full(len(self.nodes), 2, dtype=np.int16)

    def replace_values(self, old: TriangleValues, new: TriangleValues) -> TriangleValues:
        """Values (T, ...) of all triangles after the step: the old ones, and those of the new triangles."""
        if self.children is None:
            return new
        n_added = int(self.children[0].max()) + 1 - self.n_old_triangles
        values = np.concatenate([old, np.empty((n_added, *old.shape[1:]), old.dtype)])
        values[self.children[0]] = new
        return values

    def inherit(self, values: TriangleValues) -> TriangleValues:
        """Values (T, ...) of all triangles after the step, where new ones have those of their parents."""
        return self.replace_values(values, values[self.parent])


def refine_triangulation(
    triangulation: Triangulation, marked: Index | None = None
) -> tuple[Triangulation, RefinementStep]:
    """The triangulation with the chosen triangles, by default all, cut in four, and others as that needs."""
    n = triangulation.n_nodes
    E = len(triangulation.ends)
    halved = np.arange(E, dtype=np.int32) if marked is None else _edges_to_halve(triangulation, marked)
    k = len(halved)
    uniform = k == E
    # The j-th halved edge has the midpoint n + j, and its second half is edge E + j; others have -1 here
    midpoints = np.full(E, -1, dtype=np.int32)
    midpoints[halved] = n + np.arange(k, dtype=np.int32)
    new = _cut_triangles(triangulation, midpoints, E + k)
    # A uniform step shares the arrays of all edges, and needs no numbers, which are known from the order
    rows = slice(None) if uniform else halved
    step = RefinementStep(
        n,
        triangulation.ends[rows],
        triangulation.edge_triangles[rows],
        new.nodes,
        len(triangulation.nodes),
        None if uniform else (new.triangles, new.parent, new.halvings_from_parent),
    )
    refined = _replace_triangles(triangulation, step, new, midpoints)
    return refined, replace(step, refined_triangulation=refined) if uniform else step


def _edges_to_halve(triangulation: Triangulation, marked: Index) -> Int32:
    """The edges of the marked triangles, and reference edges as conformity needs, increasing, (k,)."""
    flag = np.zeros(len(triangulation.ends), dtype=bool)
    flag[triangulation.edges[marked]] = True
    # A triangle with a halved edge needs its reference edge halved, which may hit the next triangle
    front = np.flatnonzero(flag)
    while front.size:
        beside = triangulation.edge_triangles[front].ravel()
        reference = triangulation.edges[beside[beside >= 0], 0]
        front = np.unique(reference[~flag[reference]])
        flag[front] = True
    return np.flatnonzero(flag).astype(np.int32)


INTERIOR_EDGES = (((3, 0),), ((3, 0), (5, 3)), ((3, 0), (4, 3)), ((4, 5), (5, 3), (3, 4)))
"""The edges inside a green triangle, a blue one with ab, a blue one with ca, and a red one, by their ends: 0
to 5 stand for a, b, c, m_0, m_1, m_2."""
CHILD_TRIANGLES = (
    (((3, 0, 1), (2, 3, 9)), ((3, 2, 0), (1, 9, 4))),
    (((5, 3, 0), (9, 7, 10)), ((5, 1, 3), (3, 10, 8)), ((3, 2, 0), (1, 9, 4))),
    (((3, 0, 1), (2, 3, 9)), ((4, 3, 2), (4, 5, 10)), ((4, 0, 3), (9, 10, 6))),
    (((0, 5, 4), (9, 6, 7)), ((5, 1, 3), (3, 10, 8)), ((4, 3, 2), (4, 5, 11)), ((3, 4, 5), (9, 10, 11))),
)
"""The children of the same four triangles: their nodes and their opposite edges. Nodes are numbered as in
INTERIOR_EDGES. Edges 0, 1, 2 are whole ones of the parent. Edges 3 to 8 are the halves of edge 0 at b and c,
of edge 1 at c and a, and of edge 2 at a and b. The others lie inside."""
CHILD_AREA_HALVINGS = ((1, 1), (2, 2, 1), (1, 2, 2), (2, 2, 2, 2))
"""How often the parent's area was halved for each child, in the same four triangles."""
RED_CHILDREN = 4
"""How many children a red triangle has."""


class NewTriangles(NamedTuple):
    """The new triangles (c,) of a refinement, with their nodes and edges (c, 3) and their parents (c,).

    `halvings_from_parent` (c,) is how often a parent's area was halved to make the triangle, 1 or 2, and
    `interior_edges` (e, 2) are the ends of the edges that lie inside the parents.
    """

    triangles: Int32
    nodes: Int32
    edges: Int32
    parent: Int32
    halvings_from_parent: Int16
    interior_edges: Int32


def _cut_triangles(triangulation: Triangulation, midpoints: Int32, n_edges: int) -> NewTriangles:
    """The children of all triangles with a halved edge.

    `midpoints` (E,) are the new nodes of the edges, -1 for none. There are `n_edges` edges and halves of
    edges; those inside triangles have the next numbers.
    """
    parents, kinds = _find_cut_triangles(triangulation, midpoints)
    n_interior = np.array([*map(len, INTERIOR_EDGES)], dtype=np.int32)[kinds]
    first_interior = np.cumsum(n_interior, dtype=np.int32) - n_interior
    # e edges inside a triangle make e + 1 children of it; the arrays are large, and so filled, not joined
    e = int(n_interior.sum())
    c = len(parents) + e
    new = NewTriangles(
        np.empty(c, np.int32),
        np.empty((c, 3), np.int32, order="F"),
        np.empty((c, 3), np.int32, order="F"),
        np.empty(c, np.int32),
        np.empty(c, np.int16),
        np.empty((e, 2), np.int32),
    )
    row = 0
    for kind in range(len(INTERIOR_EDGES)):
        family = np.flatnonzero(kinds == kind)
        nodes, edges = _local_numbering(triangulation, parents[family], midpoints)
        inside = _add_interior_edges(new, kind, first_interior[family], nodes)
        edges += [n_edges + places for places in inside]
        row = _add_children(new, row, kind, parents[family], nodes, edges)
    # Children without a number, all but the first of each parent, get the next free ones
    new.triangles[new.triangles < 0] = len(triangulation.nodes) + np.arange(e)
    return new


def _find_cut_triangles(triangulation: Triangulation, midpoints: Int32) -> tuple[Int32, Int16]:
    """The triangles (p,) with a halved edge, and their kinds (p,).

    Kind 0 is green, 1 blue with edge 2 = ab halved, 2 blue with edge 1 = ca, 3 red; edge 0 always is halved.
    """
    # The last place is for no triangle, -1, beside edges at the boundary
    is_cut = np.zeros(len(triangulation.nodes) + 1, dtype=bool)
    is_cut[triangulation.edge_triangles[midpoints >= 0]] = True
    parents = np.flatnonzero(is_cut[:-1]).astype(np.int32)
    ca_halved = midpoints[triangulation.edges[parents, 1]] >= 0
    ab_halved = midpoints[triangulation.edges[parents, 2]] >= 0
    return parents, ab_halved + np.int16(2) * ca_halved


def _add_interior_edges(new: NewTriangles, kind: int, first: Int32, nodes: list[Int32]) -> list[Int32]:
    """Writes the edges inside all parents (p,) of one kind into `new`, and returns their rows, (p,) each.

    Those of a parent stand from the row `first` (p,) on. `nodes`, (p,) each, are numbered as in
    INTERIOR_EDGES.
    """
    rows = [first + np.int32(i) for i in range(len(INTERIOR_EDGES[kind]))]
    for row, (start, end) in zip(rows, INTERIOR_EDGES[kind], strict=True):
        new.interior_edges[row, 0] = nodes[start]
        new.interior_edges[row, 1] = nodes[end]
    return rows


def _add_children(
    new: NewTriangles, row: int, kind: int, parents: Int32, nodes: list[Int32], edges: list[Int32]
) -> int:
    """Writes the children of all parents (p,) of one kind into `new` from a row on, and returns the next row.

    `nodes` and `edges`, (p,) each, are numbered as in CHILD_TRIANGLES. The first child takes its parent's
    number, the others get -1 here.
    """
    for child, (child_nodes, child_edges) in enumerate(CHILD_TRIANGLES[kind]):
        rows = slice(row, row + len(parents))
        new.triangles[rows] = -1 if child else parents
        for corner in range(3):
            new.nodes[rows, corner] = nodes[child_nodes[corner]]
            new.edges[rows, corner] = edges[child_edges[corner]]
        new.parent[rows] = parents
        new.halvings_from_parent[rows] = CHILD_AREA_HALVINGS[kind][child]
        row += len(parents)
    return row


def _local_numbering(
    triangulation: Triangulation, parents: Int32, midpoints: Int32
) -> tuple[list[Int32], list[Int32]]:
    """Corners and midpoints, and edges and halves of edges, (p,) each, in the order of CHILD_TRIANGLES."""
    corners = [nodes[parents] for nodes in triangulation.nodes.T]
    edges = [edges[parents] for edges in triangulation.edges.T]
    # What edges that stay have for midpoints and halves is of no use to any child
    middles = [midpoints[edge] for edge in edges]
    halves = []
    for edge, middle, next_corner in zip(edges, middles, [*corners[1:], corners[0]], strict=True):
        # The half of edge i at the corner after i is the edge's first one if the edge runs with the triangle
        ahead = triangulation.ends[:, 0][edge] == next_corner
        second = middle + np.int32(len(triangulation.ends) - triangulation.n_nodes)
        halves += [np.where(ahead, edge, second), np.where(ahead, second, edge)]
    return corners + middles, edges + halves


def _replace_triangles(
    triangulation: Triangulation, step: RefinementStep, new: NewTriangles, midpoints: Int32
) -> Triangulation:
    """The triangulation with its edges halved and the new triangles in place of their parents.

    `midpoints` (E,) are the new nodes of the edges, -1 for none.
    """
    # A halved edge becomes its first half; second halves come next, and then the edges inside triangles
    halved = np.flatnonzero(midpoints >= 0)
    second_ends = np.column_stack([midpoints[halved], step.ends[:, 1]])
    ends = np.concatenate([triangulation.ends, second_ends, new.interior_edges])
    ends[halved, 1] = midpoints[halved]
    # First comes the triangle in which an edge runs forward: there a child takes the place of its parent
    E = len(triangulation.ends)
    edge_triangles = np.full((len(ends), 2), -1, dtype=np.int32)
    edge_triangles[:E] = triangulation.edge_triangles
    edge_triangles[halved] = -1
    for opposite, after, _ in CYCLIC_CORNERS:
        edge = new.edges[:, opposite]
        reverse = ends[:, 0][edge] != new.nodes[:, after]
        edge_triangles[edge, reverse.view(np.int8)] = new.triangles
    # Boundary edges run with the boundary, so that the first half comes before the second
    boundary = triangulation.boundary_edges
    halved_places = np.flatnonzero(midpoints[boundary] >= 0)
    second_halves = midpoints[boundary[halved_places]] + (E - triangulation.n_nodes)
    boundary = np.insert(boundary, halved_places + 1, second_halves)
    return Triangulation(
        triangulation.n_nodes + len(step.ends),
        step.replace_values(triangulation.nodes, new.nodes),
        step.replace_values(triangulation.edges, new.edges),
        ends,
        edge_triangles,
        boundary,
        triangulation.all_alike and step.children is None,
    )


def build_triangulation(points: Array, triangles: Index, boundary: Index) -> Triangulation:
    """The triangulation of anticlockwise triangles with boundary nodes; edges are found by sorting."""
    nodes, alike = rotate_to_pattern(points, triangles)
    start = nodes[:, [1, 2, 0]].ravel().astype(np.int64)
    end = nodes[:, [2, 0, 1]].ravel().astype(np.int64)
    # An edge is told by its two nodes, the lesser one first, as one number
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    keys, where, edge = np.unique(key, return_index=True, return_inverse=True)
    ends = np.column_stack([start[where], end[where]]).astype(np.int32)
    edge_triangles = np.full((len(ends), 2), -1, dtype=np.int32)
    reverse = (ends[edge, 0] != start).view(np.int8)
    edge_triangles[edge, reverse] = np.arange(len(edge)) // 3
    after = np.roll(boundary, -1).astype(np.int64)
    boundary_key = np.minimum(boundary, after) * len(points) + np.maximum(boundary, after)
    boundary_edges = np.searchsorted(keys, boundary_key).astype(np.int32)
    edges = edge.reshape(-1, 3).astype(np.int32, order="F")
    return Triangulation(
        len(points), nodes.astype(np.int32, order="F"), edges, ends, edge_triangles, boundary_edges, alike
    )


def rotate_corners(points: Array, triangles: Index) -> Index:
    """The triangles with a longest edge opposite to the first corner, all alike if possible, (T, 3)."""
    rotated, alike = rotate_to_pattern(points, triangles)
    return rotated if alike else rotate_to_longest_edge(points, triangles)


def rotate_to_longest_edge(points: Array, triangles: Index) -> Index:
    """The triangles, each rotated until a longest edge is opposite to the first corner, (T, 3)."""
    x, y = corner_coordinates(points, triangles)
    opposite = np.hypot(x[[2, 0, 1]] - x[[1, 2, 0]], y[[2, 0, 1]] - y[[1, 2, 0]])
    first = np.argmax(opposite > (1 - LONGEST_EDGE_TOLERANCE) * opposite.max(axis=0), axis=0)
    return np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)


def rotate_to_pattern(points: Array, triangles: Index) -> tuple[Index, bool]:
    """Triangles (T, 3), all alike, with a longest edge opposite to the first corner, and True.

    If that cannot be, the triangles as they are, and False. Alike are triangles that a shift, or a turn by
    180 degrees and a shift, takes to each other.
    """
    if len(triangles) > PROBE_TRIANGLES and not rotate_to_pattern(points, triangles[:PROBE_TRIANGLES])[1]:
        return triangles, False
    # The edge vectors of an alike triangle are those of the first one, or their negatives, up to rotation
    pattern = rotate_to_longest_edge(points, triangles[:1])[0]
    model = np.roll(points[pattern], -1, axis=0) - points[pattern]
    sides = np.roll(points[triangles], -1, axis=1) - points[triangles]
    alike = np.zeros(len(triangles), dtype=bool)
    rotated = triangles.copy()
    for turn in range(3):
        vectors = np.roll(sides, -turn, axis=1)
        differences = [np.abs(vectors - sign * model).max(axis=(1, 2)) for sign in (1, -1)]
        new: Mask = ~alike & (np.minimum(*differences) <= CONGRUENCE_TOLERANCE * np.abs(sides).max())
        rotated[new] = np.roll(triangles, -turn, axis=1)[new]
        alike = alike | new
    return (rotated, True) if alike.all() else (triangles, False)
