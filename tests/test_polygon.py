"""Polygons: lengths, angles, areas by hand; every refusal."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.polygon import NAMED, Polygon, lshape, named, square

ROUND_OFF = 1e-14
"""A few operations on numbers of size one."""


def test_square_by_hand():
    polygon = square()
    assert polygon.n_sides == 4
    assert_array_equal(polygon.starts, [0, 1, 2, 3, 4])
    assert_array_equal(polygon.tangents, [[1, 0], [0, 1], [-1, 0], [0, -1]])
    assert_array_equal(polygon.normals, [[0, -1], [1, 0], [0, 1], [-1, 0]])
    assert_allclose(polygon.angles, np.pi / 2, rtol=ROUND_OFF)
    assert polygon.area == 1
    assert_allclose(polygon.diameter, np.sqrt(2), rtol=ROUND_OFF)


def test_lshape_by_hand():
    polygon = lshape()
    assert_array_equal(polygon.lengths, [1, 1, 1, 1, 2, 2])
    assert (polygon.area, polygon.perimeter) == (3, 8)
    assert_allclose(np.rad2deg(polygon.angles), [90, 90, 270, 90, 90, 90], rtol=ROUND_OFF)
    assert_allclose(polygon.diameter, np.sqrt(8), rtol=ROUND_OFF)


def test_angles_sum_up():
    """The interior angles of an n-gon add up to (n - 2) pi, convex or not, wherever it lies."""
    star = np.array([[0, 0], [2, 1], [4, 0], [3, 2], [4, 4], [2, 3], [0, 4], [1, 2]])
    for polygon in (Polygon(star), Polygon(1e-6 * star), Polygon(star + 1e3)):
        assert_allclose(polygon.angles.sum(), 6 * np.pi, rtol=1e-12)


def test_area_far_from_the_origin_keeps_its_digits():
    """The vertices are exact after the shift, so the shoelace formula about vertex 0 is exact as well."""
    assert Polygon(square().vertices + 2.0**30).area == 1


def test_points_on_sides():
    points = square().at(np.array([0, 1, 2, 3]), np.full(4, 0.25))
    assert_array_equal(points, [[0.25, 0], [1, 0.25], [0.75, 1], [0, 0.75]])


def test_counts_ignore_round_off():
    """1 / (1 / n) can exceed n by round-off; the count is n all the same."""
    sizes = np.arange(1, 500)
    assert any(np.ceil(1 / (1 / n)) != n for n in sizes)
    assert all(square().counts(1 / n)[0] == n for n in sizes)


def test_counts_are_the_least():
    polygon = Polygon(np.array([[0, 0], [3, 0], [3, 4]]))
    assert_array_equal(polygon.counts(2.0), [2, 2, 3])
    assert_array_equal(polygon.counts(100.0), [1, 1, 1])


def test_divided_by_hand():
    polygon = Polygon(np.array([[0, 0], [3, 0], [3, 4]]))
    assert_allclose(
        polygon.divided(np.array([2, 1, 4])), [0, 1.5, 3, 7, 8.25, 9.5, 10.75, 12], rtol=ROUND_OFF
    )


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_sizes_have_to_be_positive(size):
    with pytest.raises(InputError, match="positive"):
        square().counts(size)


def test_named():
    assert [named(name).name for name in NAMED] == ["square", "lshape"]
    with pytest.raises(InputError, match="'disc' is unknown; the named ones are square, lshape"):
        named("disc")


def test_a_polygon_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        square().vertices[0, 0] = 1


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([[0, 0], [1, 0]], "at least three"),
        ([0, 1, 2], "each a pair"),
        ([[0, 0], [1, 0], [1]], "pairs x, y"),
        ([[0, 0], [1, 0], ["a", 1]], "pairs x, y"),
        ([[0, 0], [1, 0], [np.nan, 1]], "not finite"),
        ([[0, 0], [0, 1], [1, 1], [1, 0]], "clockwise"),
        ([[0, 0], [1, 0], [1, 0], [1, 1]], r"repeats its vertex 1 \(1.0, 0.0\)"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "sides 0 and 2 meet"),
        ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], "sides 0 and 2 meet"),
        ([[0, 0], [2, 0], [1, 0], [1, 1]], "sides 0 and 1 meet"),
        ([[0, 0], [1, 0], [2, 0]], "meet"),
    ],
)
def test_refusals(vertices, message):
    with pytest.raises(InputError, match=message):
        Polygon(vertices)
