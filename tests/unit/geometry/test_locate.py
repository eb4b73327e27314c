"""In which triangles points lie: against all triangles, one by one, in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from unilateral.geometry import locate
from unilateral.geometry.locate import containing
from unilateral.geometry.mesh import from_arrays, unstructured
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

FAR = 1e5 * np.array([1.0, -1.0])


MESHES = {
    "structured": lambda: structured(square(), 1 / 8),
    "unstructured": lambda: unstructured(named("lshape"), 0.2),
    "far away": lambda: unstructured(Polygon(FAR + square().vertices), 0.2),
    "one triangle": lambda: from_arrays(
        Polygon([[0, 0], [1, 0], [0, 1]]), np.array([[0.0, 0], [1, 0], [0, 1]]), np.array([[0, 1, 2]])
    ),
}


def exactly(mesh, point):
    """The triangles that contain a point, by signs of areas in fractions."""
    x, y = map(Fraction, point)
    found = set()
    for number, nodes in enumerate(mesh.triangles):
        corners = [tuple(map(Fraction, mesh.points[i].tolist())) for i in nodes]
        turned = zip(corners, corners[1:] + corners[:1], strict=True)
        if all((c - a) * (y - b) >= (d - b) * (x - a) for (a, b), (c, d) in turned):
            found.add(number)
    return found


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("block", [7, locate.BLOCK])
def test_points_lie_in_the_triangles_in_which_they_are_found(name, block, monkeypatch):
    """Random ones, inside or not, and nodes and midpoints, which lie in several triangles."""
    monkeypatch.setattr(locate, "BLOCK", block)
    mesh, rng = MESHES[name](), np.random.default_rng(3)
    low, high = mesh.points.min(axis=0) - 0.1, mesh.points.max(axis=0) + 0.1
    points = np.concatenate([rng.uniform(low, high, (60, 2)), mesh.points[:20], [[np.nan, 0.5], [np.inf, 0]]])
    at, triangle, weights = containing(mesh, points)
    places = np.einsum("pi,pid->pd", weights, mesh.points[mesh.triangles[triangle]])
    np.testing.assert_allclose(places, points[at], rtol=1e-14, atol=1e-14)
    for k, point in enumerate(points[:-2].tolist()):
        assert set(triangle[at == k].tolist()) == exactly(mesh, point)
    assert at.max() < len(points) - 2
