"""Uzawa's algorithm tried: against the linear recursions that it is in full contact, and by hand."""

from functools import cache

import numpy as np
import pytest
from conftest import condense_structured_mesh, couple_structured_mesh, discrete, load

from study.experiments.algorithm import formulation as statements
from study.experiments.algorithm import measure as experiments
from unilateral.discrete.condensed import solve_condensed_problem
from unilateral.fem.linear_systems import factorise_by_dissection
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.ritz import ritz_projection

SHARES = (0.25, 0.45, 0.49, 0.51, 0.99, 1.01)
STEPS = 400


@cache
def measure_iterations():
    cases = [load(name) for name in ("full_contact", "natural")]
    mesh = make_structured_mesh(square(), 1 / 16)
    cells = partitions.make_uniform_partition(square(), 1 / 8)
    return experiments.measure_algorithm(mesh, cells, cases, SHARES, STEPS)


@cache
def spectrum():
    """Eigenvalues of S, ascending, and the share of each eigenvector in lambda_H of full contact."""
    pair = couple_structured_mesh("square", 16, 8)
    case = load("full_contact")
    problem = ritz_projection(case, condense_structured_mesh("square", 16))
    offset = pair.B @ problem.load_trace / pair.partition.lengths - cell_means(case, pair.partition).g_means
    values, vectors = np.linalg.eigh(pair.operator.S)
    y = np.linalg.solve(pair.operator.S, -np.sqrt(pair.partition.lengths) * offset)
    return values, vectors.T @ y / np.linalg.norm(y)


@pytest.mark.parametrize("share", [0.25, 0.45, 0.49])
def test_in_full_contact_the_distance_is_that_of_the_linear_iteration(share):
    """(1 - rho sigma)^n in every eigenvector; the clip never acts, for lambda stays positive."""
    sigma, y = spectrum()
    remaining = (1 - share * 2 / sigma[-1] * sigma) ** STEPS * y
    value = float(
        measure_iterations()["distance"].sel(case="full_contact", variant="as meant", rho_share=share)
    )
    assert value == pytest.approx(np.linalg.norm(remaining), rel=1e-6)


def test_the_printed_index_gives_the_quadratic_recursion():
    """z^2 - z + rho sigma = 0, from lambda^0 = lambda^(-1) = 0."""
    sigma, y = spectrum()
    now = -y
    before = -y
    for _ in range(STEPS):
        following = now - 0.25 * 2 / sigma[-1] * sigma * before
        before = now
        now = following
    value = float(
        measure_iterations()["distance"].sel(case="full_contact", variant="as printed", rho_share=0.25)
    )
    assert value == pytest.approx(np.linalg.norm(now), rel=1e-6)


def test_the_iteration_converges_below_two_over_lambda_max_and_as_printed_below_half_of_it():
    """Full contact: 2/lambda_max(S) as meant, half of it as printed; on both sides of either limit."""
    row = measure_iterations()["distance"].sel(case="full_contact")
    meant = row.sel(variant="as meant")
    printed = row.sel(variant="as printed")
    assert np.all(meant.sel(rho_share=[0.45, 0.49, 0.51, 0.99]) < 0.05)
    assert float(meant.sel(rho_share=1.01)) > 0.5
    assert np.all(printed.sel(rho_share=[0.25, 0.45, 0.49]) < 0.05)
    assert float(printed.sel(rho_share=0.51)) > 0.5


def test_without_the_clip_another_multiplier_is_reached():
    """In partial contact; in full contact, as a control, the same one."""
    row = measure_iterations()["distance"].sel(rho_share=0.49)
    assert float(row.sel(case="natural", variant="without the clip")) > 0.01
    full = row.sel(case="full_contact")
    assert float(full.sel(variant="without the clip")) == pytest.approx(float(full.sel(variant="as meant")))


def test_the_pair_is_a_saddle_point_and_no_other_is():
    """u_h of another multiplier still minimises in v; but that multiplier maximises nothing."""
    table = measure_iterations()
    assert np.all(table["saddle_in_v"] > 0)
    assert np.all(table["saddle_in_v_elsewhere"] > 0)
    for name in ("saddle_in_mu", "inequality"):
        assert np.all(table[name] >= -1e-12)
        assert np.all(table[f"{name}_elsewhere"] < -1e-3)


