"""Loads by parts, against the load of the whole mesh."""

import numpy as np
import pytest

from unilateral.fem import loads
from unilateral.fem.p1 import load
from unilateral.geometry.mesh import refine, unstructured
from unilateral.geometry.polygon import named


def moments(mesh):
    """Of an f that is linear on each triangle, but for rounding of no interest here."""
    return mesh.areas[:, None] * np.exp(mesh.points[mesh.triangles].sum(axis=2))


@pytest.mark.parametrize("times", [0, 2])
def test_loads_by_parts_are_those_of_the_mesh(times, monkeypatch):
    monkeypatch.setattr(loads, "PART", 5)
    mesh = refine(unstructured(named("lshape"), 0.4), times)
    parts = list(loads.parts(mesh))
    assert len(parts) > 1
    assert sum(len(part.triangles) for part in parts) == len(mesh.triangles)
    np.testing.assert_allclose(loads.by_parts(mesh, moments), load(mesh, moments(mesh)), atol=1e-15)
    assert abs(sum(part.areas.sum() for part in parts[1:]) - mesh.polygon.area) > 1e-3
