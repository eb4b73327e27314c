"""A sweep against its solves one by one, and how much it computes."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
from conftest import discrete, exact_errors, load

from study.experiments.scenes import measure as module
from study.experiments.scenes.measure import solve_on_partitions
from unilateral.discrete.condensed import discretise, solve_condensed_problem
from unilateral.fem.condense import CondensedMatrix
from unilateral.geometry import partition
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.infsup import infsup_constants
from unilateral.norms.ritz import h1_distance

SQUARE = find_polygon("square")
NAMES = ("natural", "no_contact", "thirds")
CELLS = (2, 4, 8, 16)


def swept(names=NAMES, **options):
    cells = [partition.make_uniform_partition(SQUARE, 1 / m) for m in CELLS]
    cases = [load(name) for name in names]
    return solve_on_partitions(make_structured_mesh(SQUARE, 1 / 8), cases, cells, gram(names), **options)


@cache
def gram(names):
    """The dual norm's forms for the partitions with beta > 0, the two coarser ones."""
    cases = [load(name) for name in names]
    return build_dual_norm(partition.make_uniform_partition(SQUARE, 1 / CELLS[1]), cases).gram(cases)


@pytest.fixture(scope="module")
def tables():
    return swept(H_over_h=(0.5, 2.0))


def test_only_pairs_within_the_limits_are_solved(tables):
    table, timings = tables
    inside = np.array([False, True, True, True])
    for name in ("h1_error", "algebraic_bound", "converged", "balance", "operator_applications"):
        assert np.array_equal(np.isfinite(table[name].values[:, 0]), np.tile(inside, (3, 1))), name
    assert np.array_equal(np.isfinite(timings["seconds"].values[:, 0]), np.tile(inside, (3, 1)))
    assert np.array_equal(table["algorithm"].values[:, 0] != "", np.tile(inside, (3, 1)))
    assert np.array_equal(np.isfinite(table["lambda_min"].values[0]), inside)
    assert np.array_equal(np.isfinite(table["consistency"].values), np.tile(inside, (3, 1)))


def test_without_limits_all_pairs_are_solved():
    assert np.isfinite(swept(("no_contact",))[0]["h1_error"]).all()


def test_a_pair_with_beta_above_0_needs_the_dual_norm():
    cells = [partition.make_uniform_partition(SQUARE, 1 / 4)]
    with pytest.raises(ValueError, match="needs the dual norm"):
        solve_on_partitions(make_structured_mesh(SQUARE, 1 / 8), [load("natural")], cells, None)


def test_the_dual_norm_of_an_error_is_that_of_the_function(tables):
    """By the forms on P0(T_H) and on lambda - Pi_H lambda, and directly for the difference itself."""
    cells = partition.make_uniform_partition(SQUARE, 1 / 4)
    cases = [load(name) for name in NAMES]
    run = tables[0].isel(mesh=0, partition=1)
    for c, case in enumerate(cases):
        lower, upper = build_dual_norm(cells, cases).bound_error(case, run["lambda_H"].values[c, None, :16])
        np.testing.assert_allclose(run["hm12_error_upper"][c], upper[0], rtol=1e-8, atol=1e-14)
        expected = max(lower[0], float(run["discrete_error"][c]))
        np.testing.assert_allclose(run["hm12_error_lower"][c], expected, rtol=1e-8, atol=1e-14)


def test_the_constants_are_those_of_the_pair(tables):
    single_discrete = discrete("natural", 8, 4)
    constants = infsup_constants(single_discrete.spaces.operator, gram(NAMES).p0)
    for name in ("beta_lower", "beta_upper", "beta_0"):
        assert float(tables[0][name][0, 1]) == pytest.approx(getattr(constants, name), rel=1e-9)
        assert np.all(tables[0][name].values[0, 2:] == 0)


@pytest.mark.parametrize(("c", "name"), list(enumerate(NAMES)))
@pytest.mark.parametrize(("k", "m"), [(1, 4), (2, 8)])
def test_a_run_is_the_solve_of_its_case_mesh_and_partition(tables, c, name, k, m):
    """The same arithmetic, so the same numbers: rtol leaves room for the order of sums only."""
    single_discrete = discrete(name, 8, m)
    beta = infsup_constants(single_discrete.spaces.operator, gram(NAMES).p0).beta_lower if k == 1 else 0.0
    solution = solve_condensed_problem(single_discrete, beta=beta)
    errors = exact_errors(single_discrete, solution)
    values = {
        "h1_error": errors.h1,
        "discrete_error": errors.hm12_discrete,
        "l2_error": errors.l2,
        "tolerance": solution.tolerance,
        "ritz_means": single_discrete.exact.ritz_means_norm(single_discrete.spaces),
    }
    run = tables[0].isel(case=c, mesh=0, partition=k)
    for variable, value in values.items():
        np.testing.assert_allclose(run[variable], value, rtol=1e-9, err_msg=variable)
    for variable in ("iterations", "operator_applications", "converged", "algorithm"):
        expected = getattr(solution.result, variable)
        computed = run[variable].item()
        assert computed == expected or (np.isnan(computed) and np.isnan(expected)), variable
    np.testing.assert_allclose(run["lambda_H"][: 4 * m], solution.lambda_H, rtol=1e-9, atol=1e-12)
    assert np.isnan(run["lambda_H"][4 * m :]).all()
    for name in ("ritz_error", "ritz_boundary_error"):
        assert float(run[name]) == pytest.approx(getattr(single_discrete.exact.ritz, name), rel=1e-9)
    assert float(run["projection_error"]) == pytest.approx(
        single_discrete.exact.cell_means.projection_error, rel=1e-12
    )


