"""Meshes of other programs: arrays, and objects of meshio, scikit-fem and matplotlib."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, read_floats, read_indices
from unilateral.errors import InputError, SolutionWarning, pluralise, quote_input
from unilateral.geometry.mesh import Mesh, from_arrays, refine_uniformly
from unilateral.geometry.outline import POLYGON_ADVICE, SLIGHT_TURN_RADIANS, Outline, find_outline
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import describe_node
from unilateral.system.memory import available_mb

SECOND_ORDER_FAULT = "whose edges may be curved, unlike those of a polygon; take straight ones"
OWN_SIDE_NAME = re.compile(r"side_\d+")
MAX_MESH_HALVINGS = 12
BYTES_PER_NODE = 400
"""A refined mesh takes about so many bytes per node, with what it knows of its edges."""


def as_mesh(
    points_or_mesh: Any,
    triangles: ArrayLike | None = None,
    polygon: Polygon | None = None,
    where: str = "mesh",
    named_edges: Mapping[str, Index] = MappingProxyType({}),
) -> Mesh:
    """The mesh of points (n, 2) and `triangles` (m, 3), or of another program's object.

    By default the polygon is the one that the triangles' boundary forms, as `find_outline` finds it with the
    `named_edges`. Raises
    InputError as `from_arrays`. Warns by a SolutionWarning where nodes were moved onto its sides, and where
    corners turn by less than SLIGHT_TURN_RADIANS.
    """
    if isinstance(points_or_mesh, Mesh) and triangles is None and polygon is None:
        return points_or_mesh
    points, cells = _extract_arrays(points_or_mesh, triangles, where)
    points = _drop_third_coordinate(points, where)
    cells = _as_triangle_indices(cells, where)
    if polygon is not None:
        return from_arrays(polygon, points, cells, where, may_be_rounded=True)
    boundary = find_outline(points, cells, where, named_edges)
    mesh = from_arrays(boundary.polygon, points, cells, where, may_be_rounded=True)
    _warn_of_moved_nodes(boundary, points, mesh, where)
    _warn_of_slight_corners(mesh.polygon, where)
    return mesh


def _warn_of_moved_nodes(outline: Outline, points: Array, mesh: Mesh, where: str) -> None:
    """Warns where turns of the boundary were taken for rounding, and nodes moved for that."""
    away = np.hypot(*(mesh.points - points).T)
    n_moved = int(np.count_nonzero(away))
    farthest = int(away.argmax())
    if n_moved and len(outline.rounded_nodes):
        turns = pluralise(len(outline.rounded_nodes), "node")
        nodes = pluralise(n_moved, "node was", "nodes were")
        warnings.warn(
            f"{where}: the polygon has {mesh.polygon.n_sides} sides; the turns of its boundary at {turns}, "
            f"of up to {np.degrees(outline.max_rounding_turn):.2g} degrees, are attributed to rounding of "
            f"coordinates, and {nodes} moved onto the sides, node {describe_node(points, farthest)} by "
            f"{away[farthest]:.2g}",
            SolutionWarning,
            stacklevel=4,
        )


def _warn_of_slight_corners(polygon: Polygon, where: str) -> None:
    """Warns of corners that may come from a rounding that the coordinates show no more.

    A mesh that was rounded, and scaled or moved afterwards, has such corners on its straight sides. At the
    ends of named sides there may be none.
    """
    names = [polygon.label_side(side).partition(" ")[2] for side in range(polygon.n_sides)]
    same_name = np.array([name == names[side - 1] for side, name in enumerate(names)])
    slight = np.flatnonzero(same_name & (np.abs(np.pi - polygon.angles) < SLIGHT_TURN_RADIANS))
    if slight.size:
        x, y = polygon.vertices[slight[0]]
        turns = pluralise(slight.size, "vertex turns", "vertices turn")
        warnings.warn(
            f"{where}: the polygon has {polygon.n_sides} sides, and {turns} by less than "
            f"{np.degrees(SLIGHT_TURN_RADIANS):.0f} degree, the first at ({x:.9g}, {y:.9g}); if the boundary "
            f"is straight there, {POLYGON_ADVICE}",
            SolutionWarning,
            stacklevel=4,
        )


def refine_within_memory(mesh: Mesh, halvings: int) -> Mesh:
    """The mesh with every edge halved so many times.

    Raises InputError for what is no whole number up to MAX_MESH_HALVINGS, and if too little memory is free.
    """
    is_whole = isinstance(halvings, int | np.integer) and not isinstance(halvings, bool)
    if not is_whole or not 0 <= halvings <= MAX_MESH_HALVINGS:
        raise InputError(
            f"halvings is {quote_input(repr(halvings))}; it has to be a whole number from 0 to "
            f"{MAX_MESH_HALVINGS}"
        )
    # Each halving of all edges makes about four times as many nodes
    needed = 4.0**halvings * mesh.n_nodes * BYTES_PER_NODE / 2**20
    free = available_mb()
    if needed > free:
        raise InputError(
            f"halvings = {halvings} makes a mesh of about {4.0**halvings * mesh.n_nodes:.2g} nodes, which "
            f"takes {needed:.0f} MB, and {free:.0f} MB are free; take fewer halvings"
        )
    return refine_uniformly(mesh, int(halvings))


def _extract_arrays(mesh: Any, triangles: ArrayLike | None, where: str) -> tuple[Any, Any]:
    """Points (n, 2) or (n, 3), and triangles (m, 3), not yet looked at, of what `as_mesh` takes."""
    if triangles is not None:
        return mesh, triangles
    if isinstance(mesh, Mesh):
        return mesh.points, mesh.triangles
    # meshio, of a version whose blocks of cells are objects
    blocks = getattr(mesh, "cells", None)
    is_list = isinstance(blocks, list) and all(hasattr(b, name) for b in blocks for name in ("type", "data"))
    if hasattr(mesh, "points") and is_list:
        return extract_meshio_triangles(mesh, where)
    # scikit-fem, whose meshes of second order have points for edges after those for nodes
    if all(getattr(getattr(mesh, name, None), "ndim", 0) == 2 for name in ("p", "t")):
        if mesh.p.shape[1] > getattr(mesh, "nvertices", mesh.p.shape[1]):
            raise InputError(
                f"{where}: it is a {type(mesh).__name__}, {SECOND_ORDER_FAULT}, in scikit-fem by "
                "skfem.MeshTri(mesh.p[:, :mesh.nvertices], mesh.t)"
            )
        return np.transpose(mesh.p), np.transpose(mesh.t)
    # matplotlib, where a mask says which triangles are left out
    if hasattr(mesh, "x") and hasattr(mesh, "y") and hasattr(mesh, "triangles"):
        mask = getattr(mesh, "mask", None)
        x = read_floats(mesh.x, f"{where}, x")
        y = read_floats(mesh.y, f"{where}, y")
        return np.column_stack([x, y]), mesh.triangles[... if mask is None else ~np.asarray(mask, bool)]
    raise InputError(
        f"{where}: {quote_input(' '.join(repr(mesh).split()))} is no mesh; give a file, points and "
        "triangles, or a mesh of meshio, scikit-fem or matplotlib"
    )


def extract_meshio_triangles(content: Any, where: str, corners_only: bool = False) -> tuple[Array, Array]:
    """The points and the triangles of a mesh of meshio, those that belong to several groups once.

    Triangles of second order are refused; with `corners_only` their corners are taken.
    """
    allowed_kinds = {"triangle", "line", "vertex"} | ({"triangle6", "line3"} if corners_only else set())
    other_kinds = sorted({block.type for block in content.cells} - allowed_kinds)
    curved = [kind for kind in other_kinds if kind.startswith("triangle")]
    if curved:
        raise InputError(
            f"{where}: there are cells of type {curved[0]}, {SECOND_ORDER_FAULT}, in gmsh by "
            "Mesh.ElementOrder = 1"
        )
    if other_kinds:
        raise InputError(f"{where}: there are cells of type {other_kinds[0]}; take plain triangles")
    points = read_floats(content.points, f"{where}, points")
    blocks = [
        read_indices(block.data[:, :3] if corners_only else block.data, f"{where}, triangles")
        for block in content.cells
        if block.type.startswith("triangle")
    ]
    if points.size == 0:
        raise InputError(f"{where}: there are no nodes; a mesh of plain triangles is needed")
    if points.ndim != 2 or any(block.size and block.shape[1:] != (3,) for block in blocks):
        raise InputError(f"{where}: no mesh can be read from it, because it is cut off")
    triangles = np.concatenate([np.empty((0, 3), int), *(block for block in blocks if block.size)])
    if not len(triangles):
        raise InputError(f"{where}: there are no triangles; a mesh of plain triangles is needed")
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return points, triangles[np.sort(first)]


def find_named_edges(content: Any) -> dict[str, Index]:
    """The pairs of nodes (k, 2) on each named curve, a physical one of gmsh, in a mesh of meshio.

    The names that this library writes, side_0 and so on, say no more than the numbers.
    """
    lines = [
        (block.data[:, :2], np.asarray(tags))
        for block, tags in zip(content.cells, content.cell_data.get("gmsh:physical", []), strict=False)
        if block.type.startswith("line")
    ]
    names = {name: tag for name, (tag, dimension) in content.field_data.items() if dimension == 1}
    return {
        name: np.concatenate([pairs[tags == tag] for pairs, tags in lines]).astype(np.intp)
        for name, tag in names.items()
        if lines and not OWN_SIDE_NAME.fullmatch(name)
    }


def _drop_third_coordinate(points: ArrayLike, where: str) -> Array:
    """The points (n, 2) without their third coordinates, which have to be 0."""
    requirement = "they have to be numbers, an array of the shape (n, 2)"
    coordinates = read_floats(points, f"{where}, points", requirement)
    if coordinates.ndim != 2 or coordinates.shape[1] != 3:
        return coordinates
    lifted = np.flatnonzero(coordinates[:, 2])
    if lifted.size:
        raise InputError(
            f"{where}: node {lifted[0]} has the third coordinate {coordinates[lifted[0], 2]:.6g}; the mesh "
            "has to lie in the plane z = 0"
        )
    return coordinates[:, :2]


def _as_triangle_indices(triangles: ArrayLike, where: str) -> Index:
    """The triangles (m, 3) as whole numbers; InputError if they are none."""
    requirement = "they have to be whole numbers, an array of the shape (m, 3)"
    indices = read_indices(triangles, f"{where}, triangles", requirement)
    if indices.ndim == 2 and indices.shape[1] != 3 and indices.size:
        raise InputError(f"{where}: there are cells of {indices.shape[1]} nodes; take plain triangles")
    return indices
