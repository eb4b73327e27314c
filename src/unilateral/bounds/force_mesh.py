"""The mesh on which forces are bounded: small, and graded to where functions of least norm are steep."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.clamped_ends import Clamps, place
from unilateral.errors import InputError
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.form import Form
from unilateral.fem.p1 import coupling
from unilateral.geometry import exact_mesh
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, balanced, uniform
from unilateral.geometry.structured import natural_kind, structured

FEW = 250
LARGE = 2000
"""Before it is graded, the mesh is halved until it has FEW nodes; one with more than LARGE is not taken."""
MOST = 640
"""The mesh is graded up to at most this many nodes on the boundary, for their matrix is full."""
LIGHT = 1 / 16
"""A load on a node counts as small if it is at most this."""
LARGEST = 1 / 4
"""Triangles are halved first where the load on a node is more than this fraction of the largest one."""
DISTORTED = 1e-6
"""Triangles are not halved if rounding distorts one of them by more than this."""
GROWTH = 0.4
"""The size of triangles grows by this times their distance from the boundary."""
DEEP = 100.0
"""The depth of the norm counts as at most this many diameters, or rounding would hide constants.

That is where functions are chosen; their norms are those of the true depth.
"""


def condensed(mesh: Mesh, cells: Partition, load: Array, clamps: Clamps) -> tuple[Mesh, Condensed | None]:
    """A small mesh of the polygon of `mesh` for the load (m,) on the cells, and its condensation.

    The form of that is k^-1 N(w)^2, N the norm of `forces`. Where there is none, as on polygons that are too
    thin, these are the `mesh` itself and None.
    """
    try:
        small = _reached(small_mesh(mesh, cells, load, clamps.depth), clamps)
        polygon = small.polygon
        exact_mesh.check(polygon, small.points, small.triangles, small.distortion)
        depth = min(clamps.depth, DEEP * polygon.diameter)
        return small, condense(small, Form(c=depth**-2))
    except InputError:
        return mesh, None


def _reached(mesh: Mesh, clamps: Clamps) -> Mesh:
    """The mesh, refined at clamped vertices until an edge there lies within reach."""
    for vertex in np.flatnonzero(clamps.ends.reach).tolist():
        at = place(mesh, vertex)
        edge = 0 if vertex not in clamps.form.clamped else -1
        while np.diff(mesh.s)[at + edge] > clamps.ends.reach[vertex] and len(mesh.boundary) < 2 * MOST:
            finer = _halved(mesh, np.flatnonzero((mesh.triangles == mesh.boundary[at]).any(axis=1)))
            if finer is None:
                break
            mesh = finer
            at = place(mesh, vertex)
    return mesh


def extended(space: Condensed, v: Array) -> Array:
    """(n, k) the functions with the values v (nb, k) on the boundary and, up to rounding, the least norm."""
    loads = np.zeros((space.mesh.n_nodes, v.shape[1]))
    loads[space.mesh.boundary] = space.A_3 @ v
    w = space.solve(loads)
    w[space.mesh.boundary] = v
    return w


def small_mesh(mesh: Mesh, cells: Partition, load: Array, depth: float) -> Mesh:
    """A mesh of the polygon of `mesh`, graded for the load (m,) on the cells.

    Functions of least norm fall within the `depth` from the boundary.

    Raises InputError where gmsh has to make one, and it is not sound.
    """
    graded = _first(mesh)
    while graded.n_nodes < FEW and (finer := _halved(graded)):
        graded = finer
    while len(chosen := _chosen(graded, cells, load, depth)) and (finer := _halved(graded, chosen)):
        if len(finer.boundary) > MOST:
            break
        graded = finer
    return graded


def _first(mesh: Mesh) -> Mesh:
    """The mesh that this one was refined from, or another one if that is large."""
    coarse = mesh.coarse or mesh
    polygon = mesh.polygon
    if coarse.n_nodes <= LARGE:
        return coarse
    if natural_kind(polygon) == "structured":
        return structured(polygon, float(polygon.lengths.max()))
    edges = balanced(uniform(polygon, float(polygon.lengths.max())))
    return meshes.with_boundary(polygon, edges.points[:-1], GROWTH)


def _halved(mesh: Mesh, chosen: Index | None = None) -> Mesh | None:
    """The mesh with all triangles halved, or with the chosen ones; None where rounding would show."""
    if mesh.distortion.max() > DISTORTED:
        return None
    try:
        return meshes.refine_some(mesh, chosen)
    except InputError:
        return None


def _chosen(mesh: Mesh, cells: Partition, load: Array, depth: float) -> Index:
    """The triangles at the ends with the largest loads, and those at the boundary above the `depth`."""
    at = np.zeros(mesh.n_nodes)
    ends = _steep_ends(mesh, cells, load)
    at[mesh.boundary[ends]] = (coupling(mesh, cells).T @ load)[ends]
    heavy = np.zeros(mesh.n_nodes, dtype=bool)
    heaviest = np.argsort(-at, kind="stable")[: max(MOST - len(mesh.boundary), 0) // 2]
    heavy[heaviest] = at[heaviest] > max(LIGHT, LARGEST * float(at.max()))
    outer = mesh.boundary_triangles
    thick = outer[mesh.longest_edges[outer] > depth]
    return np.union1d(np.flatnonzero(heavy[mesh.triangles].any(axis=1)), thick)


def _steep_ends(mesh: Mesh, cells: Partition, load: Array) -> Index:
    """The places in `mesh.boundary` of the polygon's vertices, and of the nodes next to ends of contact."""
    contact = load > 0
    nb = len(mesh.boundary)
    at = cells.points[:-1][contact != np.roll(contact, 1)]
    before = np.searchsorted(mesh.s, at, side="left") - 1
    after = np.searchsorted(mesh.s, at, side="right") - 1
    vertices = np.flatnonzero(mesh.side != np.roll(mesh.side, 1))
    return np.unique(np.concatenate([vertices, before % nb, after, (after + 1) % nb]))
