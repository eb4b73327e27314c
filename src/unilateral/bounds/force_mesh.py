"""The mesh on which forces are bounded: small, and graded to where functions of least norm are steep."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.clamped_ends import ReactionData, boundary_index, first_contact_edge
from unilateral.errors import InputError
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.form import Form
from unilateral.fem.p1 import coupling
from unilateral.geometry import exact_mesh
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, balance_cells, make_uniform_partition
from unilateral.geometry.structured import default_mesh_kind, make_structured_mesh

MIN_UNGRADED_NODES = 250
MAX_FIRST_NODES = 2000
"""Before it is graded, the mesh is halved up to the first number of nodes; none above the second is taken."""
MAX_BOUNDARY_NODES = 640
"""Grading for the load makes no mesh with more nodes on the boundary than this, for their matrix is full.

A first mesh may have more, and halving at clamped ends goes on until there are twice as many.
"""
MAX_LIGHT_LOAD = 1 / 16
"""A load on a node counts as small if it is at most this."""
HEAVY_LOAD_FRACTION = 1 / 4
"""Triangles are halved first where the load on a node is more than this fraction of the largest one."""
MAX_HALVED_DISTORTION = 1e-6
"""Triangles are not halved if rounding distorts one of them by more than this."""
FORCE_MESH_GROWTH = 0.4
"""The size of triangles grows by this times their distance from the boundary."""
MAX_DEPTH_DIAMETERS = 100.0
"""The depth of the norm counts as at most this many diameters, or rounding would hide constants.

That is where functions are chosen; their norms are those of the true depth.
"""


def condense_force_mesh(
    mesh: Mesh, partition: Partition, load: Array, reactions: ReactionData
) -> tuple[Mesh, CondensedMatrix | None]:
    """A small mesh of the polygon of `mesh` for the load (m,) on the cells, and its condensation.

    The form of that is k^-1 N(w)^2, N the norm of `forces`. Where there is none, as on polygons that are too
    thin, these are the `mesh` itself and None.
    """
    try:
        small = _refine_at_clamped_ends(grade_force_mesh(mesh, partition, load, reactions.depth), reactions)
        polygon = small.polygon
        exact_mesh.check_distortion(polygon, small.points, small.triangles, small.distortion)
        depth = min(reactions.depth, MAX_DEPTH_DIAMETERS * polygon.diameter)
        return small, condense(small, Form(c=depth**-2))
    except InputError:
        return mesh, None


def _refine_at_clamped_ends(mesh: Mesh, reactions: ReactionData) -> Mesh:
    """The mesh, halved at clamped ends until the first edge with contact at each is within its `gap_length`.

    On that edge w passes from 1 to 0, and lambda is bounded only along the `gap_length` of `ClampedEnds`.
    Where rounding or the number of nodes ends this before, `conflict_allowances` makes the bound infinite.
    """
    gap_length = reactions.clamped_ends.gap_length
    for vertex in np.flatnonzero(gap_length).tolist():
        # grading alone may have used MAX_BOUNDARY_NODES
        while (
            np.diff(mesh.s)[first_contact_edge(mesh, vertex, reactions.form)] > gap_length[vertex]
            and len(mesh.boundary) < 2 * MAX_BOUNDARY_NODES
        ):
            node = mesh.boundary[boundary_index(mesh, vertex)]
            finer = _halve_triangles(mesh, np.flatnonzero((mesh.triangles == node).any(axis=1)))
            if finer is None:
                break
            mesh = finer
    return mesh


def extend_with_least_norm(condensed: CondensedMatrix, v: Array) -> Array:
    """The functions with the values v on the boundary and, up to rounding, the least norm, (n, k)."""
    # with the load A_3 v on the boundary the solution is v there, and has the least norm
    loads = np.zeros((condensed.mesh.n_nodes, v.shape[1]))
    loads[condensed.mesh.boundary] = condensed.A_3 @ v
    w = condensed.solve(loads)
    w[condensed.mesh.boundary] = v
    return w


def grade_force_mesh(mesh: Mesh, partition: Partition, load: Array, depth: float) -> Mesh:
    """A mesh of the polygon of `mesh`, graded for the load (m,) on the cells.

    Functions of least norm fall within the `depth` from the boundary.

    Raises InputError where gmsh has to make one, and it is not sound.
    """
    graded = _choose_first_mesh(mesh)
    # halve all triangles, then those where functions of least norm are steep
    while graded.n_nodes < MIN_UNGRADED_NODES:
        finer = _halve_triangles(graded)
        if finer is None:
            break
        graded = finer
    while True:
        chosen = _mark_loaded_triangles(graded, partition, load, depth)
        finer = _halve_triangles(graded, chosen) if len(chosen) else None
        if finer is None or len(finer.boundary) > MAX_BOUNDARY_NODES:
            return graded
        graded = finer


def _choose_first_mesh(mesh: Mesh) -> Mesh:
    """The first mesh of the refinements that led to this one, or another one if that is large."""
    coarse = mesh.coarse or mesh
    polygon = mesh.polygon
    if coarse.n_nodes <= MAX_FIRST_NODES:
        return coarse
    if default_mesh_kind(polygon) == "structured":
        return make_structured_mesh(polygon, float(polygon.lengths.max()))
    edges = balance_cells(make_uniform_partition(polygon, float(polygon.lengths.max())))
    return meshes.triangulate_from_boundary(polygon, edges.points[:-1], FORCE_MESH_GROWTH)


def _halve_triangles(mesh: Mesh, triangles: Index | None = None) -> Mesh | None:
    """The mesh with all triangles halved, or with the chosen ones; None where rounding would show."""
    if mesh.distortion.max() > MAX_HALVED_DISTORTION:
        return None
    try:
        return meshes.refine_triangles(mesh, triangles)
    except InputError:
        return None


def _mark_loaded_triangles(mesh: Mesh, partition: Partition, load: Array, depth: float) -> Index:
    """The triangles at the ends with the largest loads, and those at the boundary above the `depth`."""
    node_load = np.zeros(mesh.n_nodes)
    ends = _steep_ends(mesh, partition, load)
    node_load[mesh.boundary[ends]] = (coupling(mesh, partition).T @ load)[ends]
    # halve at the nodes with the largest loads, as many as may be, and where triangles hide the fall of w
    heavy = np.zeros(mesh.n_nodes, dtype=bool)
    heaviest = np.argsort(-node_load, kind="stable")[: max(MAX_BOUNDARY_NODES - len(mesh.boundary), 0) // 2]
    heavy[heaviest] = node_load[heaviest] > max(MAX_LIGHT_LOAD, HEAVY_LOAD_FRACTION * float(node_load.max()))
    outer = mesh.boundary_triangles
    thick = outer[mesh.longest_edges[outer] > depth]
    return np.union1d(np.flatnonzero(heavy[mesh.triangles].any(axis=1)), thick)


def _steep_ends(mesh: Mesh, partition: Partition, load: Array) -> Index:
    """The places in `mesh.boundary` of the polygon's vertices, and of the nodes next to ends of contact."""
    contact = load > 0
    nb = len(mesh.boundary)
    contact_ends = partition.points[:-1][contact != np.roll(contact, 1)]
    before = np.searchsorted(mesh.s, contact_ends, side="left") - 1
    after = np.searchsorted(mesh.s, contact_ends, side="right") - 1
    vertices = np.flatnonzero(mesh.side != np.roll(mesh.side, 1))
    return np.unique(np.concatenate([vertices, before % nb, after, (after + 1) % nb]))
