"""Partitions T_H of the boundary: cells by hand, properties for any polygon, every refusal."""

import numpy as np
import pytest
import sentences
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry.partition import (
    Partition,
    balance_cells,
    common_refinement,
    divide_cells,
    from_points,
    make_shifted_partition,
    make_uniform_partition,
)
from unilateral.geometry.polygon import Polygon, find_polygon, square


@st.composite
def star_polygons(draw):
    """Polygons that are star-shaped about a point, of any size and place: simple by construction."""
    n = draw(st.integers(3, 8))
    radii = np.array(draw(st.lists(st.floats(0.3, 1), min_size=n, max_size=n)))
    turn = draw(st.floats(0, 2 * np.pi)) + 2 * np.pi * np.arange(n) / n
    size = 10.0 ** draw(st.integers(-6, 6))
    return Polygon(
        size * (radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]) + draw(st.floats(-9, 9)))
    )


@settings(derandomize=True, max_examples=40, deadline=None)
@given(star_polygons(), st.floats(0.02, 3), st.integers(0, 99), st.booleans())
def test_cells_tile_the_boundary(polygon, relative_H, percent, halved):
    H = relative_H * polygon.diameter
    partition = make_shifted_partition(polygon, H, percent / 100)
    if halved:
        partition = divide_cells(partition)
    assert_allclose(partition.lengths.sum(), polygon.perimeter, rtol=1e-13)
    assert np.isin(polygon.starts, partition.points).all()
    assert_allclose(np.bincount(partition.side, partition.lengths), polygon.lengths, rtol=1e-9)
    assert (1 + percent / 100) * H * (1 + 1e-9) >= partition.H


@pytest.mark.parametrize("k", range(10))
def test_dyadic_points_are_exact(k):
    """Every number involved has a short binary expansion, so equality is exact."""
    assert_array_equal(make_uniform_partition(square(), 2.0**-k).points, np.arange(4 * 2**k + 1) / 2**k)


def test_uniform_cells_are_those_by_hand():
    partition = make_uniform_partition(Polygon(np.array([[0, 0], [3, 0], [3, 4]])), 2)
    assert_allclose(partition.lengths, [1.5, 1.5, 2, 2, 5 / 3, 5 / 3, 5 / 3], rtol=1e-14)
    assert_array_equal(partition.side, [0, 0, 1, 1, 2, 2, 2])
    assert partition.n_cells == 7
    assert_allclose((partition.H, partition.H_over_Hi_max), (2, 4 / 3), rtol=1e-14)


def test_shifted_cells_are_those_by_hand():
    partition = make_shifted_partition(square(), 0.5, 0.25)
    one_side = np.array([0, 0.625])
    assert_array_equal(partition.points, np.append((np.arange(4)[:, None] + one_side).ravel(), 4))
    assert_allclose(partition.H_over_Hi_max, 0.625 / 0.375, rtol=1e-14)
    assert_array_equal(
        make_shifted_partition(find_polygon("lshape"), 0.5, 0).points,
        make_uniform_partition(find_polygon("lshape"), 0.5).points,
    )


def test_refining_halves_every_cell():
    coarse = from_points(square(), [0, 0.125, 1, 2, 3, 3.5, 4])
    fine = divide_cells(coarse)
    assert_array_equal(fine.lengths, np.repeat(coarse.lengths / 2, 2))
    assert_array_equal(
        divide_cells(make_uniform_partition(find_polygon("lshape"), 0.25)).points,
        make_uniform_partition(find_polygon("lshape"), 0.125).points,
    )


def test_vertices_known_up_to_round_off_are_snapped():
    polygon = Polygon(np.array([[0, 0], [1, 0], [0, 1]]))
    displaced = 1e-13 * polygon.perimeter
    partition = from_points(
        polygon, [displaced, 0.5, 1 + displaced, 1 + np.sqrt(2) - displaced, polygon.perimeter + displaced]
    )
    assert_array_equal(np.delete(partition.points, 1), polygon.starts)


@pytest.mark.parametrize(
    "points",
    [
        [0, 1, 2, 4],
        [1, 2, 3, 4],
        [],
        [0, 1, 1, 2, 3, 4],
        [0, 1, 2, 1.5, 3, 4],
        [-0.5, 0, 1, 2, 3, 4],
        [-1e-11, 0, 1, 2, 3, 4],
        [0, 1, 2, 3, 4, 4 + 1e-11],
        [0, 1, 2, 3, 4, 4.5],
        [0, 1, np.nan, 2, 3, 4],
        [0, 1, 2, 3, np.inf],
    ],
)
def test_points_that_are_no_partition_are_refused(points):
    with sentences.raises(InputError):
        from_points(square(), points)


