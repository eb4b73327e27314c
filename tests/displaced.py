"""Meshes whose nodes may be away from their exact places, as rounding makes them, by much more than that."""

from unilateral.geometry.mesh import Mesh


def in_doubt(mesh: Mesh, doubt: float) -> Mesh:
    """The mesh, each of whose nodes may be displaced by `doubt`, and its sides stretched by twice that."""
    polygon = mesh.polygon
    vars(polygon)["stretch"] = polygon.stretch + 2 * doubt / polygon.lengths
    vars(mesh)["shift"] = mesh.shift + doubt
    return mesh
