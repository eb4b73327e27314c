"""A small mesh of the polygon, for functions that have to be steep at the ends of sides and of contact.

It is graded to those of these ends where there is a load. A load that is small beside the norm of the
functions is left out, for there nothing is gained by steepness.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.p1 import coupling
from unilateral.geometry import exact
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, balanced, uniform
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import natural_kind, structured

FEW, LARGE = 250, 2000
"""Nodes before the mesh is graded: it is halved until there are so many, and not taken if there are more."""
MOST = 640
"""Nodes on the boundary, whose matrix is full, up to which the mesh is graded."""
LIGHT = 1 / 16
"""The load on a node that is small."""
LARGEST = 1 / 4
"""Of the largest load on a node: what is halved first."""
THICK = 1.0
"""Edges of triangles at the boundary, from which functions of least norm fall within a length of 1."""
DISTORTED = 1e-6
"""By rounding, from which on triangles are not halved."""
GROWTH = 0.4
"""Of triangles, over their distance from the boundary."""
SMALL = 1e-2
"""The least diameter on which rounding does not hide constants."""


def condensed(mesh: Mesh, cells: Partition, load: Array) -> tuple[Mesh, Condensed | None]:
    """A small mesh of the polygon of `mesh` for the load (m,) on the cells, and its condensation.

    Where there is none, as on polygons that are too thin, it is the `mesh` itself, and None. A polygon that
    is too small is condensed larger.
    """
    try:
        found = small_mesh(mesh, cells, load)
        exact.check(found.polygon, found.points, found.triangles, found.distortion)
        return found, condense(_not_too_small(found))
    except InputError:
        return mesh, None


def _not_too_small(mesh: Mesh) -> Mesh:
    polygon = mesh.polygon
    if polygon.diameter >= SMALL:
        return mesh
    return meshes.similar(mesh, Polygon(SMALL / polygon.diameter * polygon.vertices, polygon.name))


def extended(space: Condensed, v: Array) -> Array:
    """(n, k) with the values v (nb, k) on the boundary, and the least norm but for rounding."""
    loads = np.zeros((space.mesh.n_nodes, v.shape[1]))
    loads[space.mesh.boundary] = space.A_3 @ v
    found = space.solve(loads)
    found[space.mesh.boundary] = v
    return found


def small_mesh(mesh: Mesh, cells: Partition, load: Array) -> Mesh:
    """A mesh of the polygon of `mesh`, graded for the load (m,) on the cells.

    Raises InputError where gmsh has to make one, and it is not sound.
    """
    found = _first(mesh)
    while found.n_nodes < FEW and (finer := _halved(found)):
        found = finer
    while len(chosen := _chosen(found, cells, load)) and (finer := _halved(found, chosen)):
        if len(finer.boundary) > MOST:
            break
        found = finer
    return found


def _first(mesh: Mesh) -> Mesh:
    """The mesh that it came from, or another one if that is large."""
    coarse, polygon = mesh.coarse or mesh, mesh.polygon
    if coarse.n_nodes <= LARGE:
        return coarse
    if natural_kind(polygon) == "structured":
        return structured(polygon, 1)
    edges = balanced(uniform(polygon, float(polygon.lengths.max())))
    return meshes.with_boundary(polygon, edges.points[:-1], GROWTH)


def _halved(mesh: Mesh, chosen: Index | None = None) -> Mesh | None:
    """With all triangles halved, or those that are chosen; None where rounding would show."""
    if mesh.distortion.max() > DISTORTED:
        return None
    try:
        return meshes.refine_some(mesh, chosen)
    except InputError:
        return None


def _chosen(mesh: Mesh, cells: Partition, load: Array) -> Index:
    """The triangles at the ends with the largest loads, and those at the boundary that are too thick."""
    at, ends = np.zeros(mesh.n_nodes), _ends(mesh, cells, load)
    at[mesh.boundary[ends]] = (coupling(mesh, cells).T @ load)[ends]
    heavy = np.zeros(mesh.n_nodes, dtype=bool)
    heaviest = np.argsort(-at, kind="stable")[: max(MOST - len(mesh.boundary), 0) // 2]
    heavy[heaviest] = at[heaviest] > max(LIGHT, LARGEST * float(at.max()))
    outer = mesh.boundary_triangles
    thick = outer[mesh.longest_edges[outer] > THICK]
    return np.union1d(np.flatnonzero(heavy[mesh.triangles].any(axis=1)), thick)


def _ends(mesh: Mesh, cells: Partition, load: Array) -> Index:
    """The places in `mesh.boundary` of the polygon's vertices, and of the nodes next to ends of contact."""
    contact, nb = load > 0, len(mesh.boundary)
    at = cells.points[:-1][contact != np.roll(contact, 1)]
    before, after = (np.searchsorted(mesh.s, at, side=side) - 1 for side in ("left", "right"))
    vertices = np.flatnonzero(mesh.side != np.roll(mesh.side, 1))
    return np.unique(np.concatenate([vertices, before % nb, after, (after + 1) % nb]))
