"""Triangulations by gmsh with prescribed boundary nodes; the only module that imports it."""

from __future__ import annotations

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unilateral.polygon import Polygon

Array = NDArray[np.float64]
OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,
}


def triangulate(
    polygon: Polygon, s: Array, growth: float | None = None, fine: dict[float, float] | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Points (n, 2) and anticlockwise triangles (m, 3), the boundary nodes exactly those at arc lengths s.

    `s` (nb,) starts at 0 and contains the vertices. The triangles' size follows the boundary edges' or,
    with `growth`, is the longest boundary edge plus `growth` times the distance to the boundary, and at
    most a `fine` size plus `growth` times the distance to a boundary node, given by its arc length.
    """
    side = np.searchsorted(polygon.starts, s, side="right") - 1
    exact = polygon.at(side, s - polygon.starts[side])
    scale = polygon.diameter
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in OPTIONS.items():
            gmsh.option.setNumber(option, value)
        nodes = _boundary((exact - polygon.vertices[0]) / scale)
        if growth is not None:
            sizes = [(nodes, float(np.diff(s, append=polygon.perimeter).max()) / scale)]
            sizes += [
                ([nodes[int(np.searchsorted(s, at))]], size / scale) for at, size in (fine or {}).items()
            ]
            _set_sizes(sizes, growth)
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        cells = gmsh.model.mesh.getElementsByType(2)[1]
    finally:
        gmsh.finalize()
    used, triangles = np.unique(cells, return_inverse=True)
    order = np.argsort(tags)
    places = coordinates.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)], :2]
    points = polygon.vertices[0] + scale * places
    points[cKDTree(points).query(exact)[1]] = exact
    return points, triangles.reshape(-1, 3)


def _boundary(points: Array) -> list[int]:
    """Tags of the boundary points; every line between neighbours is one edge of the mesh."""
    nodes = [gmsh.model.geo.addPoint(x, y, 0) for x, y in points]
    lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(nodes, nodes[1:] + nodes[:1], strict=True)]
    gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    for line in lines:
        gmsh.model.mesh.setTransfiniteCurve(line, 2)
    return nodes


def _set_sizes(sizes: list[tuple[list[int], float]], growth: float) -> None:
    """The smallest of size + growth * distance to nodes as the mesh size, instead of the boundary's."""
    for option in ("Mesh.MeshSizeExtendFromBoundary", "Mesh.MeshSizeFromPoints"):
        gmsh.option.setNumber(option, 0)
    field = gmsh.model.mesh.field
    formulas = []
    for nodes, size in sizes:
        distance = field.add("Distance")
        field.setNumbers(distance, "PointsList", nodes)
        formulas.append(field.add("MathEval"))
        field.setString(formulas[-1], "F", f"{size!r} + {growth!r}*F{distance}")
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", formulas)
    field.setAsBackgroundMesh(smallest)
