"""Partial elimination against dense Schur complements and solves with the full matrix."""

import math

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spl
import sentences
from nested import assemble_by_elements
from scipy.sparse.csgraph import connected_components

from unilateral.errors import InputError
from unilateral.fem.condense import check_constants, condense
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import elimination_order, factorise, factorise_by_dissection, schur_factor
from unilateral.fem.p1 import coupling
from unilateral.fem.spaces import STEKLOV_SHARE, DualOperator, dual_operator
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh, make_tensor_mesh

NECK = Polygon(np.array([[0, 0], [1, 0.45], [2, 0], [2, 1], [1, 0.55], [0, 1]]), "neck")

MESHES = {
    "one square": lambda: make_structured_mesh(square(), 1.0),
    "one interior node": lambda: make_structured_mesh(square(), 1 / 2),
    "structured": lambda: make_structured_mesh(square(), 1 / 16),
    "gmsh": lambda: meshes.make_unstructured_mesh(square(), 1 / 9),
    "lshape": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 8),
    "refined": lambda: meshes.refine_uniformly(meshes.make_unstructured_mesh(find_polygon("lshape"), 1 / 3)),
    "interior in pieces": lambda: meshes.make_unstructured_mesh(NECK, 0.25),
    "macro-elements, alike": lambda: meshes.refine_uniformly(
        make_structured_mesh(find_polygon("lshape"), 1 / 2), 3
    ),
    "macro-elements": lambda: meshes.refine_uniformly(meshes.make_unstructured_mesh(square(), 1 / 2), 4),
    "macro-elements in pieces": lambda: meshes.refine_uniformly(meshes.make_unstructured_mesh(NECK, 0.9), 3),
}


@pytest.fixture(params=MESHES)
def condensed_matrix(request):
    return condense(MESHES[request.param]())


def test_products_are_those_with_the_assembled_matrix(condensed_matrix):
    """A place is rounded by 4e-16; of the slimmest triangle's height, 1e-2, that is 4e-14, as of an entry."""
    difference = condensed_matrix.matrix_and_row_sums[0] - assemble_by_elements(condensed_matrix.mesh)
    assert abs(difference).max() <= 1e-13 * abs(condensed_matrix.A).max()


def schur_error(A_3, mesh):
    """Distance to the Schur complement by dense numpy, relative to its largest entry."""
    A = assemble_by_elements(mesh).toarray()
    b = mesh.boundary
    i = np.delete(np.arange(len(A)), b)
    expected = A[np.ix_(b, b)] - A[np.ix_(b, i)] @ np.linalg.solve(A[np.ix_(i, i)], A[np.ix_(i, b)])
    return float(abs(A_3 - expected).max() / abs(expected).max())


def test_A3_is_the_schur_complement(condensed_matrix):
    assert schur_error(condensed_matrix.A_3, condensed_matrix.mesh) < 1e-10
    assert abs(condensed_matrix.A_3 - condensed_matrix.A_3.T).max() == 0


def test_comparison_notices_two_boundary_nodes_exchanged():
    condensed = condense(MESHES["structured"]())
    swapped = np.arange(len(condensed.A_3))
    swapped[[0, 5]] = [5, 0]
    assert schur_error(condensed.A_3[swapped][:, swapped], condensed.mesh) > 1e-3


def test_solutions_equal_those_of_the_full_matrix(condensed_matrix):
    """One and several at a time; and the equations hold up to rounding."""
    A = assemble_by_elements(condensed_matrix.mesh).tocsc()
    rhs = np.random.default_rng(3).standard_normal((len(condensed_matrix.mesh.points), 2))
    expected = spl.splu(A).solve(rhs)
    solution = condensed_matrix.solve(rhs)
    assert abs(solution - expected).max() < 1e-10 * abs(expected).max()
    assert abs(condensed_matrix.solve(rhs[:, 0]) - expected[:, 0]).max() < 1e-10 * abs(expected).max()
    assert abs(A @ solution - rhs).max() < 1e-11 * abs(solution).max()


