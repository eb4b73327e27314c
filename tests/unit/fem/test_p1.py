"""P1 matrices against scikit-fem's, loads against polynomials integrated by hand."""

import numpy as np
import pytest
import skfem
from skfem.models.poisson import laplace, mass

from unilateral.fem import p1
from unilateral.fem.p1 import by_parts, gradients, h1_load, h1_norm, load, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import named, square
from unilateral.geometry.structured import structured


def perturbed(mesh):
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
def mesh(request):
    return MESHES[request.param]()


def difference(ours, theirs):
    """The largest entry of the difference, relative to the largest entry."""
    return float(abs(ours - theirs).max() / abs(theirs).max())


def test_matrices_equal_those_of_scikit_fem(mesh):
    basis = skfem.Basis(skfem.MeshTri(mesh.points.T, mesh.triangles.T), skfem.ElementTriP1())
    K, M = stiffness_and_mass(mesh)
    assert difference(K, laplace.assemble(basis)) < 1e-12
    assert difference(M, mass.assemble(basis)) < 1e-12
    for matrix in (K, M):
        assert abs(matrix - matrix.T).max() == 0


def test_comparison_with_scikit_fem_notices_a_moved_node(mesh):
    points = mesh.points.copy()
    points[np.delete(np.arange(len(points)), mesh.boundary)[0]] += 1e-9 * mesh.h
    basis = skfem.Basis(skfem.MeshTri(points.T, mesh.triangles.T), skfem.ElementTriP1())
    assert difference(stiffness_and_mass(mesh)[0], laplace.assemble(basis)) > 1e-12


def test_the_norm_of_a_linear_function(mesh):
    """u = 2 on the L-shape of area 3; u = 1 + 2x - 3y on the unit square: 13 + 4/3, by hand."""
    of, square_of_norm = ([0, 0, 2], 12) if mesh.polygon.n_sides == 6 else ([2, -3, 1], 13 + 4 / 3)
    u = np.column_stack([mesh.points, np.ones(mesh.n_nodes)]) @ of
    assert h1_norm(mesh, u) ** 2 == pytest.approx(square_of_norm, rel=1e-12)


def test_gradients_reproduce_linear_functions(mesh):
    values = mesh.points @ [0.7, -0.2] + 3
    found = np.einsum("mi,mid->md", values[mesh.triangles], gradients(mesh))
    np.testing.assert_allclose(found, np.tile([0.7, -0.2], (len(found), 1)), atol=1e-11)


def midpoint_moments(mesh, values, hats):
    """(m, 3) moments of a function by the rule in the edges' midpoints, exact for quadratic functions.

    `hats` (3, 3) are the barycentric functions in the midpoints; `values` (m, 3) the function's.
    """
    return (mesh.areas / 3)[:, None] * (values @ hats)


MIDPOINTS = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])


def linear_in_midpoints(mesh):
    return (MIDPOINTS @ mesh.points[mesh.triangles]) @ [1.5, -2.0] + 1


def test_loads_of_linear_functions_are_matrix_products(mesh):
    """For u in V_h the loads are M u and (K + M) u, and the midpoint rule is exact."""
    slope = np.array([1.5, -2.0])
    u = mesh.points @ slope + 1
    moments = midpoint_moments(mesh, linear_in_midpoints(mesh), MIDPOINTS)
    K, M = stiffness_and_mass(mesh)
    assert abs(load(mesh, moments) - M @ u).max() < 1e-13 * abs(M @ u).max()
    found = h1_load(mesh, gradients(mesh), moments, mesh.areas[:, None] * slope)
    assert abs(found - (K + M) @ u).max() < 1e-12 * abs(K @ u).max()


def test_load_comparison_notices_a_wrong_barycentric_order():
    mesh = MESHES["perturbed"]()
    _, M = stiffness_and_mass(mesh)
    u = mesh.points @ [1.5, -2.0] + 1
    wrong = load(mesh, midpoint_moments(mesh, linear_in_midpoints(mesh), np.roll(MIDPOINTS, 1, axis=1)))
    assert abs(wrong - M @ u).max() > 1e-6 * abs(M @ u).max()


@pytest.mark.parametrize("scale", [2.0**-540, 2.0**500])
def test_the_norm_of_numbers_whose_squares_vanish_or_overflow(mesh, scale):
    u = np.random.default_rng(1).standard_normal(mesh.n_nodes)
    assert h1_norm(mesh, scale * u) == pytest.approx(scale * h1_norm(mesh, u), rel=1e-12)
    assert h1_norm(mesh, 0 * u) == 0
    assert np.isnan(h1_norm(mesh, np.nan * u))
    assert h1_norm(mesh, np.append(u[1:], np.inf)) == np.inf


def test_loads_by_parts_are_those_of_the_mesh(mesh, monkeypatch):
    """Of an f that is linear on each triangle, but for rounding of no interest here."""

    def moments(part):
        return part.areas[:, None] * np.exp(part.points[part.triangles].sum(axis=2))

    monkeypatch.setattr(p1, "PART", 5)
    parts = list(p1.parts(mesh))
    assert len(parts) > 1
    assert sum(len(part.triangles) for part in parts) == len(mesh.triangles)
    np.testing.assert_allclose(by_parts(mesh, moments), load(mesh, moments(mesh)), atol=1e-15)
    assert abs(sum(part.areas.sum() for part in parts[1:]) - mesh.polygon.area) > 1e-3
