"""f of every case on small triangles, enclosed, against its values, which are derived by other formulas."""

import numpy as np
import pytest
from conftest import load

from unilateral.bounds.source_pieces import ORDER, on_triangles, rounded_size
from unilateral.formulas.taylor import basis
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured

ON = {
    name: "square"
    for name in ("natural", "smooth", "thirds", "full_contact", "no_contact", "singular", "rough", "vertex")
} | {"reentrant": "lshape", "violates_j": "lshape"}
PER_TRIANGLE = 20
VALUES = 1e-12
"""Of the largest |f|: the rounding of its values in points."""


def outside(case, n=16):
    """Of points in triangles on which f has a bound: by how much f lies outside; and how many there are."""
    mesh = structured(case.polygon, 1 / n)
    corners, m = mesh.points[mesh.triangles], len(mesh.triangles)
    c, known, ordered = on_triangles(corners, rounded_size(mesh), case)
    hats = np.random.default_rng(3).dirichlet(np.ones(3), (m, PER_TRIANGLE))
    f = case.source(np.einsum("tqi,tid->tqd", hats, corners).reshape(-1, 2)).reshape(m, -1)
    first = np.argmax((corners == ordered[:, :1]).all(axis=2), axis=1)
    order = (first[:, None] + np.arange(1, 3)) % 3
    sigma = 2 * np.take_along_axis(hats, order[:, None], axis=2) - 1
    monomials = np.prod(sigma[:, :, None] ** basis(2, ORDER).exponents, axis=3)
    p = np.einsum("tqk,kt->tq", monomials, c)
    bounded = np.isfinite(known)
    missed = np.abs(f - p)[bounded] - known[bounded, None]
    return missed - VALUES * np.abs(f[bounded]).max()


@pytest.mark.parametrize("name", ON)
def test_f_lies_in_its_enclosure(name):
    """On all triangles but those at a singular point, and those are few."""
    missed = outside(load(name, ON[name]))
    assert missed.size > 0.9 * PER_TRIANGLE * 2 * 16**2 * named(ON[name]).area
    assert missed.max() <= 0


@pytest.mark.parametrize("name", ["singular", "reentrant", "smooth"])
def test_another_f_does_not(name, monkeypatch):
    """Control: one that is a twentieth larger."""
    case = load(name, ON[name])
    source = case.source
    monkeypatch.setattr(type(case), "source", lambda _, points: 1.05 * source(points))
    assert outside(case).max() > 0
