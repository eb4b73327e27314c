"""Linear systems: gradients that rounding has spoilt, orders without METIS, and factors that moved."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from unilateral.fem import linear_systems
from unilateral.fem.condense import condense, form_matrix
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh

MESH = make_structured_mesh(square(), 1 / 8)
A = form_matrix(MESH)
LOAD = np.random.default_rng(1).standard_normal(MESH.n_nodes)


def test_a_step_whose_curvature_is_hidden_is_none():
    """Where p . A p is not above 0."""
    run = linear_systems.ConjugateGradients(np.negative, np.ones(2), np.copy)
    assert (run.step(), run.rz) == (0.0, 0.0)
    assert run.x.tolist() == [0, 0]


def test_without_metis_the_interior_has_another_order_and_the_same_solution(monkeypatch):
    """The boundary is last in both, so A_3 is the same matrix."""
    expected = condense(MESH)
    monkeypatch.setattr(linear_systems, "pymetis", None)
    order = linear_systems.elimination_order(A, MESH.boundary)
    assert sorted(order) == list(range(MESH.n_nodes))
    assert np.array_equal(order[-len(MESH.boundary) :], MESH.boundary)
    solution = linear_systems.factorise_by_dissection(A, MESH.boundary).solve(LOAD)
    assert np.abs(A @ solution - LOAD).max() < 1e-12
    assert np.abs(condense(MESH).A_3 - expected.A_3).max() < 1e-12


def test_a_matrix_without_couplings_inside_is_in_its_own_order():
    """One inner node of four triangles, which no other inner node is next to."""
    mesh = make_structured_mesh(square(), 1 / 2)
    order = linear_systems.elimination_order(form_matrix(mesh), mesh.boundary)
    assert np.array_equal(order[1:], mesh.boundary)


@pytest.mark.parametrize("shifted", ["columns", "rows"])
def test_a_schur_complement_of_other_unknowns_is_refused(shifted):
    """If the last two unknowns were exchanged, or rows for pivots, the last block would be another one."""
    lu = linear_systems.factorise(A, linear_systems.elimination_order(A, MESH.boundary))
    size = len(MESH.boundary)
    R = linear_systems.schur_factor(lu, size)
    assert np.abs(R.T @ R - condense(MESH).A_3).max() < 1e-12
    second = -2 if shifted == "columns" else 0
    swapped = lu.perm_c.copy()
    swapped[[-1, second]] = swapped[[second, -1]]
    perm_c = swapped if shifted == "columns" else lu.perm_c
    with pytest.raises(RuntimeError, match="moved the boundary unknowns"):
        linear_systems.schur_factor(
            SimpleNamespace(shape=lu.shape, U=lu.U, perm_c=perm_c, perm_r=swapped), size
        )


def test_products_with_exchanged_rows_are_refused(monkeypatch):
    F = sp.csc_array(np.eye(MESH.n_nodes)[:, :3])
    inverse_products = linear_systems.OrderedMatrix(A, linear_systems.elimination_order(A)).inverse_products(
        F
    )
    assert np.abs(inverse_products - np.linalg.inv(A.toarray())[:3, :3]).max() < 1e-12
    shifted_stub = SimpleNamespace(perm_r=np.array([1, 0]), perm_c=np.array([0, 1]))
    monkeypatch.setattr(linear_systems, "factorise", lambda *_: shifted_stub)
    with pytest.raises(RuntimeError, match="exchanged rows of a symmetric matrix"):
        linear_systems.half_solve(A, F, np.arange(MESH.n_nodes))
