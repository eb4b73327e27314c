"""Macro-elements: what is shared, and what each stage does; `test_condense` asks for A_3 and solutions."""

import numpy as np
import pytest

from unilateral.fem import recursive
from unilateral.fem.condense import condense, matrix
from unilateral.fem.recursive import Recursive, boundary_lines, by_shape, element_matrices
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import named, square
from unilateral.geometry.structured import structured


def refined(mesh, times):
    for _ in range(times):
        mesh = meshes.refine(mesh)
    return mesh


def shapes_of(mesh, times):
    """The numbers of shapes and parts of the stages inside coarse triangles."""
    stages = Recursive(refined(mesh, times)).stages
    return [stage.inner.shape[:2] for stage in stages if stage.inner.shape[:2] != (1, 1)]


def test_congruent_triangles_share_one_elimination_on_each_level():
    """Eight triangles on the coarse mesh: 8 * 4^2, 8 * 4 and 8 parts of one shape, from m = 4 on."""
    assert shapes_of(structured(square(), 1 / 2), 4) == [(1, 128), (1, 32), (1, 8)]


def test_other_triangles_have_an_elimination_each():
    mesh = meshes.unstructured(named("lshape"), 1 / 2)
    t = len(mesh.triangles)
    assert shapes_of(mesh, 3) == [(t, 4), (t, 1)]


def test_a_triangle_of_another_size_is_no_congruent_one():
    points = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1.0]])
    alike, other = np.array([[0, 1, 2], [4, 2, 1]]), np.array([[0, 1, 2], [0, 3, 2]])
    assert by_shape(points, alike).shape == (1, 2, 3)
    assert by_shape(points, other).shape == (2, 1, 3)


def test_alike_are_triangles_in_any_order_of_their_corners():
    """The matrices of what is called one shape are the same."""
    mesh = structured(named("lshape"), 1 / 2)
    turned = np.array([np.roll(corners, k) for k, corners in enumerate(mesh.triangles)])
    found = by_shape(mesh.points, turned)
    assert len(found) == 1
    matrices = element_matrices(mesh.points[found[0]])
    np.testing.assert_allclose(matrices, np.broadcast_to(matrices[0], matrices.shape), atol=1e-14)


def test_lines_run_along_the_triangles_sides():
    """On every level: each node is an m-th of a side after the one before, and they turn left."""
    mesh = meshes.unstructured(square(), 1 / 2)
    fine = refined(mesh, 3)
    for level, line in enumerate(boundary_lines(mesh.triangles[:, None], mesh.n_nodes, 3)):
        m, lines = 2**level, line.reshape(-1, line.shape[-1])
        corners = fine.points[lines[:, ::m]]
        shares = np.arange(m)[:, None] / m
        sides = np.roll(corners, -1, axis=1) - corners
        expected = (corners[:, :, None] + shares * sides[:, :, None]).reshape(len(lines), -1, 2)
        np.testing.assert_allclose(fine.points[lines], expected, atol=1e-15)
        assert np.all(sides[:, 0, 0] * sides[:, 1, 1] > sides[:, 0, 1] * sides[:, 1, 0])


def test_an_elimination_solves_up_to_rounding():
    mesh = refined(meshes.unstructured(square(), 1 / 3), 4)
    rhs = np.random.default_rng(1).standard_normal((mesh.n_nodes, 3))
    x = Recursive(mesh).solve(rhs)
    assert np.abs(matrix(mesh) @ x - rhs).max() < 1e-11 * np.abs(x).max()


def test_the_middle_triangle_s_order_matters(monkeypatch):
    """With its corners one further it is no longer the whole one turned, and A_3 is wrong."""
    mesh = refined(meshes.unstructured(square(), 1 / 2), 3)
    right = condense(mesh).A_3

    def exchanged(triangles, n):
        children, edges = meshes.split(triangles, n)
        children[3::4] = np.roll(children[3::4], 1, axis=1)
        return children, edges

    monkeypatch.setattr(recursive, "split", exchanged)
    assert np.abs(Recursive(mesh).A_3 - right).max() > 1e-3 * np.abs(right).max()


@pytest.mark.parametrize("times", [0, 1, 2, 3])
def test_macro_elements_are_for_meshes_that_were_refined_often(times):
    factors = condense(refined(structured(square(), 1 / 2), times)).factors
    assert isinstance(factors, Recursive) == (times >= 3)
