"""Macro-elements: what is shared, and what each stage does; `test_condense` asks for A_3 and solutions."""

import numpy as np
import pytest

from unilateral.fem.condense import condense
from unilateral.fem.macro_elements import MacroElementFactors, perimeter_nodes
from unilateral.geometry import mesh as meshes
from unilateral.geometry import refinement
from unilateral.geometry.mesh import refine_uniformly
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.structured import make_structured_mesh


def shapes_of(mesh, times):
    """The numbers of shapes and parts of the stages inside coarse triangles."""
    stages = MacroElementFactors(refine_uniformly(mesh, times)).stages
    return [stage.inner.shape[:2] for stage in stages if stage.inner.shape[:2] != (1, 1)]


def test_congruent_triangles_share_one_elimination_on_each_level():
    """Eight triangles on the coarse mesh: 8 * 4^2, 8 * 4 and 8 parts of one shape, from m = 4 on."""
    assert shapes_of(make_structured_mesh(square(), 1 / 2), 4) == [(1, 128), (1, 32), (1, 8)]


def test_other_triangles_have_an_elimination_each():
    mesh = meshes.make_unstructured_mesh(find_polygon("lshape"), 1 / 2)
    t = len(mesh.triangles)
    assert shapes_of(mesh, 3) == [(t, 4), (t, 1)]


def test_lines_run_along_the_triangles_sides():
    """On every level: each node is an m-th of a side after the one before, and they turn left."""
    mesh = meshes.make_unstructured_mesh(square(), 1 / 2)
    fine = refine_uniformly(mesh, 3)
    for level, lines in enumerate(perimeter_nodes(mesh.triangulation, 3)):
        m = 2**level
        corners = fine.points[lines[:, ::m]]
        shares = np.arange(m)[:, None] / m
        sides = np.roll(corners, -1, axis=1) - corners
        expected = (corners[:, :, None] + shares * sides[:, :, None]).reshape(len(lines), -1, 2)
        np.testing.assert_allclose(fine.points[lines], expected, rtol=0, atol=1e-15)
        assert np.all(sides[:, 0, 0] * sides[:, 1, 1] > sides[:, 0, 1] * sides[:, 1, 0])


def test_the_middle_triangle_s_order_matters(monkeypatch):
    """With its corners one further it is no longer the whole one turned, and A_3 is wrong."""
    mesh = refine_uniformly(meshes.make_unstructured_mesh(square(), 1 / 2), 3)
    right = condense(mesh).A_3

    *outer_triangles, red = refinement.CHILD_TRIANGLES
    *outer, (nodes, edges) = red
    turned = tuple(np.roll(numbers, 1).tolist() for numbers in (nodes, edges))
    monkeypatch.setattr(refinement, "CHILD_TRIANGLES", (*outer_triangles, (*outer, turned)))
    assert np.abs(MacroElementFactors(mesh).A_3 - right).max() > 1e-3 * np.abs(right).max()


@pytest.mark.parametrize("times", [0, 1, 2, 3])
def test_macro_elements_are_for_meshes_that_were_refined_often(times):
    factors = condense(refine_uniformly(make_structured_mesh(square(), 1 / 2), times)).factors
    assert isinstance(factors, MacroElementFactors) == (times >= 3)
