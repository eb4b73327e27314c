"""Polygons: lengths, angles, areas by hand; every refusal."""

import tracemalloc

import numpy as np
import pytest
import sentences
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry import plane
from unilateral.geometry.polygon import Polygon, find_polygon, polygon_names, square

ROUND_OFF = 1e-14
"""A few operations on numbers of size one."""


def test_the_square_has_the_quantities_by_hand():
    polygon = square()
    assert polygon.n_sides == 4
    assert_array_equal(polygon.starts, [0, 1, 2, 3, 4])
    assert_array_equal(polygon.tangents, [[1, 0], [0, 1], [-1, 0], [0, -1]])
    assert_array_equal(polygon.normals, [[0, -1], [1, 0], [0, 1], [-1, 0]])
    assert_allclose(polygon.angles, np.pi / 2, rtol=ROUND_OFF)
    assert polygon.area == 1
    assert_allclose(polygon.diameter, np.sqrt(2), rtol=ROUND_OFF)
    points = polygon.at(np.arange(4), np.full(4, 0.25))
    assert_array_equal(points, [[0.25, 0], [1, 0.25], [0.75, 1], [0, 0.75]])


def test_the_lshape_has_the_quantities_by_hand():
    polygon = find_polygon("lshape")
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


def regular(n):
    """(n, 2) the vertices of a regular polygon."""
    angles = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angles), np.sin(angles)])


def test_the_number_of_vertices_is_limited_before_they_are_compared(monkeypatch):
    """Control: one vertex less is compared; the circumscribed circle's diameter is 2.

    Sides of one quadrant rise or fall all the way, so only neighbours have rectangles that meet.
    """
    compared = []
    compare = plane._sides_meet

    def count(starts, ends, i, j):
        compared.extend(zip(i.tolist(), j.tolist(), strict=True))
        return compare(starts, ends, i, j)

    monkeypatch.setattr(plane, "_sides_meet", count)
    with sentences.raises(InputError):
        Polygon(regular(1001))
    assert compared == []
    assert_allclose(Polygon(regular(1000)).diameter, 2, rtol=ROUND_OFF)
    assert sorted(compared) == sorted([(i, i + 1) for i in range(999)] + [(0, 999)])


def test_memory_grows_like_the_number_of_vertices():
    """At its peak less than 100 numbers per vertex; all pairs would be 1000 per vertex, in each array."""
    vertices = regular(1000)
    tracemalloc.start()
    assert Polygon(vertices).diameter > 1
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100 * 8 * len(vertices)


@pytest.mark.parametrize(
    ("n", "i", "j"), [(8, 0, 2), (8, 1, 3), (8, 3, 7), (8, 2, 6), (100, 70, 73), (100, 2, 99)]
)
def test_the_first_crossing_is_found_anywhere(n, i, j):
    """Two vertices of an n-gon exchanged: the sides that then cross first, by all pairs of segments."""
    vertices = regular(n)
    vertices[[i, j]] = vertices[[j, i]]
    after = np.roll(vertices, -1, axis=0)

    def cross(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    def meet(k, m):
        a = vertices[k]
        b = after[k]
        c = vertices[m]
        d = after[m]
        return cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0

    first = next((k, m) for k in range(n) for m in range(k + 1, n) if meet(k, m))
    with sentences.raises(InputError, f"its sides {first[0]} and {first[1]} meet"):
        Polygon(vertices)


def test_counts_ignore_round_off():
    """1 / (1 / n) can exceed n by round-off; the count is n all the same."""
    sizes = np.arange(1, 500)
    assert any(np.ceil(1 / (1 / n)) != n for n in sizes)
    assert all(square().counts(1 / n)[0] == n for n in sizes)


def test_counts_are_the_least_ones_and_divisions_are_even():
    """The counts are the least ones."""
    polygon = Polygon(np.array([[0, 0], [3, 0], [3, 4]]))
    assert_array_equal(polygon.counts(2.0), [2, 2, 3])
    assert_array_equal(polygon.counts(100.0), [1, 1, 1])
    points = polygon.divided(np.array([2, 1, 4]))
    assert_allclose(points, [0, 1.5, 3, 7, 8.25, 9.5, 10.75, 12], rtol=ROUND_OFF)


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf, 1e-300, 1e-10])
def test_sizes_out_of_range_are_refused(size):
    with sentences.raises(InputError):
        square().counts(size)
    assert square().counts(1e-6).tolist() == [10**6] * 4


@pytest.mark.parametrize("name", ["edges", "lengths", "starts", "stretch", "tangents", "normals", "angles"])
def test_nothing_changes_a_polygon_that_all_cases_share(name):
    """Control: a copy can be written into."""
    shared = getattr(find_polygon("square"), name)
    copied = shared.copy()
    copied[0] = 5.0
    with pytest.raises(ValueError, match="read-only"):
        shared[0] = 5.0
    assert_array_equal(getattr(Polygon(find_polygon("square").vertices), name), shared)


def test_named_polygons_have_their_declared_angles_and_lengths():
    assert {"square", "lshape"} <= set(polygon_names())
    assert [find_polygon(name).name for name in polygon_names()] == polygon_names()
    exact = [7 / 20, 9 / 10, 3 / 4, 7 / 20, 9 / 10, 3 / 4]
    assert_allclose(find_polygon("hexagon").angles / np.pi, exact, rtol=1e-15)
    assert_allclose(find_polygon("hexagon").lengths, [1 / 2, 1 / 2, 3 / 4] * 2, rtol=1e-15)
    with sentences.raises(InputError, "disc", *polygon_names()):
        find_polygon("disc")


@pytest.mark.parametrize(
    "vertices",
    [
        [[0, 0], [1, 0]],
        [0, 1, 2],
        [[0, 0], [1, 0], [np.nan, 1]],
        [[0, 0], [0, 1], [1, 1], [1, 0]],
        [[0, 0], [1, 0], [1, 0], [1, 1]],
        [[0, 0], [1, 0], [1, 1], [0, 0]],
        [[0, 0], [1, 1], [1, 0], [0, 1]],
        [[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]],
        [[0, 0], [2, 0], [1, 0], [1, 1]],
        [[0, 0], [1, 0], [2, 0]],
        *(size * square().vertices for size in (1e-300, 1e-160, 1e-76, 1e76, 1e160, 1e300, 1.7e308)),
        *([[0, 0], [1, 0], [1, 1], [0, y]] for y in (1e76, 1e300, 1.7e308)),
        *([[0, 0], [x, 0], *square().vertices[1:]] for x in (1e-300, 1e-20, 4e-16)),
    ],
)
def test_vertices_that_are_no_polygon_are_refused(vertices):
    """In one sentence: NumPy's warnings would be errors here.

    The ends of a side that is lost beside the perimeter have the same arc length, or its square is 0.
    """
    with sentences.raises(InputError):
        Polygon(vertices, "far")


def test_polygons_at_the_limits_are_accepted():
    assert Polygon([[0, 0], [1e-14, 0], *square().vertices[1:]]).n_sides == 5
    for size in (1e-75, 1e75):
        assert_allclose(Polygon(size * square().vertices).area, size**2, rtol=ROUND_OFF)
