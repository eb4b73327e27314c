"""Uniform meshes beside adapted ones: levels on a tiny configuration, rates and tables by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from conftest import exact_errors, load
from numpy.testing import assert_allclose

import unilateral as ul
from study.experiments.adaptive import measure as adaptive
from study.experiments.adaptive import numbers as adaptive_tables
from unilateral.discrete.condensed import discretise
from unilateral.fem.condense import condense
from unilateral.fem.form import H1
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.infsup import infsup_constants
from unilateral.solvers.stop import Stop

LIMITS = adaptive.MaxUnknowns(100, 50)
STOP = Stop(fraction=0.01)


@pytest.fixture(scope="module")
def tables_of_thirds():
    """Of `thirds` from h = 1/4 on, 25 unknowns: errors, constants, timings."""
    return adaptive.measure(load("thirds").problem, 1 / 4, LIMITS, STOP)


def test_both_kinds_start_from_one_mesh_and_keep_the_limit(tables_of_thirds):
    """Nodes of a structured mesh: (n + 1)^2. On uniform meshes every edge is halved."""
    unknowns = tables_of_thirds[0]["unknowns"]
    uniform_unknowns = unknowns.sel(kind="uniform").dropna("level").values
    assert uniform_unknowns.tolist() == [25, 81]
    adapted_unknowns = unknowns.sel(kind="adapted").dropna("level").values
    assert adapted_unknowns[0] == 25
    assert np.all(np.diff(adapted_unknowns) > 0)
    assert adapted_unknowns[-1] <= LIMITS.unknowns
    assert len(adapted_unknowns) > 3
    uniform = tables_of_thirds[0].sel(kind="uniform").isel(level=[0, 1])
    assert uniform["shortest_edge"].values.tolist() == [0.25, 0.125]
    assert_allclose(uniform["diameter"], np.sqrt(2) * uniform["shortest_edge"], rtol=1e-12)
    assert uniform["multipliers"].values.tolist() == [8, 16]


def test_errors_are_those_of_the_condensed_problem_and_below_their_bounds(tables_of_thirds):
    """On the finer uniform mesh, by active sets on the boundary; quadrature agrees to its accuracy."""
    errors = tables_of_thirds[0]
    case = load("thirds")
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = make_uniform_partition(square(), 1 / 4)
    single = discretise(case.problem, mesh, cells)
    solved = single.solve(Stop(tolerance=1e-12, algorithm="active_set"))
    row = errors.sel(kind="uniform").isel(level=1)
    assert float(row["h1_error"]) == pytest.approx(exact_errors(single, solved).h1, rel=1e-3)
    expected = errors["h1_error"].notnull()
    assert np.all((errors["h1_bound"] >= errors["h1_error"]).where(expected, True))
    assert np.all((errors["algebraic_bound"] <= 0.01 * errors["h1_bound"]).where(expected, True))
    assert float(errors["asymptotic_from"]) == 32**2


def test_the_interval_of_the_force_is_that_of_users_on_adapted_meshes(tables_of_thirds):
    """On the first one, which is structured."""
    half_width = tables_of_thirds[0]["force_half_width"]
    force = ul.solve(load("thirds").problem, h=1 / 4, H=1 / 2).force(sharp=True)
    first = half_width.sel(kind="adapted").isel(level=0)
    assert float(first) == pytest.approx(0.5 * (force.upper - force.lower), rel=0.02)
    assert half_width.sel(kind="uniform").isnull().all()


def test_beta_is_measured_on_adapted_meshes_up_to_its_limit(tables_of_thirds):
    errors, constants, _ = tables_of_thirds
    small = (errors["unknowns"] <= LIMITS.of_beta) & (errors["kind"] == "adapted")
    assert np.array_equal(constants["beta_lower"].notnull(), small)
    assert np.all((constants["cell_over_edge"] > 2 - 1e-9).where(small, True))


def test_one_gram_matrix_serves_the_cells_and_their_edges():
    """Control: the cells' own, from another reference mesh, within the half percent of its bounds.

    At H = h, with an even number of edges, beta is 0.
    """
    mesh = make_structured_mesh(square(), 1 / 4)
    cells = make_uniform_partition(square(), 1 / 2)
    beta_constants = adaptive.beta_constants(SimpleNamespace(mesh=mesh, partition=cells, form=H1))
    spaces = mixed_spaces(condense(mesh), cells)
    original = infsup_constants(spaces.operator, build_dual_norm(cells).gram().p0)
    assert beta_constants["beta_lower"] == pytest.approx(original.beta_lower, rel=5e-3)
    assert beta_constants["beta_lower"] <= original.beta_upper
    assert beta_constants["beta_of_edges"] == 0
    # beta_0^2 H is lambda_min(S) by its definition
    assert beta_constants["shortest_cell"] == pytest.approx(cells.H, rel=1e-12)
    assert beta_constants["lambda_min"] == pytest.approx(beta_constants["beta_0"] ** 2 * cells.H, rel=1e-12)
    assert beta_constants["lambda_max"] == pytest.approx(spaces.operator.lambda_max, rel=1e-12)


def test_spent_seconds_never_fall_from_level_to_level(tables_of_thirds):
    """So they never fall; how many there are depends on the machine."""
    spent = tables_of_thirds[2]["spent_seconds"]
    assert np.array_equal(spent.notnull(), tables_of_thirds[0]["unknowns"].notnull())
    for kind in spent["kind"].values:
        assert np.all(np.diff(spent.sel(kind=kind).dropna("level").values) >= 0)


def test_a_problem_of_ones_own_has_bounds_and_no_errors(problem_of):
    """On a triangle, by gmsh; two edges in every cell."""
    problem = problem_of(polygon="[[0, 0], [1, 0], [0, 1]]", f="3*x - 2", g="0")
    errors, constants, _ = adaptive.measure(problem, 1 / 4, adaptive.MaxUnknowns(60, 30), STOP)
    assert errors["h1_error"].isnull().all()
    assert np.isnan(float(errors["asymptotic_from"]))
    bounds = errors["h1_bound"].sel(kind="adapted").dropna("level").values
    assert bounds[-1] < bounds[0]
    assert float(constants["edges_per_cell"].min()) == 2


def test_joined_tables_have_all_cases_and_nan_beyond_the_last_level(tables_of_thirds):
    errors = tables_of_thirds[0]
    join_tables = adaptive.join_tables([errors, errors.isel(level=[0, 1])], "case", ["a", "b"])
    assert join_tables["case"].values.tolist() == ["a", "b"]
    assert join_tables.sizes["level"] == errors.sizes["level"]
    assert join_tables["unknowns"].sel(case="b").isel(level=slice(2, None)).isnull().all()


def levels(unknowns, error, bound, start):
    """A table of one case, the same on both kinds of meshes but for its length."""
    order = ("case", "kind", "level")
    shape = (1, 2, len(unknowns))
    values = {"unknowns": unknowns, "h1_error": error, "h1_bound": bound, "algebraic_bound": 0.01 * error}
    table = {name: (order, np.broadcast_to(value, shape).copy()) for name, value in values.items()}
    table |= {name: table["h1_error"] for name in ("multipliers", "diameter", "shortest_edge")}
    table["asymptotic_from"] = ("case", [start])
    return xr.Dataset(table, {"case": ["c"], "kind": ["uniform", "adapted"], "level": range(len(unknowns))})


N = np.array([10.0, 20.0, 40.0, 100.0, np.nan])


def test_a_rate_leads_to_the_first_level_with_so_many_times_the_unknowns():
    """From 10 to 40, from 20 to 100, and no further; the error is N^-1/2, but 4 times that at 40."""
    error = N**-0.5 * [1, 1, 4, 1, 1]
    row = adaptive.rates_in_unknowns(levels(N, error, 2 * N**-0.25, 20), 3).isel(case=0, kind=0)
    assert_allclose(row["error_rate"], [np.nan, 0.5, np.nan, np.nan, np.nan])
    assert_allclose(row["bound_rate"], [0.25, 0.25, np.nan, np.nan, np.nan])
    assert row["asymptotic"].values.tolist() == [0, 1, 1, 1, 0]
    assert_allclose(row["index"], 2 * N**-0.25 / error)
    assert_allclose(row["share"].dropna("level"), 0.01)
    every = adaptive.rates_in_unknowns(levels(N, error, error, 0), 3).isel(case=0, kind=0)["error_rate"]
    assert_allclose(every[:2], [0.5 - 1, 0.5])


def test_no_level_is_asymptotic_in_a_case_without_a_start():
    row = adaptive.rates_in_unknowns(levels(N, N * np.nan, 1 / N, np.nan), 3).isel(case=0, kind=0)
    assert not row["asymptotic"].any()
    assert row["error_rate"].isnull().all()
    assert_allclose(row["bound_rate"][:2], [1, 1])


def test_the_table_has_the_finest_level_of_each_kind():
    errors = levels(N, N**-0.5, 2 * N**-0.5, 10)
    errors["unknowns"][0, 0, 3] = np.nan
    rows = adaptive_tables.tabulate_finest_levels(errors.merge(adaptive.rates_in_unknowns(errors, 3)))
    assert rows["problem"].tolist() == ["`c`"] * 2
    assert rows["meshes"].tolist() == ["uniform", "adapted"]
    assert rows["unknowns"].tolist() == ["40", "100"]
    assert rows["bound"].tolist() == ["0.317", "0.201"]  # above 10^-0.5, and above the double 0.2
    assert rows["bound / error"].tolist() == ["2.00", "2.00"]
    assert rows["rate, error"].tolist() == ["0.50", "0.50"]
    unknown = levels(N, N * np.nan, 1 / N, np.nan)
    rows = adaptive_tables.tabulate_finest_levels(unknown.merge(adaptive.rates_in_unknowns(unknown, 3)))
    assert set(rows[r"$\Vert u-u_h\Vert_1$"]) == {"–"}


def test_savings_are_those_at_the_bound_of_the_finest_uniform_mesh():
    """Its bound, 0.5, is met with 20 unknowns; it has 100. In all these are 30 and 170."""
    errors = levels(N, 1 / N, 1 / N, 10)
    errors["h1_bound"][0, :] = [[9, 9, 9, 0.5, np.nan], [1, 0.5, 0.4, 0.1, np.nan]]
    rows = adaptive_tables.tabulate_savings(errors)
    assert rows.values.tolist() == [["`c`", "0.5", "100", "20", "5.0", "5.7"]]


def test_the_least_beta_of_flat_meshes_is_apart_from_that_of_others():
    betas = {"beta_lower": [0.8, 0.7, 0.5], "beta_upper": [0.81, 0.71, 0.51], "smallest_angle": [45, 20, 19]}
    betas |= {"beta_of_edges": [0, 0.02, 0.01], "beta_0": [0.3, 0.2, 0.4]}
    betas |= {"lambda_min": [0.5, 0.1, 0.25], "lambda_max": [1, 1, 1], "shortest_cell": [0.25, 0.5, 1]}
    constants = xr.Dataset({name: ("level", np.array(values)) for name, values in betas.items()})
    adapted_beta = adaptive_tables.summarise_adapted_beta(constants, 20)
    # a factor of e takes 10/2 - 1 steps at least
    uzawa = {"shortest_cell": 0.25, "steps": 4}
    assert adapted_beta == {"beta": 0.7, "flat": 0.51, "angle": 19, "of_edges": 0.02, "beta_0": 0.2, **uzawa}
