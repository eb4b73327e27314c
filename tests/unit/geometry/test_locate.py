"""In which triangles points lie: against all triangles, one by one, in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from nested import coarse, made

from unilateral.geometry import locate
from unilateral.geometry.locate import containing
from unilateral.geometry.mesh import unstructured
from unilateral.geometry.polygon import Polygon, square

FAR = 1e5 * np.array([1.0, -1.0])
MESHES = ["square 8", "gmsh", "flat", "one triangle", "far away"]


def mesh_of(name):
    if name == "far away":
        return unstructured(Polygon(FAR + square().vertices), 0.2)
    return made(name, "at random", 6).mesh if name == "flat" else coarse(name)


def exactly(mesh, point):
    """The triangles that contain a point, by signs of areas in fractions."""
    x, y = map(Fraction, point)
    inside = set()
    for number, nodes in enumerate(mesh.triangles):
        corners = [tuple(map(Fraction, mesh.points[i].tolist())) for i in nodes]
        turned = zip(corners, corners[1:] + corners[:1], strict=True)
        if all((c - a) * (y - b) >= (d - b) * (x - a) for (a, b), (c, d) in turned):
            inside.add(number)
    return inside


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("block", [7, locate.BLOCK])
def test_points_lie_in_the_triangles_in_which_they_are_found(name, block, monkeypatch):
    """Random ones, inside or not, and nodes and midpoints, which lie in several triangles."""
    monkeypatch.setattr(locate, "BLOCK", block)
    mesh, rng = mesh_of(name), np.random.default_rng(3)
    low, high = mesh.points.min(axis=0) - 0.1, mesh.points.max(axis=0) + 0.1
    points = np.concatenate([rng.uniform(low, high, (60, 2)), mesh.points[:20], [[np.nan, 0.5], [np.inf, 0]]])
    at, triangle, weights = containing(mesh, points)
    places = np.einsum("pi,pid->pd", weights, mesh.points[mesh.triangles[triangle]])
    np.testing.assert_allclose(places, points[at], rtol=1e-14, atol=1e-14)
    for k, point in enumerate(points[:-2].tolist()):
        assert set(triangle[at == k].tolist()) == exactly(mesh, point)
    assert at.max() < len(points) - 2
