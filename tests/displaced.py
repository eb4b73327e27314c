"""Meshes whose nodes may be away from their exact places, as rounding makes them, by much more than that."""

from dataclasses import replace

from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon


def add_doubt(mesh: Mesh, doubt: float) -> Mesh:
    """The mesh, each of whose nodes may be displaced by `doubt`, and its sides stretched by twice that."""
    polygon = Polygon(mesh.polygon.vertices, mesh.polygon.name)
    vars(polygon)["stretch"] = polygon.stretch + 2 * doubt / polygon.lengths
    displaced = replace(mesh, polygon=polygon)
    vars(displaced)["node_shifts"] = mesh.node_shifts + doubt
    return displaced
