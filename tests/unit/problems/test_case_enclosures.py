"""u and f of the cases on boxes, enclosed, against their values in points, which are computed another way."""

from functools import reduce

import numpy as np
import pytest

from unilateral.formulas.taylor import Model, affine, basis
from unilateral.geometry.polygon import Polygon, named
from unilateral.problems import case as cases

CASES = [
    *((name, "square") for name in ("natural", "smooth", "thirds", "singular", "rough", "violates_jj")),
    *((name, "square") for name in ("vertex", "violates_jjj", "no_contact", "full_contact")),
    *((name, "lshape") for name in ("reentrant", "violates_j")),
]
ROUNDING = 1e-11
"""Values in points are rounded by less than this fraction of the largest one."""


def on_boxes(polygon, arm):
    """x and y on boxes with centres in the polygon, more of them near its sides, and points (9, n, 2)."""
    rng, n = np.random.default_rng(1), 400 if arm == 0 else 150
    low, high = polygon.vertices.min(axis=0), polygon.vertices.max(axis=0)
    side = rng.integers(polygon.n_sides, size=n)
    at = polygon.at(side, rng.random(n) * polygon.lengths[side])
    inner = low + (high - low) * rng.random((n, 2))
    centre = np.where(rng.random((n, 1)) < 0.5, inner, at + 0.3 * rng.random((n, 1)) * (inner - at))
    centre = centre[polygon.contains(centre)]
    arms = arm * polygon.diameter * rng.uniform(-0.5, 0.5, (2, 2, len(centre)))
    sigma = np.concatenate([rng.uniform(-1, 1, (5, 2)), [[1, 1], [1, -1], [-1, 1], [-1, -1]]])
    points = centre + np.einsum("qi,dik->qkd", sigma, arms)
    reach = np.abs(arms).sum(axis=1)
    models = [
        affine(basis(2, 4), c, of, (c - r, c + r)) for c, of, r in zip(centre.T, arms, reach, strict=True)
    ]
    return models, sigma, points


@pytest.mark.parametrize(("name", "polygon"), CASES)
@pytest.mark.parametrize("size", [1.0, 3.0])
@pytest.mark.parametrize("arm", [0.0, 0.01, 0.1])
def test_no_value_leaves_its_enclosure(name, polygon, size, arm):
    """u by polar coordinates, f by the derivatives of that; enclosures by series, and Delta v by hand.

    On boxes that are points, small, and as large as cutoffs; points that do not lie in Omega do not count.
    On nine tenths of the boxes at least there is a remainder. Control: values that are a thousandth of
    the largest one larger leave some of the points.
    """
    case = cases.load(name, Polygon(size * named(polygon).vertices, polygon))
    (x, y), sigma, points = on_boxes(case.polygon, arm)
    inside = case.polygon.contains(points.reshape(-1, 2)).reshape(points.shape[:2])
    assert inside.sum() > 500
    powers = np.prod(sigma[:, None] ** x.basis.exponents, axis=2)
    u = reduce(Model.__add__, (atom.value_model(x, y) for atom in case.atoms))
    f, flat = case.source_model(x, y), points.reshape(-1, 2)
    for model, values in ((u, case.value_and_gradient(flat)[0]), (f, case.source(flat))):
        exact = np.where(inside, values.reshape(inside.shape), 0.0)
        slack = ROUNDING * np.abs(exact).max()

        def leaves(values, model=model, slack=slack):
            beyond = np.maximum(model.range[0] - values, values - model.range[1])
            return np.maximum(beyond, np.abs(values - powers @ model.c) - model.rad) > slack

        assert not np.any(leaves(exact) & inside)
        assert np.isfinite(model.rad).mean() > 0.9
        assert arm > 0 or np.any(leaves(exact + 1e-3 * np.abs(exact).max()) & inside)