def test_the_part_that_is_not_constant_on_cells_is_that_by_a_finer_sum():
    """natural: midpoints of 2000 pieces a cell, u_h from the solve of the pair."""
    discrete_problem = discrete("natural", 16, 8)
    solution = solve_condensed_problem(discrete_problem)
    case = load("natural")
    mesh = condense_structured_mesh("square", 16).mesh
    n = 2000 * discrete_problem.spaces.partition.n_cells
    s = (np.arange(n) + 0.5) * 4 / n
    side = np.floor(s).astype(int)
    u, _, gap = case.trace_flux_and_gap(side, s - side)
    trace = solution.u_h[mesh.boundary]
    values = (np.interp(s, mesh.s, np.append(trace, trace[0])) - (u - gap)).reshape(-1, 2000)
    expected = np.sqrt(np.sum(values.var(axis=1)) / np.sum(np.mean(values**2, axis=1)))
    assert float(measure_iterations()["off_cells"].sel(case="natural")) == pytest.approx(expected, rel=1e-3)


def test_the_printed_lagrangian_doubles_the_multiplier():
    """J = ||v||^2 - 2 (f, v) is twice section 5's, the constraint's term is not."""
    np.testing.assert_allclose(measure_iterations()["multiplier_factor"], 2, rtol=1e-9)
    np.testing.assert_allclose(measure_iterations()["multiplier_factor_elsewhere"], 1, rtol=1e-9)  # control


def test_the_multiplier_is_not_unique_at_equal_sizes_only():
    equal = experiments.measure_uniqueness(
        make_structured_mesh(square(), 1 / 8), partitions.make_uniform_partition(square(), 1 / 8)
    )
    assert float(equal["violation"]) < 1e-12
    assert float(equal["same_u"]) < 1e-12
    assert float(equal["multiplier_distance"]) == pytest.approx(
        0.5 * 2
    )  # (-1)^e / 2 on a boundary of length 4
    finer = experiments.measure_uniqueness(
        make_structured_mesh(square(), 1 / 16), partitions.make_uniform_partition(square(), 1 / 8)
    )
    assert float(finer["violation"]) > 1e-3


