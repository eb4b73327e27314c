"""P1 matrices against scikit-fem's, loads against polynomials integrated by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from skfem.models.poisson import laplace, mass

from unilateral.fem.p1 import gradients, h1_load, load, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import named, square
from unilateral.geometry.structured import structured


def perturbed(mesh: meshes.Mesh) -> meshes.Mesh:
    """The mesh with its interior nodes moved by up to a fifth of h."""
    points = mesh.points.copy()
    interior = np.delete(np.arange(len(points)), mesh.boundary)
    points[interior] += np.random.default_rng(1).uniform(-0.2, 0.2, (len(interior), 2)) * mesh.h
    return meshes.Mesh(mesh.polygon, points, mesh.triangles, mesh.boundary, mesh.s)


MESHES = {
    "structured": lambda: structured(square(), 1 / 8),
    "perturbed": lambda: perturbed(structured(square(), 1 / 8)),
    "gmsh": lambda: meshes.unstructured(named("lshape"), 1 / 4),
    "refined": lambda: meshes.refine(perturbed(structured(named("lshape"), 1 / 4))),
}


@pytest.fixture(params=MESHES)
def mesh(request: pytest.FixtureRequest) -> meshes.Mesh:
    return MESHES[request.param]()


def difference(ours: sp.csr_array, theirs: sp.csr_array) -> float:
    """The largest entry of the difference, relative to the largest entry."""
    return float(abs(ours - theirs).max() / abs(theirs).max())


def test_matrices_equal_those_of_scikit_fem(mesh: meshes.Mesh) -> None:
    basis = skfem.Basis(skfem.MeshTri(mesh.points.T, mesh.triangles.T), skfem.ElementTriP1())
    K, M = stiffness_and_mass(mesh)
    assert difference(K, laplace.assemble(basis)) < 1e-12
    assert difference(M, mass.assemble(basis)) < 1e-12


def test_comparison_with_scikit_fem_notices_a_moved_node(mesh: meshes.Mesh) -> None:
    points = mesh.points.copy()
    points[np.delete(np.arange(len(points)), mesh.boundary)[0]] += 1e-9 * mesh.h
    basis = skfem.Basis(skfem.MeshTri(points.T, mesh.triangles.T), skfem.ElementTriP1())
    assert difference(stiffness_and_mass(mesh)[0], laplace.assemble(basis)) > 1e-12


def test_matrices_are_symmetric_to_the_last_bit(mesh: meshes.Mesh) -> None:
    for matrix in stiffness_and_mass(mesh):
        assert abs(matrix - matrix.T).max() == 0


def test_energies_of_polynomials_are_exact() -> None:
    """u = 1 + 2x - 3y on the unit square: |grad u|^2 = 13 and, by hand, the integral of u^2 is 4/3."""
    mesh = perturbed(structured(square(), 1 / 8))
    K, M = stiffness_and_mass(mesh)
    u = mesh.points @ [2, -3] + 1
    assert u @ (K @ u) == pytest.approx(13, rel=1e-13)
    assert u @ (M @ u) == pytest.approx(1 / 4 + 4 / 12 + 9 / 12, rel=1e-13)


def test_gradients_reproduce_linear_functions(mesh: meshes.Mesh) -> None:
    values = mesh.points @ [0.7, -0.2] + 3
    found = np.einsum("mi,mid->md", values[mesh.triangles], gradients(mesh))
    np.testing.assert_allclose(found, np.tile([0.7, -0.2], (len(found), 1)), atol=1e-11)


def midpoint_moments(mesh: meshes.Mesh, values: np.ndarray, hats: np.ndarray) -> np.ndarray:
    """(m, 3) moments of a function by the rule in the edges' midpoints, exact for quadratic functions.

    `hats` (3, 3) are the barycentric functions in the midpoints; `values` (m, 3) the function's.
    """
    return (mesh.areas / 3)[:, None] * (values @ hats)


MIDPOINTS = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])


def linear_in_midpoints(mesh: meshes.Mesh) -> np.ndarray:
    return (MIDPOINTS @ mesh.points[mesh.triangles]) @ [1.5, -2.0] + 1


def test_loads_of_linear_functions_are_matrix_products(mesh: meshes.Mesh) -> None:
    """For u in V_h the loads are M u and (K + M) u, and the midpoint rule is exact."""
    slope = np.array([1.5, -2.0])
    u = mesh.points @ slope + 1
    moments = midpoint_moments(mesh, linear_in_midpoints(mesh), MIDPOINTS)
    K, M = stiffness_and_mass(mesh)
    assert abs(load(mesh, moments) - M @ u).max() < 1e-13 * abs(M @ u).max()
    found = h1_load(mesh, moments, mesh.areas[:, None] * slope)
    assert abs(found - (K + M) @ u).max() < 1e-12 * abs(K @ u).max()


def test_load_comparison_notices_a_wrong_barycentric_order() -> None:
    mesh = MESHES["perturbed"]()
    _, M = stiffness_and_mass(mesh)
    u = mesh.points @ [1.5, -2.0] + 1
    wrong = load(mesh, midpoint_moments(mesh, linear_in_midpoints(mesh), np.roll(MIDPOINTS, 1, axis=1)))
    assert abs(wrong - M @ u).max() > 1e-6 * abs(M @ u).max()