def test_condensed_system_gives_the_trace_of_the_full_one(condensed_matrix):
    mesh = condensed_matrix.mesh
    rng = np.random.default_rng(4)
    load = rng.standard_normal(len(mesh.points))
    boundary_load = rng.standard_normal(len(mesh.boundary))
    total = load.copy()
    total[mesh.boundary] += boundary_load
    trace = spl.spsolve(assemble_by_elements(mesh).tocsc(), total)[mesh.boundary]
    condensed_trace = condensed_matrix.solve(load)[mesh.boundary] + condensed_matrix.solve_boundary(
        boundary_load
    )
    assert abs(condensed_trace - trace).max() < 1e-10 * abs(trace).max()


def test_the_interior_comes_first_and_the_boundary_stays_in_order(condensed_matrix):
    order = elimination_order(assemble_by_elements(condensed_matrix.mesh), condensed_matrix.mesh.boundary)
    nb = len(condensed_matrix.mesh.boundary)
    assert np.array_equal(np.sort(order), np.arange(len(condensed_matrix.mesh.points)))
    assert np.array_equal(order[-nb:], condensed_matrix.mesh.boundary)


def test_boundary_unknowns_moved_by_the_factorisation_are_an_error():
    """With SuperLU's own column ordering the boundary is not last, and the last block is not A_3."""
    mesh = MESHES["structured"]()
    with pytest.raises(RuntimeError, match="moved the boundary"):
        schur_factor(spl.splu(assemble_by_elements(mesh).tocsc(), permc_spec="COLAMD"), len(mesh.boundary))


def test_pivots_stay_on_the_diagonal():
    """Of [[1, 3/2], [3/2, 4]], where 3/2 would be the larger pivot: the Schur complement is 4 - 9/4."""
    A = sp.csr_array([[1, 1.5], [1.5, 4]])
    np.testing.assert_allclose(schur_factor(factorise(A, np.arange(2)), 1), [[math.sqrt(1.75)]], rtol=1e-15)
    with pytest.raises(RuntimeError, match="moved the boundary"):
        schur_factor(spl.splu(A.tocsc(), permc_spec="NATURAL"), 1)


def test_without_elimination_the_boundary_is_not_last():
    """All nodes are dissected then, whose separators go across the boundary; solutions are the same."""
    condensed = condense(MESHES["structured"]())
    second = factorise_by_dissection(condensed.A)
    boundary = condensed.mesh.boundary
    assert not np.all(np.isin(second.order[-len(boundary) :], boundary))
    rhs = np.random.default_rng(8).standard_normal(condensed.mesh.n_nodes)
    np.testing.assert_allclose(second.solve(rhs), condensed.solve(rhs), rtol=0, atol=1e-12 * abs(rhs).max())


def test_the_neck_has_an_interior_in_pieces():
    mesh = MESHES["interior in pieces"]()
    interior = np.delete(np.arange(len(mesh.points)), mesh.boundary)
    assert connected_components(assemble_by_elements(mesh)[interior][:, interior])[0] > 1


def test_nested_dissection_saves_fill():
    """Nested dissection leaves O(n log n) entries in the factors, the natural order O(n^{3/2})."""
    mesh = make_tensor_mesh(np.linspace(0, 1, 65))
    natural = spl.splu(assemble_by_elements(mesh).tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
    assert condense(mesh).factors.lu.nnz < 0.7 * natural.nnz


@pytest.mark.parametrize("ratio", [0.5, 1, 2, 3.3])
def test_dual_operator_equals_full_solves(ratio):
    """D = B A^{-1} B^T with the full matrix A and B continued by zero to the interior nodes."""
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 8)
    partition = partitions.make_uniform_partition(find_polygon("lshape"), ratio / 8)
    B = coupling(mesh, partition)
    operator = dual_operator(condense(mesh), B, partition.lengths)
    continued = np.zeros((len(mesh.points), partition.n_cells))
    continued[mesh.boundary] = B.toarray().T
    expected = continued.T @ spl.spsolve(assemble_by_elements(mesh).tocsc(), continued)
    assert abs(operator.D - expected).max() < 1e-10 * abs(expected).max()
    assert operator.shift_norm == pytest.approx(3**0.5)
    assert operator.shift_means == pytest.approx(np.ones(partition.n_cells))


