"""P1 matrices against scikit-fem's, loads against polynomials integrated by hand."""

import numpy as np
import pytest
import skfem
from skfem.models.poisson import laplace, mass

from unilateral.fem import p1
from unilateral.fem.p1 import (
    assemble_load_by_blocks,
    energy_norm,
    gradients,
    h1_load,
    load_vector,
    stiffness_and_mass,
)
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.structured import make_structured_mesh


def perturb_mesh(mesh):
    """The mesh with its interior nodes moved by up to a fifth of h."""
    points = mesh.points.copy()
    interior = np.delete(np.arange(len(points)), mesh.boundary)
    points[interior] += np.random.default_rng(1).uniform(-0.2, 0.2, (len(interior), 2)) * mesh.h
    return meshes.Mesh(mesh.polygon, points, mesh.triangles, mesh.boundary, mesh.s)


MESHES = {
    "structured": lambda: make_structured_mesh(square(), 1 / 8),
    "perturbed": lambda: perturb_mesh(make_structured_mesh(square(), 1 / 8)),
    "gmsh": lambda: meshes.make_unstructured_mesh(find_polygon("lshape"), 1 / 4),
    "refined": lambda: meshes.refine_uniformly(
        perturb_mesh(make_structured_mesh(find_polygon("lshape"), 1 / 4))
    ),
}


@pytest.fixture(params=MESHES)
def mesh(request):
    return MESHES[request.param]()


def difference(ours, theirs):
    """The largest entry of the difference, relative to the largest entry."""
    return float(abs(ours - theirs).max() / abs(theirs).max())


def assemble_by_scikit_fem(points, triangles):
    basis = skfem.Basis(skfem.MeshTri(points.T, triangles.T), skfem.ElementTriP1())
    return laplace.assemble(basis), mass.assemble(basis)


def test_matrices_equal_those_of_scikit_fem(mesh):
    """Control: a moved node is noticed."""
    ours = stiffness_and_mass(mesh)
    shifted_points = mesh.points.copy()
    for matrix, expected in zip(ours, assemble_by_scikit_fem(mesh.points, mesh.triangles), strict=True):
        assert difference(matrix, expected) < 1e-12
        assert abs(matrix - matrix.T).max() == 0
    shifted_points[np.delete(np.arange(mesh.n_nodes), mesh.boundary)[0]] += 1e-9 * mesh.h
    assert difference(ours[0], assemble_by_scikit_fem(shifted_points, mesh.triangles)[0]) > 1e-12


def test_the_norm_of_a_linear_function_is_its_closed_form(mesh):
    """u = 2 on the L-shape of area 3; u = 1 + 2x - 3y on the unit square: 13 + 4/3, by hand."""
    coefficients, square_of_norm = ([0, 0, 2], 12) if mesh.polygon.n_sides == 6 else ([2, -3, 1], 13 + 4 / 3)
    u = np.column_stack([mesh.points, np.ones(mesh.n_nodes)]) @ coefficients
    assert energy_norm(mesh, u) ** 2 == pytest.approx(square_of_norm, rel=1e-12)


def test_gradients_reproduce_linear_functions(mesh):
    values = mesh.points @ [0.7, -0.2] + 3
    slopes = np.einsum("mi,mid->md", values[mesh.triangles], gradients(mesh))
    np.testing.assert_allclose(slopes, np.tile([0.7, -0.2], (len(slopes), 1)), rtol=0, atol=1e-11)


def test_loads_of_linear_functions_are_matrix_products(mesh):
    """For u in V_h the loads are M u and (K + M) u; the rule of the edges' midpoints is exact.

    Control: moments with the hats in another order are noticed.
    """
    hats = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])
    slope = np.array([1.5, -2.0])
    u = mesh.points @ slope + 1
    (K, M) = stiffness_and_mass(mesh)
    weighted = (mesh.areas / 3)[:, None] * (hats @ mesh.points[mesh.triangles] @ slope + 1)
    moments = weighted @ hats
    wrong = weighted @ np.roll(hats, 1, axis=1)
    assert abs(load_vector(mesh, moments) - M @ u).max() < 1e-13 * abs(M @ u).max()
    computed = h1_load(mesh, gradients(mesh), moments, mesh.areas[:, None] * slope)
    assert abs(computed - (K + M) @ u).max() < 1e-12 * abs(K @ u).max()
    assert abs(load_vector(mesh, wrong) - M @ u).max() > 1e-6 * abs(M @ u).max()


@pytest.mark.parametrize("scale", [2.0**-540, 2.0**500])
def test_the_norm_scales_where_squares_vanish_or_overflow(mesh, scale):
    u = np.random.default_rng(1).standard_normal(mesh.n_nodes)
    assert energy_norm(mesh, scale * u) == pytest.approx(scale * energy_norm(mesh, u), rel=1e-12)
    assert energy_norm(mesh, 0 * u) == 0
    assert np.isnan(energy_norm(mesh, np.nan * u))
    assert energy_norm(mesh, np.append(u[1:], np.inf)) == np.inf


def test_loads_by_parts_are_those_of_the_mesh(mesh, monkeypatch):
    """Of an f that is linear on each triangle, but for rounding of no interest here."""

    def moments(component):
        return component.areas[:, None] * np.exp(component.points[component.triangles].sum(axis=2))

    monkeypatch.setattr(p1, "MESH_BLOCK_TRIANGLES", 5)
    mesh_blocks = list(p1.mesh_blocks(mesh))
    assert len(mesh_blocks) > 1
    assert sum(len(component.triangles) for component in mesh_blocks) == len(mesh.triangles)
    np.testing.assert_allclose(
        assemble_load_by_blocks(mesh, moments), load_vector(mesh, moments(mesh)), rtol=0, atol=1e-15
    )
    assert abs(sum(component.areas.sum() for component in mesh_blocks[1:]) - mesh.polygon.area) > 1e-3
