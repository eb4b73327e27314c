"""The boundary nodes of reference meshes: their gradings, and where they would be too close."""

import numpy as np
import pytest
import sentences
from boundary_norms import CELLS, agree_to_half_percent, one_on_a_square
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, square
from unilateral.norms import grading
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.grading import grade_boundary_nodes
from unilateral.norms.oscillation import distance_to_other_sides
from unilateral.problems import case as cases


def test_the_edges_of_a_cell_are_chebyshev_s():
    """(1 - cos(i pi / n)) / 2: the first edge of 8 is 0.038 of the cell; 1, 2 and 4 cells' edges by hand."""
    small = Polygon(square().vertices / 8, "small square")
    cell = partitions.make_uniform_partition(small, 1.0)
    assert_allclose(grade_boundary_nodes(cell, (), 1), np.array([0, 1, 2, 3]) / 8)
    assert_allclose(grade_boundary_nodes(cell, (), 2)[:3], np.array([0, 0.5, 1]) / 8)
    assert_allclose(
        grade_boundary_nodes(cell, (), 4)[:4], np.array([0, 0.5 - 8**-0.5, 0.5, 0.5 + 8**-0.5]) / 8
    )


@pytest.mark.parametrize("name", CELLS)
@pytest.mark.parametrize("position", [0.0, 1.0, 0.3, 0.3 + 1e-3, 1.9999])
def test_the_edges_at_a_singular_point_are_halved_from_both_sides(name, position):
    """Also at a vertex, at 0 = perimeter, near a cell's end, or in a short part of a cell."""
    cells = CELLS[name]
    perimeter = cells.polygon.perimeter
    plain = grade_boundary_nodes(cells, (), 8)
    graded = grade_boundary_nodes(cells, [position], 8)
    assert np.isin(cells.points[:-1], graded).all()
    assert np.abs(graded - position).min() == 0
    ends_and_position = np.union1d(plain[np.isin(plain, cells.points)], [position])
    for sign in (-1, 1):
        component = np.sort(sign * (ends_and_position - position) % perimeter)[1]
        away = np.sort(sign * (graded - position) % perimeter)[1 : grading.HALVINGS_AT_SINGULARITY + 2]
        assert_allclose(away[1:] / away[:-1], 2, rtol=1e-6)  # differences of arc lengths
        assert away[-1] <= component * (1 + 1e-12)
    assert np.diff(graded).max() <= cells.H / 4  # the longest of Chebyshev's 8 is sin(pi / 8) / 2 of the cell


@pytest.mark.parametrize("lengths", [[0.3, 0.6, 0.1], [0.001, 0.699, 0.3], [0.5, 0.01, 0.49]])
def test_the_edges_beside_a_shorter_cell_are_no_more_than_twice_its_own(lengths):
    """From the longer side they are halved as often as that takes, and the shorter cell is left as it is."""
    points = np.concatenate([[0], np.cumsum(lengths)[:-1], [1, 2, 3, 4]])
    cells = partitions.from_points(square(), points)
    s = np.append(grade_boundary_nodes(cells, (), 4), 4.0)
    edges = np.diff(s)
    index = np.searchsorted(s, cells.points[:-1])
    ratio = edges[index] / edges[index - 1]
    assert np.all((ratio < 2 * (1 + 1e-9)) & (ratio > 0.5 * (1 - 1e-9)))
    shortest = int(cells.lengths.argmin())
    assert np.sum((s >= points[shortest]) & (s < points[shortest + 1])) == 4


QUADRILATERAL = Polygon(np.array([[0.1, 0.2], [1.3, 0.5], [1.1, 1.7], [-0.2, 1.1]]), "quadrilateral")


@pytest.mark.parametrize("position", [0.25, np.nextafter(0.25, 1), 0.25 - 1e-12, 0.25 + 1e-9, 0.25 - 1e-7])
def test_a_singular_point_beside_a_cell_s_end_is_graded_to_that_end(position):
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    assert_array_equal(grade_boundary_nodes(cells, [position], 8), grade_boundary_nodes(cells, [0.25], 8))