def test_elimination_has_the_iterates_of_full_solves_and_the_operations_counted():
    sizes = (1 / 8, 1 / 16)
    subset = [make_structured_mesh(square(), h) for h in sizes]
    cells = [partitions.make_uniform_partition(square(), 2 * h) for h in sizes]
    elimination = experiments.measure_elimination(subset, cells, 20)
    assert float(elimination["difference"]) < 1e-12
    np.testing.assert_array_equal(elimination["with_S"], [16 * 31, 32 * 63])
    for k, n in enumerate((8, 16)):
        lu = factorise_by_dissection(condense_structured_mesh("square", n).A).lu
        m = 2 * n
        nb = 4 * n
        nnz = couple_structured_mesh("square", n, n // 2).B.nnz
        coupling = (2 * nnz - nb) + (2 * nnz - m) + 2 * m
        below = lu.L.nnz - lu.shape[0]
        above = lu.U.nnz - lu.shape[0]
        assert float(elimination["with_A"][k]) == 2 * below + 2 * above + lu.shape[0] + coupling
        assert float(elimination["with_A_3"][k]) == 2 * nb**2 + coupling


def test_the_bounds_bound_and_say_nothing_where_beta_is_0():
    """At H = 2h both are at least the error; at H = h the residual's is infinite, the energy's holds."""
    cases = [load(name) for name in ("full_contact", "natural")]
    mesh = make_structured_mesh(square(), 1 / 16)
    stable = experiments.measure_certificates(
        mesh, partitions.make_uniform_partition(square(), 1 / 8), cases, [10, 200]
    )
    singular = experiments.measure_certificates(
        mesh, partitions.make_uniform_partition(square(), 1 / 16), cases, [10, 200]
    )
    for operator in (stable, singular):
        assert np.all(operator["residual_index"] >= 1)
        assert np.all(operator["energy_index"] >= 1)
    assert np.all(np.isfinite(stable["residual_index"]))
    assert np.all(np.isinf(singular["residual_index"]))


def test_the_distances_of_the_certificates_are_those_of_the_linear_iteration():
    """In full contact, in the energy: half of S's square root is A_3^{-1/2} B^T, so sigma^{1/2} weighs y."""
    case = [load("full_contact")]
    mesh = make_structured_mesh(square(), 1 / 16)
    cells = partitions.make_uniform_partition(square(), 1 / 8)
    certificates = experiments.measure_certificates(mesh, cells, case, [50])
    sigma, y = spectrum()
    weighted = np.sqrt(sigma) * y
    remaining = (1 - 0.9 / sigma[-1] * sigma) ** 50 * weighted
    assert float(certificates["u_distance"][0, 0]) == pytest.approx(
        np.linalg.norm(remaining) / np.linalg.norm(weighted), rel=1e-6
    )


def test_the_split_of_the_error_holds_up_to_quadrature():
    """Galerkin orthogonality; with another norm in its last term it is off by more than a hundredth."""
    cases = [load(name) for name in ("full_contact", "thirds")]
    split = experiments.measure_split(
        make_structured_mesh(square(), 1 / 16), partitions.make_uniform_partition(square(), 1 / 8), cases
    )
    assert np.all(split["split_defect"] <= 1e-4)  # full_contact has no kink, thirds the edge of its cutoff
    assert np.all(split["split_defect_elsewhere"] >= 1e-2)


def test_the_first_term_of_the_residual_s_bound_is_no_bound():
    cells = partitions.make_uniform_partition(square(), 1 / 8)
    certificates = experiments.measure_certificates(
        make_structured_mesh(square(), 1 / 16), cells, [load("natural")], [10]
    )
    assert np.all(certificates["first_term_index"] < 1)
    assert np.all(certificates["residual_index"] >= 1)


@cache
def measure_statements():
    cells = partitions.make_uniform_partition(square(), 1 / 8)
    return statements.measure_formulation(
        make_structured_mesh(square(), 1 / 16), cells, [load(name) for name in ("full_contact", "natural")]
    )


@pytest.mark.parametrize("case", ["full_contact", "natural"])
def test_u_is_the_solution_of_both_forms_of_the_problem_and_u_h_of_its_own(case):
    """To the quadrature of f, which is 1e-11 for these two (degree 8 on h = 1/16); spoilt by O(1)."""
    row = measure_statements().sel(case=case)
    assert row["equation"] < 1e-9 < 0.1 < row["equation_elsewhere"]
    assert row["minimum"] > -1e-9 > -0.01 > row["minimum_elsewhere"]
    assert row["minimum_in_K"] > -1e-12 > -0.1 > row["minimum_in_K_elsewhere"]


def test_the_form_of_the_mixed_problem_has_the_squared_norm_and_its_constant_is_attained():
    """A(U, U) = ||u||^2; M is the norm of [[1, 1], [-1, 0]]: its square is a root of z^2 - 3 z + 1."""
    table = measure_statements()
    assert float(table["diagonal"]) == pytest.approx(1, abs=1e-12)
    assert abs(float(table["diagonal_elsewhere"]) - 1) > 1e-4
    assert float(table["continuity"]) ** 2 == pytest.approx((3 + 5**0.5) / 2, rel=1e-12)
    assert float(table["continuity_elsewhere"]) < 1.6


def test_the_galerkin_approximation_of_a_flux_and_no_other_is_orthogonal_to_its_error():
    table = measure_statements()
    assert table["galerkin"] < 1e-10 < 1e-4 < table["galerkin_elsewhere"]


def test_the_gaps_that_are_looked_at_are_the_least_on_both_edges_of_a_node():
    """natural: 2 x (1/2 - x)_+^(3/2) on the bottom; at x = 1/4 the least of [1/8, 3/8] is at an end."""
    mesh = make_structured_mesh(square(), 1 / 8)
    smallest_gaps = statements._smallest_gaps(load("natural"), mesh)
    gap = [2 * x * (0.5 - x) ** 1.5 for x in (1 / 8, 3 / 8)]
    assert smallest_gaps[2] == pytest.approx(min(gap))
    assert smallest_gaps[0] == smallest_gaps[1] == 0.0
    assert np.all(smallest_gaps[4:] == 0.0)
