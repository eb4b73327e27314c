"""The matrix from edges against assembly element by element, on adapted meshes; some of its rows."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from nested import assembled, at_random, graded, refined

from unilateral.fem.edge_matrix import elements, matrix, some_rows
from unilateral.fem.p1 import gradients, lumped_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

Array = np.ndarray
FLAT = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.3], [0.4, 0.25]]), "flat")
MESHES = {
    "one": lambda: structured(square(), 1),
    "uniform": lambda: refined(meshes.unstructured(named("lshape"), 0.6), 2).mesh,
    "at random": lambda: at_random(meshes.unstructured(named("lshape"), 0.6), 5, 1).mesh,
    "flat": lambda: at_random(meshes.from_arrays(FLAT, FLAT.vertices, [[0, 1, 2], [0, 2, 3]]), 6, 2).mesh,
    "at a corner": lambda: graded(structured(named("lshape"), 1), 2, 20).mesh,
}


@cache
def mesh_of(name: str) -> Mesh:
    return MESHES[name]()


def rounding(mesh: Mesh) -> float:
    """Of entries, relative to the largest one: that of coordinates against the least height of a triangle."""
    height = float((2 * mesh.areas / mesh.longest_edges).min())
    return 16 * float(np.spacing(np.abs(mesh.points).max())) / height


@pytest.mark.parametrize("name", MESHES)
def test_it_is_what_assembly_finds(name: str) -> None:
    """Every entry once, the diagonal first."""
    mesh = mesh_of(name)
    (A, mass), expected = matrix(mesh.triangulation, mesh.points), assembled(mesh)
    assert abs(A - expected).max() < rounding(mesh) * abs(expected).max()
    assert np.array_equal(A.indices[A.indptr[:-1]], np.arange(mesh.n_nodes))
    assert A.nnz == mesh.n_nodes + 2 * len(mesh.triangulation.ends)
    assert np.allclose(A.sum(axis=1), expected.sum(axis=1), rtol=0, atol=1e-12 * abs(expected).max())
    assert np.allclose(mass, lumped_mass(mesh), rtol=1e-12)


def test_a_moved_node_is_noticed() -> None:
    mesh = mesh_of("at random")
    points = mesh.points.copy()
    points[np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)[0]] += 1e-8
    (A, _), expected = matrix(mesh.triangulation, points), assembled(mesh)
    assert abs(A - expected).max() > 10 * rounding(mesh) * abs(expected).max()


@pytest.mark.parametrize("name", ["at random", "flat"])
def test_products_belong_to_the_opposite_edges(name: str) -> None:
    mesh = mesh_of(name)
    slopes, area, of = gradients(mesh), mesh.areas, elements(mesh.points, mesh.triangulation.nodes)
    assert np.array_equal(mesh.triangulation.nodes, mesh.triangles)
    K = area[:, None, None] * (slopes @ slopes.transpose(0, 2, 1))
    assert np.allclose(of.stiffness, K[:, [1, 2, 0], [2, 0, 1]], rtol=1e-9, atol=1e-12)
    assert np.allclose(of.area, area, rtol=1e-12)


def test_elements_in_blocks_are_those_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of("at random")
    at_once = elements(mesh.points, mesh.triangulation.nodes)
    monkeypatch.setattr("unilateral.arrays.BLOCK", 7)
    for found, expected in zip(elements(mesh.points, mesh.triangulation.nodes), at_once, strict=True):
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_some_rows_are_those_of_the_matrix(name: str, share: float) -> None:
    mesh, rng = mesh_of(name), np.random.default_rng(4)
    count = max(1, int(share * mesh.n_nodes))
    chosen = rng.choice(mesh.n_nodes, count, replace=False).astype(np.int32)
    nodes = mesh.triangulation.nodes
    found = some_rows(mesh.points, nodes, chosen, mesh.n_nodes)
    expected = assembled(mesh)
    assert found.shape == (count, mesh.n_nodes)
    assert abs(found - expected[chosen]).max() < rounding(mesh) * abs(expected).max()
    if count > 1:
        assert abs(found - expected[np.roll(chosen, 1)]).max() > 0.1
