"""Large meshes on given sizes have levels for multigrid, whatever number 1/h is; by hand."""

import numpy as np
import pytest

from unilateral.discrete.choice import COARSE_MESH_UNKNOWNS
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solution.sizes import make_mesh_and_partition
from unilateral.solvers.stop import Stop


def edges_in_cells(mesh, partition):
    """The numbers of boundary edges between the ends of each cell, all of which have to be nodes."""
    nodes = np.searchsorted(mesh.s, partition.points)
    np.testing.assert_array_equal(mesh.s[nodes], partition.points)
    return np.diff(nodes)


@pytest.mark.parametrize("polygon", ["square", "lshape"])
@pytest.mark.parametrize("n", [142, 145, 202, 211, 255, 257])
def test_a_large_mesh_of_any_size_is_refined_from_a_coarse_one(polygon, n):
    """h and H are at most as asked for. By less than a cell of the coarse mesh is a unit rounded up.

    Its cell is halved as often as `choose_halvings` says, until COARSE_MESH_UNKNOWNS are left.
    """
    mesh, partition = make_mesh_and_partition(find_polygon(polygon), 1 / n, 2 / n, "structured", Stop())
    assert mesh.h <= 1 / n * (1 + 1e-12)
    assert 2 / n * (1 + 1e-12) >= partition.H
    np.testing.assert_array_equal(edges_in_cells(mesh, partition), 2)
    assert mesh.coarse is not None
    assert mesh.coarse.n_nodes <= COARSE_MESH_UNKNOWNS
    halvings = np.ceil(np.log(n**2 * find_polygon(polygon).area / COARSE_MESH_UNKNOWNS) / np.log(4))
    assert 1 / mesh.h < n + 2 * 2**halvings


def test_the_size_itself_may_have_no_coarse_mesh():
    """Control: 211 is a prime number, and 2/211 divides no unit."""
    mesh = make_structured_mesh(find_polygon("square"), 1 / 211)
    assert mesh.coarse is None
    with pytest.raises(AssertionError):
        edges_in_cells(mesh, make_uniform_partition(mesh.polygon, 2 / 211))


@pytest.mark.parametrize(("h", "H"), [(1 / 141, 2 / 141), (1 / 211, 1 / 211)])
def test_sizes_are_taken_as_they_are_where_multigrid_does_not_pay_or_cannot_work(h, H):
    """Below MIN_MULTIGRID_UNKNOWNS, for 141^2 = 19 881; and with cells of one edge."""
    mesh, partition = make_mesh_and_partition(find_polygon("square"), h, H, "structured", Stop())
    assert mesh.h == pytest.approx(h, rel=1e-12)
    assert partition.n_cells == 4 * np.ceil(1 / H - 1e-9)


@pytest.mark.parametrize("ratio", [2.5, 3])
def test_cells_have_whole_numbers_of_edges(ratio):
    """Three edges in each, for two would be longer than h."""
    mesh, partition = make_mesh_and_partition(
        find_polygon("square"), 1 / 150, ratio / 150, "structured", Stop()
    )
    np.testing.assert_array_equal(edges_in_cells(mesh, partition), 3)
    assert mesh.h <= 1 / 150
