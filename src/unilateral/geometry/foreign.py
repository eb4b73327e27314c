"""Meshes of other programs: arrays, and objects of meshio, scikit-fem and matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, floats, indices
from unilateral.errors import InputError, shown
from unilateral.geometry.mesh import Mesh, from_arrays, refine
from unilateral.geometry.plane import cross
from unilateral.geometry.polygon import MAX_VERTICES, Polygon
from unilateral.geometry.triangulation_checks import (
    anticlockwise,
    boundary_edges,
    check_arrays,
    check_distinct,
    node,
)
from unilateral.system.memory import available_mb

STRAIGHT = 1e-9
"""A boundary runs straight on if the sine of the angle by which it turns is at most this."""
MOST_HALVINGS = 12
BYTES = 400
"""A refined mesh takes about so many bytes per node, with what it knows of its edges."""


def mesh_from(
    given: Any, triangles: ArrayLike | None = None, polygon: Polygon | None = None, where: str = "mesh"
) -> Mesh:
    """The mesh of points (n, 2) and `triangles` (m, 3), or of another program's object.

    By default the polygon is the one that the triangles' boundary forms. Raises InputError as `from_arrays`.
    """
    if isinstance(given, Mesh) and triangles is None:
        return given if polygon is None else from_arrays(polygon, given.points, given.triangles, where)
    points, cells = _arrays(given, triangles, where)
    points, cells = _in_plane(points, where), _whole(cells, where)
    return from_arrays(polygon or outline(points, cells, where), points, cells, where)


def halved(mesh: Mesh, times: int) -> Mesh:
    """The mesh with every edge halved so many times. Raises InputError for what is no such number."""
    if not isinstance(times, int | np.integer) or not 0 <= times <= MOST_HALVINGS:
        raise InputError(
            f"halvings is {shown(repr(times))}; it has to be a whole number from 0 to {MOST_HALVINGS}"
        )
    needed, free = 4.0**times * mesh.n_nodes * BYTES / 2**20, available_mb()
    if needed > free:
        raise InputError(
            f"halvings = {times} makes a mesh of about {4.0**times * mesh.n_nodes:.2g} nodes, which takes "
            f"{needed:.0f} MB, and {free:.0f} MB are free; take fewer"
        )
    return refine(mesh, int(times))


def _arrays(given: Any, triangles: ArrayLike | None, where: str) -> tuple[Any, Any]:
    """Points (n, 2) or (n, 3), and triangles (m, 3), not yet looked at."""
    if triangles is not None:
        return given, triangles
    if hasattr(given, "points") and isinstance(getattr(given, "cells", None), list):  # meshio
        return from_meshio(given, where)
    if hasattr(given, "p") and hasattr(given, "t"):  # scikit-fem
        return np.transpose(given.p), np.transpose(given.t)
    if hasattr(given, "x") and hasattr(given, "y") and hasattr(given, "triangles"):  # matplotlib
        mask = getattr(given, "mask", None)
        return np.column_stack([given.x, given.y]), given.triangles[... if mask is None else ~mask]
    raise InputError(
        f"{where}: {shown(' '.join(repr(given).split()))} is no mesh; give a file, points and triangles, or "
        "a mesh of meshio, scikit-fem or matplotlib"
    )


def from_meshio(content: Any, where: str) -> tuple[Array, Array]:
    """The points and the triangles of a mesh of meshio."""
    foreign = sorted({block.type for block in content.cells} - {"triangle", "line", "vertex"})
    if foreign:
        raise InputError(f"{where}: there are cells of type {foreign[0]}; only plain triangles will do")
    points = np.asarray(content.points, dtype=float)
    blocks = [np.asarray(block.data) for block in content.cells if block.type == "triangle"]
    if points.size == 0:
        raise InputError(f"{where}: there are no nodes; a mesh of plain triangles is needed")
    if points.ndim != 2 or any(block.size and block.shape[1:] != (3,) for block in blocks):
        raise InputError(f"{where}: no mesh can be read from it (its end is missing)")
    triangles = np.concatenate([np.empty((0, 3), int), *(block for block in blocks if block.size)])
    if not len(triangles):
        raise InputError(f"{where}: there are no triangles; a mesh of plain triangles is needed")
    return points, triangles


def _in_plane(points: ArrayLike, where: str) -> Array:
    """(n, 2) the points, whose third coordinates, if there are any, have to be 0."""
    found = floats(points, f"{where}, points", "they have to be numbers, an array of the shape (n, 2)")
    if found.ndim != 2 or found.shape[1] != 3:
        return found
    lifted = np.flatnonzero(found[:, 2])
    if lifted.size:
        raise InputError(
            f"{where}: node {lifted[0]} has the third coordinate {found[lifted[0], 2]:.6g}; the mesh has to "
            "lie in the plane z = 0"
        )
    return found[:, :2]


def _whole(triangles: ArrayLike, where: str) -> Index:
    """(m, 3) the triangles, if they are whole numbers."""
    wanted = "they have to be whole numbers, an array of the shape (m, 3)"
    found = indices(triangles, f"{where}, triangles", wanted)
    if found.ndim == 2 and found.shape[1] != 3 and found.size:
        raise InputError(f"{where}: there are cells of {found.shape[1]} nodes; only plain triangles will do")
    return found


def outline(points: Array, triangles: Index, where: str) -> Polygon:
    """The polygon that the triangles' boundary forms, anticlockwise, from the first of its corners on.

    Raises InputError for a boundary that is not one closed line.
    """
    check_arrays(points, triangles, where)
    check_distinct(float(np.hypot(*np.ptp(points, axis=0))), points, where)
    edges = boundary_edges(points, anticlockwise(points, triangles), where)
    after = np.full(len(points), -1)
    after[edges[:, 0]] = edges[:, 1]
    line = [int(edges[:, 0].min())]
    while after[line[-1]] >= 0 and after[line[-1]] != line[0] and len(line) < len(edges):
        line.append(int(after[line[-1]]))
    if len(line) < len(edges):
        why = _why_no_line(points, triangles, edges)
        raise InputError(f"{where}: the triangles' boundary must be one closed line; {why}")
    corners = points[line]
    d, e = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turns = np.abs(cross(d, e)) > STRAIGHT * np.hypot(*d.T) * np.hypot(*e.T)
    if np.count_nonzero(turns) > MAX_VERTICES:
        raise InputError(
            f"{where}: the boundary turns at {np.count_nonzero(turns)} nodes, and a polygon has at most "
            f"{MAX_VERTICES} vertices; take a coarser mesh, and halvings=1 or more"
        )
    return Polygon(corners[turns], Path(where).stem)


def _why_no_line(points: Array, triangles: Index, edges: Index) -> str:
    """What is wrong with triangles whose boundary edges (nb, 2) are not one closed line."""
    parts = _connected(len(points), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    if parts > 1:
        return f"they are {parts} separate parts, of which one may be given"
    twice = np.flatnonzero(np.bincount(edges[:, 0]) > 1)
    if twice.size:
        return f"it meets itself at node {node(points, twice[0])}"
    lines = _connected(len(points), edges) - (len(points) - len(np.unique(edges)))
    return f"it has {lines} such lines, and there may be no holes"


def _connected(n: int, edges: Index) -> int:
    """The number of parts of a graph with n nodes."""
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    graph = sp.coo_array((np.ones(len(edges)), edges.T), shape=(n, n))
    return int(connected_components(graph, directed=False, return_labels=False))
