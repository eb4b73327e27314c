"""The matrix from edges against assembly element by element, on adapted meshes; some of its rows."""

from __future__ import annotations

import numpy as np
import pytest
from nested import assemble_by_elements, make_mesh_levels

from unilateral.fem.edge_matrix import assemble_by_edges, assemble_rows, edge_stiffness_and_areas
from unilateral.fem.form import H1
from unilateral.fem.p1 import lumped_mass
from unilateral.geometry.mesh import Mesh

MESHES = [
    ("square 1", "uniform", 0),
    ("gmsh", "uniform", 2),
    ("gmsh", "at random", 5),
    ("flat", "at random", 6),
    ("lshape 1", "at a node", 20),
]


def rounding(mesh: Mesh) -> float:
    """Of entries, relative to the largest one: that of coordinates against the least height of a triangle."""
    height = float((2 * mesh.areas / mesh.longest_edges).min())
    return 16 * float(np.spacing(np.abs(mesh.points).max())) / height


@pytest.mark.parametrize("mesh_key", MESHES)
def test_the_matrix_by_edges_is_that_by_elements(mesh_key: tuple[str, str, int]) -> None:
    """Every entry once, the diagonal first."""
    mesh = make_mesh_levels(*mesh_key).mesh
    (A, sums, mass) = assemble_by_edges(mesh.triangulation, mesh.points)
    expected = assemble_by_elements(mesh)
    assert abs(A - expected).max() < rounding(mesh) * abs(expected).max()
    assert np.array_equal(A.indices[A.indptr[:-1]], np.arange(mesh.n_nodes))
    assert A.nnz == mesh.n_nodes + 2 * len(mesh.triangulation.ends)
    assert np.allclose(A.sum(axis=1), expected.sum(axis=1), rtol=0, atol=1e-12 * abs(expected).max())
    assert np.allclose(mass, lumped_mass(mesh), rtol=1e-12)
    assert np.array_equal(sums, mass)


def test_a_moved_node_is_noticed() -> None:
    mesh = make_mesh_levels("gmsh", "at random", 5).mesh
    points = mesh.points.copy()
    points[np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)[0]] += 1e-8
    (A, *_) = assemble_by_edges(mesh.triangulation, points)
    expected = assemble_by_elements(mesh)
    assert abs(A - expected).max() > 10 * rounding(mesh) * abs(expected).max()


def test_elements_in_blocks_are_those_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = make_mesh_levels("gmsh", "at random", 5).mesh
    at_once = edge_stiffness_and_areas(mesh.points, mesh.triangulation.nodes)
    monkeypatch.setattr("unilateral.arrays.ROWS_PER_BLOCK", 7)
    for computed, expected in zip(
        edge_stiffness_and_areas(mesh.points, mesh.triangulation.nodes), at_once, strict=True
    ):
        assert np.array_equal(computed, expected)


@pytest.mark.parametrize("mesh_key", MESHES)
@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_some_rows_are_those_of_the_matrix(mesh_key: tuple[str, str, int], share: float) -> None:
    mesh = make_mesh_levels(*mesh_key).mesh
    rng = np.random.default_rng(4)
    count = max(1, int(share * mesh.n_nodes))
    chosen = rng.choice(mesh.n_nodes, count, replace=False).astype(np.int32)
    rows = assemble_rows(
        mesh.points, mesh.triangulation.nodes, chosen, mesh.n_nodes, H1, H1.clamped_nodes(mesh)
    )
    expected = assemble_by_elements(mesh)
    assert rows.shape == (count, mesh.n_nodes)
    assert abs(rows - expected[chosen]).max() < rounding(mesh) * abs(expected).max()
    if count > 1:
        assert abs(rows - expected[np.roll(chosen, 1)]).max() > 0.1
