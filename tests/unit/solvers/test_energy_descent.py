"""Approximate inverses of the matrix of a form, and descents of the energy on P2."""

import numpy as np
import pytest

from unilateral.fem import linear_systems
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import lumped_mass
from unilateral.fem.p2 import quadratic_space
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import find_polygon
from unilateral.solvers.energy_descent import build_hat_matrix, start_descent

FORMS = (H1, Form(2.0, 0.0, clamped=(0,)), Form(2.0, 300.0))


def make_mesh(kind):
    """A mesh of algebraic levels, one of uniform levels, or one that was refined in a part."""
    mesh = meshes.make_unstructured_mesh(
        find_polygon("lshape"), 0.8 if kind in ("uniform", "adapted") else 0.3
    )
    if kind in ("few", "algebraic"):
        return mesh
    for step in range(2):
        near = np.hypot(*mesh.points[mesh.triangles].mean(axis=1).T) < 0.5**step
        mesh = (
            meshes.refine_uniformly(mesh)
            if kind == "uniform"
            else meshes.refine_triangles(mesh, np.flatnonzero(near))
        )
    return mesh


def assemble_dense(apply, n):
    """The matrix of a linear map of vectors (n,)."""
    return np.column_stack([apply(column) for column in np.eye(n)])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["algebraic", "uniform", "adapted"])
def test_a_cycle_is_symmetric_and_near_the_inverse(kind, form, monkeypatch):
    """On functions that are 0 at random nodes of the boundary, a cycle takes half of every error and more.

    So the eigenvalues of its product with A are between 1/2 and 1. Control: the diagonal takes less.
    """
    monkeypatch.setattr(linear_systems, "MAX_FACTORISED_UNKNOWNS", 30)
    mesh = make_mesh(kind)
    hats = build_hat_matrix(mesh, form)
    assert (hats.hierarchy is None) == (kind == "algebraic")
    is_fixed = form.clamped_nodes(mesh)
    is_fixed[mesh.boundary[np.random.default_rng(0).random(len(mesh.boundary)) < 0.5]] = True
    inverse = assemble_dense(hats.approximate_inverse(is_fixed), mesh.n_nodes)
    assert np.abs(inverse - inverse.T).max() < 1e-10 * np.abs(inverse).max()
    assert np.all(inverse[is_fixed] == 0)
    free = ~is_fixed
    A = hats.A.toarray()[np.ix_(free, free)]
    values = np.linalg.eigvals(inverse[np.ix_(free, free)] @ A).real
    assert values.min() > 0.5
    assert values.max() < 1 + 1e-10
    if not form.c:
        scaled = A / np.sqrt(np.outer(A.diagonal(), A.diagonal()))
        assert np.linalg.eigvalsh(scaled).min() < 0.25 * np.linalg.eigvalsh(scaled).max()


@pytest.mark.parametrize("kind", ["algebraic", "uniform", "adapted"])
def test_large_systems_are_solved_up_to_what_is_asked_for(kind, monkeypatch):
    """As if 30 unknowns were many: sum r_i^2 / m_i is at most that, and no step is made below it."""
    monkeypatch.setattr(linear_systems, "MAX_FACTORISED_UNKNOWNS", 30)
    mesh = make_mesh(kind)
    hats = build_hat_matrix(mesh, H1)
    mass = lumped_mass(mesh)
    load = np.random.default_rng(1).standard_normal(mesh.n_nodes)
    begin = float(load @ (load / mass))
    for component in (1e-2, 1e-6, 1e-12):
        remaining = load - hats.A @ hats.solve(load, mass, component * begin)
        assert 0 < float(remaining @ (remaining / mass)) <= component * begin * (1 + 1e-6)
    assert not hats.solve(load, mass, begin).any()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["few", "algebraic", "uniform"])
def test_a_descent_ends_at_the_least_energy_among_the_functions(kind, form, monkeypatch):
    """Against a solve with the whole matrix on a basis; gains add up to the decrease of v . A v - 2 b . v."""
    if kind != "few":
        monkeypatch.setattr(linear_systems, "MAX_FACTORISED_UNKNOWNS", 30)
    mesh = make_mesh(kind)
    spaces = quadratic_space(mesh)
    rng = np.random.default_rng(2)
    contact = rng.random(len(spaces.boundary_unknowns)) < 0.5
    contact[np.tile(form.clamped_edges(mesh), 2)] = True
    contact[np.flatnonzero(form.clamped_nodes(mesh)[mesh.boundary])] = True
    functions = spaces.vanishing_functions(contact)
    quadratic_form = spaces.quadratic_form(form)
    load = rng.standard_normal(spaces.size)
    descent = start_descent(spaces, quadratic_form, build_hat_matrix(mesh, form), load.copy(), functions)
    gain = sum(descent.step() for _ in range(60))

    basis = np.array([spaces.subtract_hats(unit) for unit in np.eye(spaces.size)[~functions.is_fixed]])
    A_basis = np.array([quadratic_form.apply(function) for function in basis])
    best = np.linalg.solve(A_basis @ basis.T, basis @ load) @ basis
    assert np.abs(descent.x - best).max() < 1e-8 * np.abs(best).max()
    assert gain == pytest.approx(load @ best, rel=1e-10)