@pytest.mark.parametrize("name", ["clamped", "clamped_90"])
def test_beside_a_clamped_side_a_run_is_the_solve_of_its_problem(name):
    """With its form, in beta and in the dual norm, too: c is 0 in one of the cases."""
    case = load(name)
    mesh = make_structured_mesh(SQUARE, 1 / 8)
    cells = partition.make_uniform_partition(SQUARE, 1 / 4)
    norm = build_dual_norm(cells, [case])
    table, _ = solve_on_partitions(mesh, [case], [cells], norm.gram([case]))
    single = discretise(case.problem, mesh, cells)
    chosen = np.flatnonzero(cells.side != case.clamped_sides[0])
    beta = infsup_constants(single.spaces.operator, build_dual_norm(cells, form=single.form).gram().p0)
    solution = solve_condensed_problem(single, beta=beta.beta_lower)
    run = table.isel(case=0, mesh=0, partition=0)
    lower, upper = norm.bound_error(case, solution.lambda_H[None])
    errors = exact_errors(single, solution)
    values = {
        "h1_error": h1_distance(case, mesh, solution.u_h),
        "discrete_error": errors.hm12_discrete,
        "hm12_error_lower": max(lower[0], errors.hm12_discrete),
        "hm12_error_upper": upper[0],
        "beta_lower": beta.beta_lower,
        "multipliers": 12,
    }
    for variable, value in values.items():
        np.testing.assert_allclose(run[variable], value, rtol=1e-4, err_msg=variable)
    np.testing.assert_allclose(run["lambda_H"][:12], solution.lambda_H[chosen], rtol=1e-9, atol=1e-12)
    assert not np.any(solution.lambda_H[cells.side == case.clamped_sides[0]])


@pytest.mark.parametrize("k", [2, 3])
def test_where_beta_is_0_the_active_set_ran_and_lambda_has_no_error(tables, k):
    """H = h, and more cells than boundary nodes."""
    runs = tables[0].isel(mesh=0, partition=k)
    assert np.all(runs["algorithm"] == "active_set")
    assert np.isnan(runs[["discrete_error", "l2_error", "iterations"]].to_array()).all()
    assert np.isfinite(runs["h1_error"]).all()
    assert np.all(runs["converged"] == 1)


def test_the_coordinates_are_sizes_and_unknowns_of_meshes_and_partitions(tables):
    """By counting: 9^2 nodes for h = 1/8, 32 of them on the boundary, and m cells on each of four sides."""
    for table in tables:
        assert list(table["case"].values) == list(NAMES)
        np.testing.assert_allclose(table["H"], 1 / np.array(CELLS), rtol=1e-14)
        np.testing.assert_allclose(table["h"], [1 / 8], rtol=1e-14)
    table = tables[0]
    np.testing.assert_allclose(table["h_over_H"], [np.array(CELLS) / 8], rtol=1e-14)
    np.testing.assert_allclose(table["diameter"], [np.sqrt(2) / 8], rtol=1e-14)
    assert table["unknowns"].values.tolist() == [81]
    assert table["boundary_unknowns"].values.tolist() == [32]
    assert table["multipliers"].values.tolist() == [4 * m for m in CELLS]


def test_one_factorisation_for_all_and_one_operator_for_each_partition(monkeypatch):
    """The mesh is condensed once, all cases put on it once, and only pairs that are solved are coupled.

    There are two solves on all nodes for all cases, for z_h and quadrature's error, and one for each
    solution, u_h. Without contact the bound is rounding, and one more tells what that left of the residual.
    """
    counts = Counter()

    def counting(module, name, called):
        function = getattr(module, name)

        def call_and_count(*arguments):
            counts[called] += 1
            return function(*arguments)

        monkeypatch.setattr(module, name, call_and_count)

    for name in ("condense", "ritz_projections", "cell_means", "mixed_spaces", "solve_condensed_problem"):
        counting(module, name, name)
    counting(CondensedMatrix, "solve", "on all nodes")
    swept(("natural", "no_contact"), H_over_h=(2.0, 4.0))
    expected = {
        "condense": 1,
        "ritz_projections": 1,
        "cell_means": 4,
        "mixed_spaces": 2,
        "solve_condensed_problem": 4,
    }
    assert counts == expected | {"on all nodes": 2 + 4 + 2}
