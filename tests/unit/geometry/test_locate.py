"""In which triangles points lie: against all triangles, one by one, in exact arithmetic."""

import numpy as np
import pytest
from nested import coarse, make_mesh_levels

from unilateral.geometry import locate
from unilateral.geometry.locate import locate_in_triangles
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.polygon import Polygon, square

FAR = 1e5 * np.array([1.0, -1.0])
MESHES = ["square 8", "gmsh", "flat", "one triangle", "far away"]


def mesh_of(name):
    if name == "far away":
        return make_unstructured_mesh(Polygon(FAR + square().vertices), 0.2)
    return make_mesh_levels(name, "at random", 6).mesh if name == "flat" else coarse(name)


def exactly(mesh, points):
    """For each point the triangles that contain it, by signs of areas in whole numbers.

    Coordinates are doubles, so that all are multiples of one power of 2.
    """
    ratios = [z.as_integer_ratio() for z in np.concatenate([mesh.points, points]).ravel().tolist()]
    unit = max(bottom for _, bottom in ratios)
    full = np.array([top * (unit // bottom) for top, bottom in ratios], dtype=object).reshape(-1, 2)
    corners = full[: mesh.n_nodes][mesh.triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    containing_triangles = []
    for point in full[mesh.n_nodes :]:
        away = point - corners
        areas = edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0]
        containing_triangles.append(set(np.flatnonzero((areas >= 0).all(axis=1)).tolist()))
    return containing_triangles


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("block", [7, locate.MAX_POINTS_LOCATED])
def test_points_lie_in_the_triangles_in_which_they_are_found(name, block, monkeypatch):
    """Random ones, inside or not, and nodes and midpoints, which lie in several triangles."""
    monkeypatch.setattr(locate, "MAX_POINTS_LOCATED", block)
    mesh = mesh_of(name)
    rng = np.random.default_rng(3)
    low = mesh.points.min(axis=0) - 0.1
    high = mesh.points.max(axis=0) + 0.1
    points = np.concatenate([rng.uniform(low, high, (60, 2)), mesh.points[:20], [[np.nan, 0.5], [np.inf, 0]]])
    indices, triangle, weights = locate_in_triangles(mesh, points)
    places = np.einsum("pi,pid->pd", weights, mesh.points[mesh.triangles[triangle]])
    np.testing.assert_allclose(places, points[indices], rtol=1e-14, atol=1e-14)
    for k, expected in enumerate(exactly(mesh, points[:-2])):
        assert set(triangle[indices == k].tolist()) == expected
    assert indices.max() < len(points) - 2
