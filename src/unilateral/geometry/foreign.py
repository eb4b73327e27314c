"""Meshes of other programs: arrays, and objects of meshio, scikit-fem and matplotlib."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, floats, indices
from unilateral.errors import InputError, SolutionWarning, counted, shown
from unilateral.geometry.mesh import Mesh, from_arrays, refine
from unilateral.geometry.outline import GIVE_IT, SLIGHT, Outline, outline
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import node
from unilateral.system.memory import available_mb

SECOND_ORDER = "whose edges may be curved, unlike those of a polygon; take straight ones"
MOST_HALVINGS = 12
BYTES = 400
"""A refined mesh takes about so many bytes per node, with what it knows of its edges."""


def mesh_from(
    given: Any, triangles: ArrayLike | None = None, polygon: Polygon | None = None, where: str = "mesh"
) -> Mesh:
    """The mesh of points (n, 2) and `triangles` (m, 3), or of another program's object.

    By default the polygon is the one that the triangles' boundary forms, as `outline` finds it. Raises
    InputError as `from_arrays`. Warns by a SolutionWarning where nodes were moved onto its sides, and where
    corners turn by less than SLIGHT.
    """
    if isinstance(given, Mesh) and triangles is None and polygon is None:
        return given
    points, cells = _arrays(given, triangles, where)
    points = _in_plane(points, where)
    cells = _whole(cells, where)
    if polygon is not None:
        return from_arrays(polygon, points, cells, where, rounded=True)
    boundary = outline(points, cells, where)
    mesh = from_arrays(boundary.polygon, points, cells, where, rounded=True)
    _tell_moved(boundary, points, mesh, where)
    _tell_slight(mesh.polygon, where)
    return mesh


def _tell_moved(boundary: Outline, points: Array, mesh: Mesh, where: str) -> None:
    """Warns where turns of the boundary were taken for rounding, and nodes moved for that."""
    away = np.hypot(*(mesh.points - points).T)
    moved = int(np.count_nonzero(away))
    farthest = int(away.argmax())
    if moved and len(boundary.rounded):
        turns = counted(len(boundary.rounded), "node")
        nodes = counted(moved, "node was", "nodes were")
        warnings.warn(
            f"{where}: the polygon has {mesh.polygon.n_sides} sides; the turns of its boundary at {turns}, "
            f"of up to {np.degrees(boundary.turn):.2g} degrees, are taken for rounding of coordinates, and "
            f"{nodes} moved onto the sides, node {node(points, farthest)} by {away[farthest]:.2g}",
            SolutionWarning,
            stacklevel=4,
        )


def _tell_slight(polygon: Polygon, where: str) -> None:
    """Warns of corners that may come from a rounding that the coordinates show no more.

    A mesh that was rounded, and scaled or moved afterwards, has such corners on its straight sides.
    """
    slight = np.flatnonzero(np.abs(np.pi - polygon.angles) < SLIGHT)
    if slight.size:
        x, y = polygon.vertices[slight[0]]
        turns = counted(slight.size, "vertex turns", "vertices turn")
        warnings.warn(
            f"{where}: the polygon has {polygon.n_sides} sides, and {turns} by less than "
            f"{np.degrees(SLIGHT):.0f} degree, the first at ({x:.9g}, {y:.9g}); if the boundary is straight "
            f"there, {GIVE_IT}",
            SolutionWarning,
            stacklevel=4,
        )


def halved(mesh: Mesh, times: int) -> Mesh:
    """The mesh with every edge halved so many times. Raises InputError for what is no such number."""
    if not isinstance(times, int | np.integer) or isinstance(times, bool) or not 0 <= times <= MOST_HALVINGS:
        raise InputError(
            f"halvings is {shown(repr(times))}; it has to be a whole number from 0 to {MOST_HALVINGS}"
        )
    needed = 4.0**times * mesh.n_nodes * BYTES / 2**20
    free = available_mb()
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
    if isinstance(given, Mesh):
        return given.points, given.triangles
    if hasattr(given, "points") and _are_blocks(getattr(given, "cells", None)):  # meshio
        return from_meshio(given, where)
    if all(getattr(getattr(given, name, None), "ndim", 0) == 2 for name in ("p", "t")):  # scikit-fem
        if given.p.shape[1] > getattr(given, "nvertices", given.p.shape[1]):
            raise InputError(
                f"{where}: it is a {type(given).__name__}, {SECOND_ORDER}, in scikit-fem by "
                "skfem.MeshTri(mesh.p[:, :mesh.nvertices], mesh.t)"
            )
        return np.transpose(given.p), np.transpose(given.t)
    if hasattr(given, "x") and hasattr(given, "y") and hasattr(given, "triangles"):  # matplotlib
        mask = getattr(given, "mask", None)
        x = floats(given.x, f"{where}, x")
        y = floats(given.y, f"{where}, y")
        return np.column_stack([x, y]), given.triangles[... if mask is None else ~np.asarray(mask, bool)]
    raise InputError(
        f"{where}: {shown(' '.join(repr(given).split()))} is no mesh; give a file, points and triangles, or "
        "a mesh of meshio, scikit-fem or matplotlib"
    )


def _are_blocks(cells: Any) -> bool:
    """Whether they are the cells of a mesh of meshio, of the version that is asked for."""
    return isinstance(cells, list) and all(hasattr(each, "type") and hasattr(each, "data") for each in cells)


def from_meshio(content: Any, where: str, corners: bool = False) -> tuple[Array, Array]:
    """The points and the triangles of a mesh of meshio, those that belong to several groups once.

    Triangles of second order are refused, or their `corners` taken.
    """
    known = {"triangle", "line", "vertex"} | ({"triangle6", "line3"} if corners else set())
    foreign = sorted({block.type for block in content.cells} - known)
    curved = [kind for kind in foreign if kind.startswith("triangle")]
    if curved:
        raise InputError(
            f"{where}: there are cells of type {curved[0]}, {SECOND_ORDER}, in gmsh by Mesh.ElementOrder = 1"
        )
    if foreign:
        raise InputError(f"{where}: there are cells of type {foreign[0]}; take plain triangles")
    points = floats(content.points, f"{where}, points")
    blocks = [
        indices(block.data[:, :3] if corners else block.data, f"{where}, triangles")
        for block in content.cells
        if block.type.startswith("triangle")
    ]
    if points.size == 0:
        raise InputError(f"{where}: there are no nodes; a mesh of plain triangles is needed")
    if points.ndim != 2 or any(block.size and block.shape[1:] != (3,) for block in blocks):
        raise InputError(f"{where}: no mesh can be read from it (its end is missing)")
    triangles = np.concatenate([np.empty((0, 3), int), *(block for block in blocks if block.size)])
    if not len(triangles):
        raise InputError(f"{where}: there are no triangles; a mesh of plain triangles is needed")
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return points, triangles[np.sort(first)]


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
        raise InputError(f"{where}: there are cells of {found.shape[1]} nodes; take plain triangles")
    return found
