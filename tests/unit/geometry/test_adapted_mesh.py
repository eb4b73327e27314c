"""The cells that follow local refinement against their rule, and the marking of triangles."""

import numpy as np
import pytest
import sentences
from nested import coarse

from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import (
    FIRST_EDGE_LENGTH,
    MAX_CELL_EDGE_RATIO,
    mark_triangles,
    refine_and_balance,
    start_adapted_mesh,
)
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

FIRST = ["lshape 2", "slanted"]


def adapt_at_random(name):
    """A third of the triangles chosen again and again, in an ever smaller part of the domain."""
    first = coarse(name)
    rng = np.random.default_rng(2)
    adapted_mesh = start_adapted_mesh(first)
    for k in range(6):
        centre = adapted_mesh.mesh.points[adapted_mesh.mesh.triangles].mean(axis=1)
        near = np.flatnonzero(np.hypot(*(centre - first.points[first.boundary[3]]).T) < 2.0**-k)
        adapted_mesh = refine_and_balance(adapted_mesh, rng.choice(near, len(near) // 3 + 1))
    return adapted_mesh


def adapt_at_corner(times):
    """Of the unit square, its triangle at a vertex halved so often."""
    adapted_mesh = start_adapted_mesh(coarse("square 2"))
    for _ in range(times):
        corner = np.flatnonzero(
            np.hypot(*adapted_mesh.mesh.points[adapted_mesh.mesh.triangles].min(axis=1).T) == 0
        )
        adapted_mesh = refine_and_balance(adapted_mesh, corner)
    return adapted_mesh


def test_arc_lengths_are_exact():
    """On the unit square arc lengths and places are the same dyadic numbers, 30 halvings deep."""
    mesh = adapt_at_corner(30)
    assert np.array_equal(mesh.mesh.s, mesh.positions / FIRST_EDGE_LENGTH / 2)
    assert np.diff(mesh.mesh.s).min() == 2.0**-31
    assert np.isin(make_structured_mesh(square(), 1 / 2).s, mesh.mesh.s).all()


@pytest.mark.parametrize("name", [*FIRST, "corner"])
def test_every_edge_is_at_most_half_and_at_least_a_quarter_of_its_cell(name):
    """The rule of stability, in arc lengths; and that no cell is longer than SHORTEST times its edges."""
    mesh = adapt_at_corner(12) if name == "corner" else adapt_at_random(name)
    edges = np.diff(mesh.mesh.s)
    cells = mesh.partition
    assert np.ptp(np.log2(edges)) > 3
    assert np.isin(cells.points, mesh.mesh.s).all()
    length = cells.lengths[np.searchsorted(cells.points, mesh.mesh.s[:-1], side="right") - 1]
    assert np.all(edges <= 0.5 * length * (1 + 1e-12))
    assert np.all(length <= MAX_CELL_EDGE_RATIO * edges * (1 + 1e-12))
    np.testing.assert_array_equal(
        mesh.cell, np.searchsorted(cells.points, mesh.mesh.s[:-1], side="right") - 1
    )
    assert cells.n_cells >= len(edges) / MAX_CELL_EDGE_RATIO


def test_edges_in_geometric_progression_are_not_one_cell():
    """Parents are nested: the bottom, halved 12 times at its start, has a cell for every second length."""
    mesh = adapt_at_corner(12)
    bottom = np.diff(mesh.mesh.s)[mesh.mesh.side == 0]
    assert bottom.min() == 2.0**-13
    assert mesh.partition.lengths[0] <= MAX_CELL_EDGE_RATIO * 2.0**-13
    assert np.count_nonzero(mesh.partition.side == 0) >= 12 / 2
    assert mesh.unbalanced_triangles.size == 0


def test_the_first_cells_have_two_edges():
    adapted_mesh = start_adapted_mesh(coarse("lshape 2"))
    np.testing.assert_array_equal(
        adapted_mesh.partition.points, partitions.make_uniform_partition(find_polygon("lshape"), 1).points
    )


def test_chosen_triangles_are_cut_in_four_whatever_else_balance_needs():
    adapted_mesh = start_adapted_mesh(coarse("slanted"))
    chosen = np.arange(0, len(adapted_mesh.mesh.triangles), 5)
    finer = refine_and_balance(adapted_mesh, chosen)
    count = np.bincount(finer.mesh.steps[0].parent, minlength=len(adapted_mesh.mesh.triangles))
    assert np.all(count[chosen] == 4)
    assert finer.unbalanced_triangles.size == 0
    assert refine_and_balance(finer, np.zeros(0, dtype=int)) is finer


def test_the_fewest_triangles_with_half_of_the_sum_are_marked():
    mesh = make_structured_mesh(square(), 1 / 4)
    shares = np.random.default_rng(0).random(len(mesh.triangles))
    marked = mark_triangles(mesh, shares)
    assert shares[marked].sum() >= 0.5 * shares.sum() > shares[marked].sum() - shares[marked].min()
    assert shares[marked].min() >= np.delete(shares, marked).max()


def test_triangles_as_short_as_rounding_are_not_marked():
    """Of the square moved by 1e9, whose coordinates are rounded by 1e-7: from 0.1 on."""
    far = Polygon(square().vertices + 1e9, "far")
    fine = make_structured_mesh(square(), 1 / 16)
    mesh = meshes.Mesh(far, fine.points + 1e9, fine.triangles, fine.boundary, fine.s)
    shares = np.ones(len(mesh.triangles))
    assert len(mark_triangles(fine, shares)) == len(shares) / 2
    with sentences.raises(InputError):
        mark_triangles(mesh, shares)
