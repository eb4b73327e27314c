"""Friedrichs' constant on domains whose eigenvalues are known in closed form, and where rounding hides it."""

import math

import numpy as np
import pytest

from unilateral.errors import InputError
from unilateral.fem import poincare
from unilateral.fem.poincare import friedrichs
from unilateral.geometry.mesh import unstructured
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

THIRD = Polygon(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]]), "long")
KNOWN = [
    (square(), (3,), 2 / math.pi),
    (square(), (0, 2), 1 / math.pi),
    (square(), (0, 1, 2, 3), 1 / (math.pi * math.sqrt(2))),
    (THIRD, (3,), 6 / math.pi),
    (THIRD, (2, 3), 1 / (math.pi * math.hypot(1 / 2, 1 / 6))),
]


@pytest.mark.parametrize(("polygon", "clamped", "exact"), KNOWN)
@pytest.mark.parametrize("mesh", [structured, unstructured])
def test_it_is_a_little_above_the_best_one(polygon, clamped, exact, mesh):
    for h in (1, 1 / 8):
        assert exact <= friedrichs(mesh(polygon, h), clamped) <= 1.03 * exact


def test_a_larger_eigenvalue_is_refused(monkeypatch):
    """Control: no number above the least eigenvalue passes for a lower bound."""
    monkeypatch.setattr(poincare, "LESS", 1.001)
    with pytest.raises(InputError, match="too thin for Friedrichs' inequality"):
        friedrichs(structured(square(), 1 / 8), (0,))


def test_another_mesh_serves_where_rounding_hides_the_eigenvalue(monkeypatch):
    """As on a mesh that is graded to a point, whose least triangles have huge numbers."""
    found = friedrichs(structured(named("lshape"), 1 / 8), (1,))
    on, met = poincare._on, []

    def hidden(mesh, clamped):
        met.append(mesh)
        return math.inf if len(met) == 1 else on(mesh, clamped)

    monkeypatch.setattr(poincare, "_on", hidden)
    assert friedrichs(structured(named("lshape"), 1 / 8), (1,)) == pytest.approx(found, rel=0.05)
    assert len(met) == 2


def test_one_that_is_known_serves_where_it_is_smaller(monkeypatch):
    """Then no other mesh is made either."""
    mesh = structured(square(), 1 / 8)
    assert friedrichs(mesh, (3,), 1.0) == friedrichs(mesh, (3,))
    assert friedrichs(mesh, (3,), 0.5) == 0.5
    monkeypatch.setattr(poincare, "_on", lambda mesh, clamped: math.inf)
    monkeypatch.delattr(poincare, "unstructured")
    assert friedrichs(mesh, (3,), 1.0) == 1.0
