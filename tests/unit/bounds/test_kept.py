"""f on refined meshes: what is kept is what would be found anew, and only new triangles are looked at."""

from dataclasses import replace

import numpy as np
import pytest
from test_source import Source
from unilateral.bounds.kept import kept

from unilateral.bounds import kept as keeping
from unilateral.bounds.source import enclosed
from unilateral.geometry.adapted import adapted, refined
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import structured


def two_meshes():
    """One, and the same with some of its triangles halved, which scikit-fem turns and sorts anew."""
    of = adapted(structured(square(), 1 / 8))
    return of.mesh, refined(of, np.arange(0, 120, 7), np.zeros(of.mesh.n_nodes))[0].mesh


@pytest.mark.parametrize("text", ["x**2*y - 3*x", "1 + 0.5*y**3"])
def test_of_polynomials_it_is_what_is_found_anew(text):
    """They are enclosed exactly, up to rounding, whatever the size of the triangles."""
    coarse, fine = two_meshes()
    data = Source(text)
    found, anew = kept(enclosed(coarse, data), fine, data), enclosed(fine, data)
    for of, expected in ((found.f_h, anew.f_h), (found.moments, anew.moments)):
        np.testing.assert_allclose(of, expected, atol=1e-13)
    np.testing.assert_allclose(found.oscillation, anew.oscillation, atol=1e-13)
    assert found.mesh is fine
    assert found.resolved


def test_only_new_triangles_are_looked_at(monkeypatch):
    """Counted. They are those with a node that the first mesh does not have."""
    (coarse, fine), data, looked_at = two_meshes(), Source("exp(x*y)"), []

    def seen(mesh, data):
        looked_at.append(mesh.triangles)
        return enclosed(mesh, data)

    before = enclosed(coarse, data)
    monkeypatch.setattr(keeping, "enclosed", seen)
    found = kept(before, fine, data)
    (only,) = looked_at
    new = (fine.triangles >= coarse.n_nodes).any(axis=1)
    assert 0 < new.sum() < len(new)
    np.testing.assert_array_equal(only, fine.triangles[new])
    assert kept(found, fine, data) is found


def test_what_is_unknown_stays_unknown():
    """Of the triangles that are kept; control: not of others."""
    (coarse, fine), data = two_meshes(), Source("exp(x)")
    before = enclosed(coarse, data)
    found = kept(replace(before, rest=before.rest + 7, resolved=False), fine, data)
    old = (fine.triangles < coarse.n_nodes).all(axis=1)
    assert np.all(found.rest[old] >= 7)
    assert np.all(found.rest[~old] < 1)
    assert not found.resolved
