"""Polynomials on pieces of sides against rational arithmetic: what rounding may do to their values."""

from fractions import Fraction

import numpy as np

from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import ORDER, IntervalPieces, Piecewise


def pieces(rng, k=40):
    """On one side of a square, with ends that are no sums of powers of 2, and coefficients of many sizes."""
    start = np.concatenate([[0.0], np.sort(rng.uniform(0, 1, k - 1))])
    c = rng.standard_normal((ORDER + 1, k)) * 10.0 ** rng.uniform(-3, 3, (ORDER + 1, k))
    zero, side = np.zeros(k), np.zeros(k, dtype=np.intp)
    return IntervalPieces(side, start, np.append(start[1:], 1.0), c, zero, zero, zero)


def errors_over_bounds(seed):
    """At random places, known exactly by their shares of the side."""
    rng = np.random.default_rng(seed)
    polygon = Polygon(np.array([[0, 0], [1 / 3, 1 / 7], [0.1, 0.9]]))
    of, length = pieces(rng), float(polygon.lengths[0])
    points = of.points(polygon)
    points[-1] = length
    bound = of.rounding(points)
    found = Piecewise(polygon, points, of.side, of.c, *np.zeros((3, len(of.side))))
    for i, (start, end) in enumerate(zip(of.start.tolist(), of.end.tolist(), strict=True)):
        t = Fraction(start) + (Fraction(end) - Fraction(start)) * Fraction(rng.uniform(0.01, 0.99))
        value = found.at(np.array([i]), np.array([float(t * Fraction(length))]))[0].item()
        sigma = 2 * (t - Fraction(start)) / (Fraction(end) - Fraction(start)) - 1
        exact = sum(Fraction(x) * sigma**k for k, x in enumerate(of.c[:, i].tolist()))
        yield float(abs(Fraction(value) - exact)) / bound[i]


def test_values_are_off_by_no_more_than_is_allowed():
    """Control: a thousandth of that would be too little."""
    worst = max(max(errors_over_bounds(seed)) for seed in range(5))
    assert 1e-3 < worst <= 1


def test_large_constants_are_rounded_as_sums_are():
    """At a place that is exact, of a large constant with a little more, which a shift hardly changes."""
    rng, worst = np.random.default_rng(1), 0.0
    for _ in range(50):
        c = rng.standard_normal((ORDER + 1, 1))
        c[0] *= 1e6
        of = IntervalPieces(np.zeros(1, dtype=np.intp), *np.array([[0.0], [1.0]]), c, *np.zeros((3, 1)))
        polygon = Polygon(np.array([[0, 0], [1, 0], [0, 1]]))
        found = Piecewise(polygon, np.array([0.0, 1.0]), of.side, c, *np.zeros((3, 1)))
        value = found.at(np.array([0]), np.array([0.75]))[0].item()
        exact = sum(Fraction(x) / 2**k for k, x in enumerate(c[:, 0].tolist()))
        allowed = of.rounding(np.array([0.0, 1.0])).item()
        worst = max(worst, float(abs(Fraction(value) - exact)) / allowed)
    assert 1e-3 < worst <= 1
