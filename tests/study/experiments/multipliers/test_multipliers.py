"""Other methods' multipliers: what defines each, computed in another way, and errors of known functions."""

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from conftest import load
from scipy.optimize import minimize

from study import tables
from study.experiments.certify.measure import assemble_nodal_problem
from study.experiments.multipliers import measure
from unilateral.fem.p1 import case_moments, coupling, edge_load, load_vector
from unilateral.geometry.mesh import triangulate_from_boundary
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import true_errors
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import derive_solution
from unilateral.solution.solver import Solver
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import uzawa

SCHEMES = [
    *("P0, H = 2h", "P0, H = 4h", "nodal reactions", "stabilised, H = h"),
    *("P0, H = 2h, linear", "nodal reactions, linear"),
]
GAMMA = 0.1
QUADRATIC = {
    "title": "u = (x - 1/2)^2 + (y - 1/2)^2 in full contact, lambda = 1",
    "polygons": "any",
    "u": [{"atom": "smooth", "formula": "(x - 1/2)**2 + (y - 1/2)**2"}],
    "gap": {"elsewhere": 0},
}
MESH = make_structured_mesh(square(), 1 / 8)
GRADED = triangulate_from_boundary(
    square(), [0, 0.3, 0.5, 0.9, 1, 1.25, 1.5, 1.75, 2, 2.5, 2.6, 3, 3.2, 3.4, 3.8]
)
"""A mesh with boundary edges of many lengths."""


@pytest.fixture(scope="module")
def case():
    """Contact on a part of the bottom, and on the other sides."""
    return load("natural")


@pytest.fixture(scope="module")
def methods(case):
    return measure.discretise([case], MESH, [2, 4], GAMMA)


def solve(method):
    """The lambda_i (m,)."""
    return uzawa(method.operator, method.offsets[0], 1e-12, method="newton").lambda_H