def test_S_has_the_energy_of_D_in_unknowns_of_the_L2_norm():
    """y.Sy = mu.D mu for y_i = H_i^{1/2} mu_i, on cells of unequal lengths, and S is symmetric."""
    half = np.random.default_rng(6).standard_normal((5, 3))
    operator = DualOperator(half, np.array([0.25, 1.0, 4.0]), 1.0)
    mu = np.array([1.0, -2.0, 3.0])
    y = np.array([0.5, -2.0, 6.0])
    assert y @ operator.S @ y == pytest.approx(np.sum((half @ mu) ** 2), rel=1e-13)
    np.testing.assert_allclose(operator.S, operator.S.T, rtol=1e-14)


def test_singular_exactly_where_beta_is_zero():
    """H = h on an even number of edges, and more cells than boundary nodes: beta = 0; H = 2h: beta > 0."""
    mesh = make_structured_mesh(square(), 1 / 8)
    condensed = condense(mesh)
    is_singular = {}
    for ratio in (0.5, 1, 2):
        partition = partitions.make_uniform_partition(square(), ratio / 8)
        is_singular[ratio] = dual_operator(
            condensed, coupling(mesh, partition), partition.lengths
        ).is_singular
    assert is_singular == {0.5: True, 1: True, 2: False}


@pytest.mark.parametrize(("ratio", "singular"), [(1e-13, True), (1e-11, False)])
def test_singular_is_told_by_the_ratio_of_the_eigenvalues(ratio, singular):
    """half is diagonal, so S has the eigenvalues 5 and 5 ratio; eigvalsh is exact on diagonal matrices."""
    operator = DualOperator(np.diag(np.sqrt([2.5, 2.5 * ratio])), np.full(2, 0.5), 1.0)
    assert operator.lambda_max == pytest.approx(5)
    assert operator.lambda_min == pytest.approx(5 * ratio)
    assert operator.is_singular == singular


@pytest.mark.parametrize(
    ("displaced", "refused"), [(0.9e-8, False), (1.1e-8, True), (-1.1e-8, True), (np.nan, True)]
)
def test_constants_are_solved_for_up_to_1e_8(displaced, refused):
    """As `dual_norm` says of its bounds: right up to 1e-9 at a diameter of about 1, refused at 1e-8."""
    mesh = meshes.make_unstructured_mesh(NECK, 0.25)
    values = np.ones(mesh.n_nodes)
    values[3] += displaced
    if not refused:
        return check_constants(mesh, Form(), values)
    shortest = np.min(np.hypot(*np.diff(mesh.points[np.append(mesh.boundary, mesh.boundary[0])], axis=0).T))
    with sentences.raises(InputError, "neck", f"{shortest:.3g}"):
        check_constants(mesh, Form(), values)


@pytest.mark.parametrize("L", [1e-8, 1e-6, 1e-2, 1.0, 1e3, 1e8])
def test_a_domain_too_small_for_double_precision_is_refused(L):
    """There K + M has lost M to rounding, and with it the constants: by 1.6 % at 1e-6, all at 1e-8.

    On any reasonable scale constants are solved for.
    """
    mesh = meshes.refine_uniformly(
        meshes.make_unstructured_mesh(Polygon(L * square().vertices, "scaled"), L / 4)
    )
    if L > 1e-6:
        subset = condense(mesh)
        np.testing.assert_allclose(subset.solve(subset.A @ np.ones(mesh.n_nodes)), 1, rtol=1e-8)
        return
    with sentences.raises(InputError):
        condense(mesh)


@pytest.mark.parametrize("name", ["square", "lshape"])
def test_steklov_s_eigenvalue_is_below_that_of_a_coarse_mesh_by_less_than_the_guard(name):
    """By Richardson's extrapolation, the error being of second order."""
    mesh = make_structured_mesh(find_polygon(name), 1.0)
    coarse = condense(meshes.refine_uniformly(mesh, 0)).sigma_1
    fine = condense(meshes.refine_uniformly(mesh, 4)).sigma_1
    finest = condense(meshes.refine_uniformly(mesh, 5)).sigma_1
    exact = finest - (fine - finest) / 3
    assert STEKLOV_SHARE * coarse < 0.99 * exact
    assert coarse > exact
