"""u and f of the cases on boxes, enclosed, against their values in points, which are computed another way."""

from functools import cache, reduce

import numpy as np
import pytest

from unilateral.formulas.formula import compile_numpy
from unilateral.formulas.taylor import TaylorModel, affine_model, monomial_basis
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import case as cases
from unilateral.problems.atoms import laplacian

CASES = [
    *((name, "square") for name in ("natural", "smooth", "thirds", "singular", "rough", "violates_jj")),
    *((name, "square") for name in ("vertex", "violates_jjj", "no_contact", "full_contact")),
    *((name, "lshape") for name in ("reentrant", "violates_j")),
]
ROUNDING = 1e-11
"""Values in points are rounded by less than this fraction of the largest one."""


def draw_boxes(polygon, arm):
    """x and y on boxes with centres in the polygon, more of them near its sides, and points (9, n, 2)."""
    rng = np.random.default_rng(1)
    n = 400 if arm == 0 else 150
    low = polygon.vertices.min(axis=0)
    high = polygon.vertices.max(axis=0)
    side = rng.integers(polygon.n_sides, size=n)
    position = polygon.at(side, rng.random(n) * polygon.lengths[side])
    inner = low + (high - low) * rng.random((n, 2))
    centre = np.where(
        rng.random((n, 1)) < 0.5, inner, position + 0.3 * rng.random((n, 1)) * (inner - position)
    )
    centre = centre[polygon.contains(centre)]
    arms = arm * polygon.diameter * rng.uniform(-0.5, 0.5, (2, 2, len(centre)))
    sigma = np.concatenate([rng.uniform(-1, 1, (5, 2)), [[1, 1], [1, -1], [-1, 1], [-1, -1]]])
    points = centre + np.einsum("qi,dik->qkd", sigma, arms)
    reach = np.abs(arms).sum(axis=1)
    models = [
        affine_model(monomial_basis(2, 4), c, item, (c - r, c + r))
        for c, item, r in zip(centre.T, arms, reach, strict=True)
    ]
    return models, sigma, points


@cache
def load_of_size(name, polygon, size):
    return cases.load_solution(name, Polygon(size * find_polygon(polygon).vertices, polygon))


@pytest.mark.parametrize(("name", "polygon"), CASES)
@pytest.mark.parametrize("size", [1.0, 3.0])
@pytest.mark.parametrize("arm", [0.0, 0.01, 0.1])
def test_no_value_leaves_its_enclosure(name, polygon, size, arm):
    """u by polar coordinates, f by the derivatives of that; enclosures by series, and Delta v by hand.

    On boxes that are points, small, and as large as cutoffs; points that do not lie in Omega do not count.
    On nine tenths of the boxes at least there is a remainder. Control: values that are a thousandth of
    the largest one larger leave some of the points.
    """
    case = load_of_size(name, polygon, size)
    (x, y), sigma, points = draw_boxes(case.polygon, arm)
    inside = case.polygon.contains(points.reshape(-1, 2)).reshape(points.shape[:2])
    assert inside.sum() > 500
    powers = np.prod(sigma[:, None] ** x.basis.exponents, axis=2)
    u = reduce(TaylorModel.__add__, (atom.value_model(x, y) for atom in case.atoms))
    f = case.source_model(x, y)
    flat = points.reshape(-1, 2)
    for model, values in ((u, case.value_and_gradient(flat)[0]), (f, case.source(flat))):
        exact = np.where(inside, values.reshape(inside.shape), 0.0)
        slack = ROUNDING * np.abs(exact).max()

        def leaves(values, model=model, slack=slack):
            beyond = np.maximum(model.range[0] - values, values - model.range[1])
            return np.maximum(beyond, np.abs(values - powers @ model.c) - model.rad) > slack

        assert not np.any(leaves(exact) & inside)
        assert np.isfinite(model.rad).mean() > 0.9
        assert arm > 0 or np.any(leaves(exact + 1e-3 * np.abs(exact).max()) & inside)


@pytest.mark.parametrize("h", [1 / 6, 1 / 16, 1 / 32])
def test_f_of_a_tensor_atom_is_enclosed_closer_than_its_terms(h):
    """Not on every triangle, and by no theorem, but all together: the bounds of cases are looser otherwise.

    Control: multiplied out f has the same values.
    """
    mesh = make_structured_mesh(square(), h)
    atom = cases.load_solution("smooth", square()).atoms[0]
    corners = mesh.points[mesh.triangles]
    a, b, c = np.moveaxis(corners, 1, 0)
    arms = 0.5 * np.stack([b - a, c - a])
    ends = corners.min(axis=1), corners.max(axis=1)
    x = affine_model(monomial_basis(2, 4), 0.5 * (b + c)[:, 0], arms[..., 0], (ends[0][:, 0], ends[1][:, 0]))
    y = affine_model(monomial_basis(2, 4), 0.5 * (b + c)[:, 1], arms[..., 1], (ends[0][:, 1], ends[1][:, 1]))
    multiplied_out = atom.v - laplacian(atom.v, "t", "d")
    terms = enclose_formula(multiplied_out, {"t": x, "d": y})
    assert atom.source_model(x, y).rad.sum() < terms.rad.sum()
    values = compile_numpy([multiplied_out], ("t", "d"))(*mesh.points.T)[0]
    assert atom.value_gradient_and_source(mesh.points)[2] == pytest.approx(values, rel=1e-12, abs=1e-9)