def minimise_energy(A, f, B, g):
    """The multiplier (m,) of the least v.Av/2 - f.v with B v >= g, by an interior-point method."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    m = B.shape[0]
    cones = [clarabel.NonnegativeConeT(m)]
    rows = sp.csc_matrix(-B)
    solver = clarabel.DefaultSolver(sp.csc_matrix(sp.triu(A)), -f, rows, -g, cones, settings)
    return np.array(solver.solve().z)


def test_p0_and_nodal_reactions_are_multipliers_of_the_least_energy(case, methods):
    """The energy has scikit-fem's matrix, the constraints are means over cells or values at nodes.

    Both solvers are exact to 1e-9. Control: the two methods on cells differ.
    """
    problem = assemble_nodal_problem(case, MESH, skfem.ElementTriP1())
    load = load_vector(MESH, case_moments(case, MESH))
    nb = len(MESH.boundary)
    places = (np.ones(nb), (np.arange(nb), MESH.boundary))
    trace = sp.csr_array(places, shape=(nb, MESH.n_nodes))
    expected = {}
    for name, H in (("P0, H = 2h", 1 / 4), ("P0, H = 4h", 1 / 2)):
        cells = make_uniform_partition(square(), H)
        B = coupling(MESH, cells) @ trace
        g = cells.lengths * cell_means(case, cells).g_means
        expected[name] = minimise_energy(problem.A, load, B, g)
        np.testing.assert_allclose(solve(methods[name]), expected[name], atol=1e-8)
    reactions = minimise_energy(problem.A, load, trace, problem.g[MESH.boundary])
    np.testing.assert_allclose(solve(methods["nodal reactions"]), reactions / MESH.h, atol=1e-8)
    assert np.abs(expected["P0, H = 2h"] - np.repeat(expected["P0, H = 4h"], 2)).max() > 0.05


def test_the_stabilised_multiplier_is_that_of_the_saddle_point(case, methods):
    """The supremum over mu >= 0 on an edge e is at mu = max(0, dv/dn - mean(v - g)/(gamma |e|)).

    What is left is a convex function of v, which is minimised. Normal derivatives on this mesh are quotients
    of differences. Control: that of another gamma differs.
    """
    problem = assemble_nodal_problem(case, MESH, skfem.ElementTriP1())
    load = load_vector(MESH, case_moments(case, MESH))
    g_means = cell_means(case, Partition(square(), MESH.s)).g_means
    h = MESH.h
    a = MESH.boundary
    b = np.roll(a, -1)
    # the legs of a boundary triangle are an edge and one from it inwards, at one of its ends
    corners = MESH.triangles[MESH.boundary_triangles]
    inner = np.array([next(iter(set(c) - {i, j})) for c, i, j in zip(corners.tolist(), a, b, strict=True)])
    distance = np.linalg.norm(MESH.points[inner][:, None] - MESH.points[np.stack([a, b], 1)], axis=2)
    foot = np.where(distance[:, 0] < distance[:, 1], a, b)

    def maximise(v):
        return np.maximum(0, (v[foot] - v[inner]) / h - ((v[a] + v[b]) / 2 - g_means) / (GAMMA * h))

    def evaluate_energy(v):
        normal = (v[foot] - v[inner]) / h
        mu = maximise(v)
        gap = (v[a] + v[b]) / 2 - g_means
        energy = v @ (problem.A @ v) / 2 - load @ v
        energy += np.sum(-mu * h * gap - GAMMA / 2 * h**2 * (mu - normal) ** 2)
        slope = problem.A @ v - load
        np.add.at(slope, a, -mu * h / 2)
        np.add.at(slope, b, -mu * h / 2)
        np.add.at(slope, foot, GAMMA * h * (mu - normal))
        np.add.at(slope, inner, -GAMMA * h * (mu - normal))
        return energy, slope

    options = {"gtol": 1e-11, "maxiter": 10_000}
    v = minimize(evaluate_energy, np.zeros(MESH.n_nodes), jac=True, method="BFGS", options=options).x
    assert np.abs(evaluate_energy(v)[1]).max() < 1e-7
    computed = solve(methods["stabilised, H = h"])
    np.testing.assert_allclose(computed, maximise(v), atol=1e-5)
    changed = measure.discretise([case], MESH, [2], 0.4)["stabilised, H = h"]
    assert np.abs(solve(changed) - computed).max() > 0.05


def test_p0_is_what_users_get(case, methods):
    """Up to an algebraic error of 1e-11 in the discrete dual norm."""
    solution = Solver(case.problem, mesh=MESH, H=1 / 4, stop=Stop(tolerance=1e-11))()
    np.testing.assert_allclose(solve(methods["P0, H = 2h"]), solution.multiplier, atol=1e-8)


def test_the_dual_basis_is_orthogonal_to_the_hats_of_other_nodes():
    """<psi_i, phi_i> is half the length of both edges at node i. Control: indicators of edges are not."""
    lengths = np.diff(GRADED.s)
    nb = len(lengths)
    products = (measure.nodal_basis(nb, 2, -1).T @ measure.pair_with_hats(GRADED)).toarray()
    weights = (lengths + np.roll(lengths, 1)) / 2
    np.testing.assert_allclose(products, np.diag(weights), atol=1e-15)
    indicators = measure.indicator_basis(np.arange(nb)).T @ measure.pair_with_hats(GRADED)
    assert np.abs(indicators.toarray() - np.diag(lengths)).max() > 0.1


def test_the_dual_basis_reproduces_constants():
    np.testing.assert_allclose(measure.nodal_basis(5, 2, -1) @ np.ones(5), 1, rtol=1e-15)


def test_linear_reactions_have_the_same_numbers_as_values_at_nodes(methods):
    """At both ends of each edge; those of the dual basis are 2 a - b there. Control: a != b."""
    nodal = solve(methods["nodal reactions"])
    linear = methods["nodal reactions, linear"]
    np.testing.assert_array_equal(solve(linear), nodal)
    values = linear.evaluate_at_ends(nodal)
    np.testing.assert_array_equal(values, np.stack([nodal, np.roll(nodal, -1)], axis=1))
    dual = methods["nodal reactions"].evaluate_at_ends(nodal)
    np.testing.assert_allclose(dual, 2 * values - values[:, ::-1], rtol=1e-14)
    assert np.abs(values[:, 0] - values[:, 1]).max() > 0.5


def test_functions_through_midpoints_reproduce_linear_ones():
    """Another one on each side, also towards its ends; cells of two edges of many lengths.

    Control: a function that is not linear is not reproduced.
    """
    mesh = triangulate_from_boundary(
        square(), np.concatenate([k + np.array([0, 0.1, 0.4, 0.6]) for k in range(4)])
    )
    cells = Partition(square(), mesh.s[::2])
    middles = (cells.points[1:] + cells.points[:-1]) / 2
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    slopes = np.array([3, -1, 0.5, 2])
    basis = measure.midpoint_basis(mesh, cells)
    computed = basis @ (slopes[cells.side] * middles)
    np.testing.assert_allclose(computed, slopes[np.repeat(mesh.side, 2)] * ends, rtol=1e-14, atol=1e-14)
    assert np.abs(basis @ middles**2 - ends**2).max() > 0.01


def test_products_with_hats_are_those_of_the_library():
    """Random values at the ends of edges."""
    values = np.random.default_rng(5).normal(size=(len(GRADED.boundary), 2))
    expected = edge_load(GRADED, values)[GRADED.boundary]
    np.testing.assert_allclose(measure.pair_with_hats(GRADED).T @ values.ravel(), expected, rtol=1e-13)


def test_normal_derivatives_of_linear_functions_are_exact():
    """v = 2 + 3x - 5y, n the normal of a side."""
    x, y = GRADED.points.T
    expected = square().normals[GRADED.side] @ [3, -5]
    np.testing.assert_allclose(
        measure.normal_derivatives(GRADED) @ (2 + 3 * x - 5 * y), expected, rtol=1e-12, atol=1e-12
    )


def test_forces_balance():
    """lambda = 1 on a perimeter of 4; <lambda_h, 1> differs by (u_h - u, 1), as the slope of 1 is 0."""
    full = derive_solution(QUADRATIC, "quadratic", square(), 0)
    for name, method in measure.discretise([full], MESH, [2, 4], GAMMA).items():
        assert method.operator.H_i.sum() == pytest.approx(4)
        assert method.operator.H_i @ solve(method) == pytest.approx(4, abs=0.01), name


def test_errors_of_the_exact_function_vanish():
    """lambda = 1. Control: 1.001 is off by 0.001 times its norm, 2 in L2."""
    full = derive_solution(QUADRATIC, "quadratic", square(), 0)
    cells = Partition(square(), MESH.s)
    mu = np.ones((2, len(MESH.boundary), 2))
    mu[1] = 1.001
    errors = measure.measure_l2_errors(full, cells, mu)
    np.testing.assert_allclose(errors, [0, 0.002], atol=1e-14)


def test_the_errors_are_those_of_the_library_for_the_method_of_1980(case, methods):
    """Bounds by another reference mesh: both enclose the error."""
    measured_errors = measure.measure([case], MESH, [2], GAMMA).sel(case="natural", scheme="P0, H = 2h")
    cells = make_uniform_partition(square(), 1 / 4)
    lambda_H = solve(methods["P0, H = 2h"])
    expected = true_errors(case, MESH, np.zeros(MESH.n_nodes), cells, lambda_H, True, True)
    assert float(measured_errors["l2_error"]) == pytest.approx(expected.l2, rel=1e-9)
    assert float(measured_errors["hm12_error_lower"]) <= expected.hm12_upper
    assert float(measured_errors["hm12_error_upper"]) >= expected.hm12_lower
    assert float(measured_errors["hm12_error_upper"] / measured_errors["hm12_error_lower"]) < 1.05
    assert float(measured_errors["algebraic_bound"]) <= measure.ALGEBRAIC_TOLERANCE


def test_a_table_of_two_sizes_is_stored(tmp_path):
    """With the numbers of multipliers: 4/h edges, and as many nodes."""
    scene = {"polygon": "square", "side": 0, "cases": ["natural", "thirds"]}
    study = {"scenes": [scene], "h": ["1/4", "1/8"], "edges_per_cell": [2, 4], "stabilisation": "1/10"}
    path = tmp_path / "results/multipliers/errors.nc"
    path.parent.mkdir(parents=True)
    measure.measure_multipliers(study, str(path))
    stored = tables.load_table(path)
    assert stored["case"].values.tolist() == ["natural", "thirds"]
    assert stored["scheme"].values.tolist() == SCHEMES
    assert stored["h"].values.tolist() == [0.25, 0.125]
    assert stored["multipliers"].values.tolist() == [[8, 4, 16, 16, 8, 16], [16, 8, 32, 32, 16, 32]]
    assert stored.notnull().all()
