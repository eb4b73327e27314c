"""The coupling against the trapezoidal rule between all points, and its row and column sums."""

import numpy as np
import pytest
import sentences

from unilateral.errors import InputError
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

TRIANGLE = Polygon(np.array([[0.0, 0.0], [3.0, 0.1], [0.4, 2.0]]), "triangle")


def nearly_coinciding(distance):
    """Points of the square's uniform partition of size 1/4, those inside the sides moved by `distance`."""
    points = np.arange(17) / 4
    inside = np.arange(17) % 4 != 0
    return partitions.from_points(square(), np.where(inside, points + distance, points))


def uneven():
    """Cells from a millionth of a side to a whole side."""
    return partitions.from_points(square(), [0, 1e-6, 0.1, 0.100001, 1, 2, 2.5, 3, 4])


CASES = {
    "two edges a cell": (square(), 1 / 8, partitions.make_uniform_partition(square(), 1 / 4)),
    "same points": (square(), 1 / 8, partitions.make_uniform_partition(square(), 1 / 8)),
    "two cells an edge": (square(), 1 / 4, partitions.make_uniform_partition(square(), 1 / 8)),
    "thirds": (square(), 1 / 8, partitions.make_uniform_partition(square(), 1 / 3)),
    "shifted": (
        find_polygon("lshape"),
        1 / 8,
        partitions.make_shifted_partition(find_polygon("lshape"), 1 / 4, 0.3),
    ),
    "one cell a side": (square(), 1 / 64, partitions.make_uniform_partition(square(), 1.0)),
    "many cells an edge": (square(), 1.0, partitions.make_uniform_partition(square(), 1 / 64)),
    "uneven": (square(), 1 / 8, uneven()),
    "gmsh": (TRIANGLE, 0.3, partitions.make_uniform_partition(TRIANGLE, 0.37)),
    **{
        f"moved by {distance:g}": (square(), 1 / 4, nearly_coinciding(distance))
        for sign in (1, -1)
        for distance in sign * np.array([1e-15, 1e-13, 1e-10, 1e-8])
    },
}


@pytest.fixture(params=CASES)
def pair(request):
    polygon, h, partition = CASES[request.param]
    make = meshes.make_unstructured_mesh if polygon is TRIANGLE else make_structured_mesh
    return make(polygon, h), partition


def sums_are_right(B, mesh, partition):
    """Hats sum to one: rows to H_i; a hat's integral: columns to the mean of its two edges."""
    edges = np.diff(mesh.s)
    rounding = 1e-14 * mesh.polygon.perimeter
    rows = np.abs(B.sum(axis=1) - partition.lengths).max()
    columns = np.abs(B.sum(axis=0) - 0.5 * (edges + np.roll(edges, 1))).max()
    return bool(max(rows, columns) <= rounding)


def test_row_and_column_sums_are_lengths_of_cells_and_integrals_of_hats(pair):
    """Control: the check of the sums notices a sign error and a shift."""
    B = coupling(*pair).toarray()
    assert sums_are_right(B, *pair)
    assert B.min() >= -1e-15
    assert not sums_are_right(-B, *pair)
    assert not sums_are_right(B + 1e-9, *pair)


def test_products_equal_the_trapezoidal_rule(pair):
    """<1_cell, v> for random nodal values, between the nodes and the cells' ends, where v is linear."""
    mesh, partition = pair
    values = np.random.default_rng(2).standard_normal(len(mesh.boundary))
    s = np.union1d(mesh.s, partition.points)
    v = np.interp(s, mesh.s, np.append(values, values[0]))
    cell = np.searchsorted(partition.points, 0.5 * (s[1:] + s[:-1])) - 1
    expected = np.bincount(cell, 0.5 * (v[1:] + v[:-1]) * np.diff(s), partition.n_cells)
    np.testing.assert_allclose(coupling(mesh, partition) @ values, expected, rtol=0, atol=1e-13)


def test_nearly_coinciding_points_change_the_coupling_by_their_distance():
    mesh = make_structured_mesh(square(), 1 / 4)
    exact = coupling(mesh, partitions.make_uniform_partition(square(), 1 / 4)).toarray()
    for distance in (1e-15, -1e-15, 1e-12, -1e-12, 1e-8, -1e-8):
        shifted_coupling = coupling(mesh, nearly_coinciding(distance)).toarray()
        assert np.abs(shifted_coupling - exact).max() <= 1.01 * abs(distance) + 1e-15


@pytest.mark.parametrize("second", [find_polygon("lshape"), Polygon(2 * square().vertices)])
def test_another_polygon_is_refused(second):
    with sentences.raises(InputError):
        coupling(make_structured_mesh(square(), 1 / 2), partitions.make_uniform_partition(second, 1 / 2))


@pytest.mark.parametrize(
    ("sides", "exact"),
    [(None, [4, 2, 5 / 3, 5 / 3]), ([0, 1], [2, 3 / 2, 4 / 3, 1 / 3])],
    ids=["all", "some"],
)
def test_boundary_mass_integrates_squares_of_linear_functions(sides, exact):
    """1, x, x^2 and y^2 on all sides of the square, by hand, or on two: hats of the others have none."""
    mesh = make_structured_mesh(square(), 1 / 8)
    M = boundary_mass(mesh, None if sides is None else np.isin(mesh.side, sides))
    values = np.ones(len(mesh.boundary))
    (x, y) = mesh.points[mesh.boundary].T
    assert [v @ (M @ w) for v, w in ((values, values), (values, x), (x, x), (y, y))] == pytest.approx(
        exact, rel=1e-14
    )
    assert abs(M - M.T).max() == 0
    away = (x < 1) & (y > 0)
    assert away.sum() == 15
    assert (abs(M[away]).max() == 0) == (sides is not None)
