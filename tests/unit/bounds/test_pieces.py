"""Pieces of triangles with coordinates that cancel: f is known at the places, not at the rounded ones."""

from fractions import Fraction

import numpy as np
from test_source import Source

from unilateral.bounds import pieces
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon

K = 40


def test_corners_whose_coordinates_cancel_are_off_by_their_rounding():
    """f = x on pieces near x = 0 of a large triangle; their barycentric corners are exact, sums of 2^-40.

    x at the corners, by rational numbers, is within the bound of |f - p|. Control: p is off by more than the
    rounding of numbers as small as that.
    """
    x, y = np.array([-1e6 / 3, 1e6 / 3 + 0.1, 0.3]), np.array([-1e6 / 7, -1e6 / 7, 1e6 / 3])
    points, unit = np.column_stack([x, y]), 2.0**-40
    mesh = meshes.from_arrays(Polygon(points, "large"), points, [[0, 1, 2]])
    first = 1 / 3 + 1e-7 * np.random.default_rng(1).uniform(-1, 1, (K, 2))
    first = unit * np.round(first / unit)
    first = np.column_stack([first, 1 - first.sum(axis=1)])
    corners = np.stack([first, first + 9e4 * unit * np.array([1, -1, 0]), first], axis=1)
    corners[:, 2] += 9e4 * unit * np.array([0, 1, -1])
    assert np.all(corners.sum(axis=2) == 1)
    found, worst = pieces.on_block(mesh, corners, np.zeros(K, dtype=int), Source("x")), 0.0
    for k, known in enumerate(np.sqrt(found.squares / found.outer)):
        c, *slopes = (Fraction(float(each)) for each in found.c[:3, k])
        at_corners = (c - slopes[0] - slopes[1], c - slopes[0] + slopes[1], c + slopes[0] - slopes[1])
        for p, weights in zip(at_corners, found.corners[k].tolist(), strict=True):
            exact = sum(Fraction(b) * Fraction(each) for b, each in zip(weights, x.tolist(), strict=True))
            assert abs(p - exact) <= known
            worst = max(worst, float(abs(p - exact)))
    assert worst > 1e-12
