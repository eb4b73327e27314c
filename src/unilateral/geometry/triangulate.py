"""Triangulations by gmsh with prescribed boundary nodes; the only module that imports it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.partition import Partition
from unilateral.system.signals import keeping_handlers

GMSH_LIBRARIES = "libgl1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libgomp1"
"""What gmsh loads, as Debian names it."""

try:
    import gmsh
except OSError as error:
    raise InputError(
        f"gmsh does not load ({error}); on Debian or Ubuntu type: sudo apt-get install {GMSH_LIBRARIES}"
    ) from None

GMSH_OPTIONS = {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.Algorithm": 6}


def triangulate(boundary_edges: Partition, growth: float | None = None) -> tuple[Array, Index]:
    """Points (n, 2) and anticlockwise triangles (m, 3), whose boundary edges are exactly the given ones.

    The triangles' size follows the boundary edges' or, with `growth`, is the least of (edge length + `growth`
    times the distance from that edge) over all boundary edges.
    """
    polygon = boundary_edges.polygon
    exact = boundary_edges.ends[0]
    scale = polygon.diameter
    with keeping_handlers():
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in GMSH_OPTIONS.items():
            gmsh.option.setNumber(option, value)
        nodes = _add_boundary((exact - polygon.vertices[0]) / scale)
        if growth is not None:
            _set_sizes(nodes, boundary_edges.lengths / scale, growth)
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        triangle_tags = gmsh.model.mesh.getElementsByType(2)[1]
    finally:
        gmsh.finalize()
    # gmsh's nodes by their tags, from a unit domain about 0, and those of the boundary as they were given
    used, triangles = np.unique(triangle_tags, return_inverse=True)
    order = np.argsort(tags)
    places = coordinates.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)], :2]
    points = polygon.vertices[0] + scale * places
    points[cKDTree(points).query(exact)[1]] = exact
    return points, triangles.reshape(-1, 3)


def _add_boundary(points: Array) -> list[int]:
    """Tags of the boundary points; every line between neighbours is one edge of the mesh."""
    nodes = [gmsh.model.geo.addPoint(x, y, 0) for x, y in points]
    lines = [gmsh.model.geo.addLine(a, b) for a, b in zip(nodes, nodes[1:] + nodes[:1], strict=True)]
    gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    for line in lines:
        gmsh.model.mesh.setTransfiniteCurve(line, 2)
    return nodes


def _set_sizes(nodes: list[int], lengths: Array, growth: float) -> None:
    """Sets the mesh size by the boundary edges, each after its node, with one distance per power of two."""
    for option in ("Mesh.MeshSizeExtendFromBoundary", "Mesh.MeshSizeFromPoints"):
        gmsh.option.setNumber(option, 0)
    field = gmsh.model.mesh.field
    # Of the nodes whose edges have about the size 2^p: size = that of the longest + growth * distance
    near = np.minimum(lengths, np.roll(lengths, 1))
    power = np.round(np.log2(near)).astype(int)
    formulas = []
    for p in np.unique(power):
        distance = field.add("Distance")
        field.setNumbers(distance, "PointsList", np.array(nodes)[power == p].tolist())
        formulas.append(field.add("MathEval"))
        size = float(near[power == p].max())
        field.setString(formulas[-1], "F", f"{size!r} + {growth!r}*F{distance}")
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", formulas)
    field.setAsBackgroundMesh(smallest)
