"""Meshes that are graded to a vertex: the nodes of a mesh of equal triangles are moved."""

from __future__ import annotations

import numpy as np

from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross
from unilateral.geometry.triangulation_checks import check_areas

WHERE = "graded mesh"


def graded(mesh: Mesh, vertex: int, radius: float, kappa: float) -> Mesh:
    """The mesh with nodes within the radius R of a vertex moved from the distance r to R (r/R)^(1/kappa).

    Triangles of the size h at the distance r then have a size like h r^(1 - kappa), and angles are bounded
    below. No other sides than those of the vertex may be so near. Raises InputError if a triangle turns over.
    """
    centre = mesh.polygon.vertices[vertex]
    offset = mesh.points - centre
    share = np.minimum(np.hypot(*offset.T) / radius, 1.0)
    moved = centre + offset * share[:, None] ** (1 / kappa - 1)
    check_areas(moved, mesh.triangles, WHERE)
    return meshes.conforming(mesh.polygon, moved, mesh.triangles, WHERE)


def least_angle(mesh: Mesh) -> float:
    """The smallest angle of all triangles, in degrees."""
    corners = mesh.points[mesh.triangles]
    before, after = ((np.roll(corners, shift, axis=1) - corners).reshape(-1, 2) for shift in (1, -1))
    return float(np.degrees(np.arctan2(cross(after, before), np.sum(after * before, axis=1)).min()))