def test_the_class_refuses_vertices_that_are_not_exact():
    """No snapping there: the vertices have to be exact."""
    with sentences.raises(InputError):
        Partition(square(), np.array([0, 1 + 1e-13, 2, 3, 4]))


@pytest.mark.parametrize("fraction", [-0.1, 1.0, np.nan])
def test_shifts_are_fractions(fraction):
    with sentences.raises(InputError):
        make_shifted_partition(square(), 0.5, fraction)


def test_balanced_cells_are_at_most_twice_as_long_as_their_neighbours():
    """Beside a side of 1/8 the cells of the unit sides are 1/4, 1/4, 1/2 long, from both of its ends."""
    polygon = Polygon([(0, 0), (1, 0), (1, 1 / 8), (0, 1 / 8)], "strip")
    cells = balance_cells(make_uniform_partition(polygon, 1))
    expected = [1 / 4, 1 / 4, 1 / 4, 1 / 4, 1 / 8]
    assert cells.lengths == pytest.approx(2 * expected, rel=1e-12)
    one_short = Polygon([(0, 0), (1, 0), (1, 1), (1 / 8, 1), (0, 1 - 1e-3)], "cut")
    lengths = balance_cells(make_uniform_partition(one_short, 1)).lengths
    assert np.all(lengths <= (2 + 1e-9) * np.minimum(np.roll(lengths, 1), np.roll(lengths, -1)))
    assert np.any(lengths > 0.4)
    alike = make_uniform_partition(find_polygon("lshape"), 1 / 3)
    assert balance_cells(alike) is alike


def test_the_common_refinement_has_the_points_of_all_partitions():
    """Halves and thirds of a side; a point that is another up to round-off adds none."""
    near = from_points(square(), [0, np.nextafter(0.5, 1), 1, 1.5, 2, 2.5, 3, 3.5, 4])
    refinement = common_refinement(
        [make_uniform_partition(square(), 1 / 3), make_uniform_partition(square(), 1 / 2), near]
    )
    one_side = np.array([0, 1 / 3, 1 / 2, 2 / 3])
    assert_allclose(refinement.points, np.append((np.arange(4)[:, None] + one_side).ravel(), 4), rtol=1e-14)
    assert common_refinement([near]).n_cells == 8


@pytest.mark.parametrize(("share", "same"), [(0.9, True), (1.1, False)])
def test_points_are_one_up_to_1e_12_of_the_perimeter(share, same):
    """A thousand times the rounding of arc lengths, a few 1e-16 of the perimeter a sum; cells are longer."""
    halves = make_uniform_partition(square(), 1 / 2)
    displaced = share * 1e-12 * square().perimeter
    shifted_partition = Partition(square(), halves.points + displaced * (np.arange(9) == 1))
    assert common_refinement([halves, shifted_partition]).n_cells == (8 if same else 9)
    assert shifted_partition.has_inside(np.array([0.5])).any() == (not same)
    at_a_vertex = [0, 1 + displaced, 2, 3, 4]
    if same:
        assert_array_equal(halves.cells_of(shifted_partition.points), np.arange(8))
        assert_array_equal(from_points(square(), at_a_vertex).points, np.arange(5))
        return
    with sentences.raises(InputError):
        halves.cells_of(shifted_partition.points)
    with sentences.raises(InputError):
        from_points(square(), at_a_vertex)


@pytest.mark.parametrize(
    "coarse", [make_uniform_partition(square(), 1 / 2), make_uniform_partition(square(), 1 / 3)]
)
def test_each_cell_of_a_refinement_lies_in_the_cell_found(coarse):
    """By the middles of the finer cells, which lie inside one cell each."""
    fine = common_refinement(
        [make_uniform_partition(square(), 1 / 3), make_uniform_partition(square(), 1 / 2)]
    )
    cell = coarse.cells_of(fine.points)
    middle = fine.points[:-1] + fine.lengths / 2
    assert np.all((coarse.points[cell] < middle) & (middle < coarse.points[cell + 1]))
    assert_allclose(np.bincount(cell, fine.lengths), coarse.lengths, rtol=1e-13)