@pytest.mark.parametrize("n", [3, 6, 12])
def test_cells_that_end_at_a_singular_point_up_to_round_off(n):
    """A third of a side, once by its arc length and once as the end of a cell: on this side an ulp apart."""
    case = cases.load_solution("thirds", QUADRILATERAL, 1)
    cells = partitions.Partition(QUADRILATERAL, QUADRILATERAL.divided(np.full(4, n)))
    end = cells.points[n + n // 3]
    assert abs(QUADRILATERAL.arc_length(1, 1 / 3) - end) in (0, np.spacing(end))
    bounds = build_dual_norm(cells, [case]).bound_error(case, np.zeros((1, 4 * n)))
    assert 0 < bounds.lower[0] <= bounds.upper[0] <= 1.05 * bounds.lower[0]  # the limit for errors


@pytest.mark.parametrize("length", [1e-3, 1e-5, 1e-6, 1e-7])
def test_the_gap_stays_small_beside_short_cells(length):
    """No edge is shorter than SHORTEST, and the gap for P0 functions stays below 0.5 %."""
    cells = partitions.from_points(square(), [0, 0.5, 0.5 + length, 1, 2, 3, 4])
    norm = build_dual_norm(cells)
    assert np.diff(norm.spaces.mesh.s).min() >= grading.MIN_EDGE_DIAMETERS * square().diameter
    bracket = norm.bound_p0(np.random.default_rng(0).standard_normal((3, cells.n_cells)))
    assert agree_to_half_percent(bracket)


def test_shorter_cells_are_refused():
    cells = partitions.from_points(square(), [0, 0.5, 0.5 + 5e-8, 1, 2, 3, 4])
    with sentences.raises(InputError):
        grade_boundary_nodes(cells, [], 8)


def scaled_square(L):
    return Polygon(L * square().vertices, "scaled square")


@pytest.mark.parametrize("L", [0.01, 10, 100])
def test_the_gap_stays_small_on_small_and_large_squares(L):
    """With edges of LONGEST at most; mu = 1 against its closed form."""
    norm = build_dual_norm(partitions.make_uniform_partition(scaled_square(L), L / 8))
    bracket = norm.bound_p0(np.vstack([np.ones(32), (-1.0) ** np.arange(32)]))
    assert agree_to_half_percent(bracket)
    assert bracket.lower[0] <= one_on_a_square(L) * (1 + 1e-9)
    assert one_on_a_square(L) <= bracket.upper[0] * (1 + 1e-9)


def test_a_tiny_square_is_refused():
    with sentences.raises(InputError):
        build_dual_norm(partitions.make_uniform_partition(scaled_square(1e-4), 1e-4 / 8))


def test_without_the_longest_edge_the_gap_on_a_large_square_is_missed(monkeypatch):
    """Control."""
    monkeypatch.setattr(grading, "MAX_REFERENCE_EDGE", np.inf)
    bracket = build_dual_norm(partitions.make_uniform_partition(scaled_square(100), 12.5)).bound_p0(
        np.ones((1, 32))
    )
    assert bracket.upper[0] > 1.005 * bracket.lower[0]


@pytest.mark.parametrize("degrees", [1, 10, 30])
def test_edges_near_shorter_ones_on_another_side_are_graded_to_them(degrees):
    """At a wedge's sides that are nearer than their cells are long; a short cell faces long ones."""
    cells = wedge(degrees)
    s = np.append(grade_boundary_nodes(cells, (), 8), cells.polygon.perimeter)
    lengths = np.diff(s)
    middle = 0.5 * (s[1:] + s[:-1])
    side = np.searchsorted(cells.polygon.starts, middle, side="right") - 1
    points = cells.polygon.at(side, middle - cells.polygon.starts[side])
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    allowed = np.where(side[:, None] == side, np.inf, distance + 2 * lengths).min(axis=1)
    free = distance_to_other_sides(cells.polygon, points, side)
    assert np.all(lengths <= np.maximum(allowed, free) * (1 + 1e-9))
    bracket = build_dual_norm(cells).bound_p0(np.eye(cells.n_cells))
    assert agree_to_half_percent(bracket)


def test_without_grading_to_other_sides_the_gap_in_a_wedge_is_missed(monkeypatch):
    """Control."""
    monkeypatch.setattr(grading, "_halve_near_shorter_edges", lambda _, s: s)
    cells = wedge(1)
    bracket = build_dual_norm(cells).bound_p0(np.eye(cells.n_cells))
    assert np.any(bracket.upper > 1.005 * bracket.lower)


def wedge(degrees):
    polygon = Polygon(np.array([[0, 0], [1, 0], [1, np.tan(np.radians(degrees))]]), "wedge")
    points = partitions.make_uniform_partition(polygon, 1 / 4).points
    return partitions.from_points(polygon, np.sort(np.append(points, points[2] + 1e-4)))
