"""The stored study of cost against theory. Nothing is solved here; what claims say of it is judged there.

Triangle inequalities bound how far an unfinished run may be from the discrete solution; work like h^-3 and
the rates of the best approximation bound the price of half an error.
"""

import numpy as np
import pytest
from conftest import config
from conftest import read_stored_table as table_of

from study.experiments.cost import numbers as cost_numbers
from study.experiments.cost import trade
from study.experiments.cost import work_precision_figure as work_precision
from study.experiments.cost.measure import plan_axes
from study.rates import ERROR_NORMS
from unilateral.formulas.formula import parse_real

COST = config("study")["cost"]
AXES = list(COST["axes"])
COARSEST = 1 / 16
RATES = {"h1": 1.0, "hm12": 1.5, "l2": 1.0}
SLACK = {norm: settings["tolerance"] for norm, settings in config("rates")["rates"]["norms"].items()}
"""What a rate may lack."""
ROUNDING = 1e-12


def read_cost_table(name):
    return table_of(f"cost/{name}")


@pytest.mark.parametrize(("name", "axis"), [*zip(AXES, plan_axes(COST), strict=True)])
def test_every_variant_ran_on_every_mesh_that_has_its_cells(name, axis):
    """H = H/h times h; cells of 16 edges need a mesh of a size H/16."""
    ran = np.isfinite(read_cost_table(name)["h"]).values.ravel()
    has = [
        any(np.isclose(variant.H_over_h * parse_real(h, ""), H) for h in COST["h"][variant.scene])
        for variant in axis.variants
        for H in read_cost_table(name)["H"].values
    ]
    np.testing.assert_array_equal(ran, has)
    assert all(has[: len(COST["H"])])  # the base


NOT_ROUNDING = slice(None, 1e-8)
"""Levels from 1 down at which no rounding decides when single precision is refined: see claim 5.G."""


def test_every_level_is_reached_but_in_single_precision():
    """Its unit round-off is 6e-8, amplified by the condition of S."""
    steps = read_cost_table("precision")["steps"]
    assert np.isfinite(steps.sel(precision="float64")).all()
    assert np.isfinite(steps.sel(precision="refined", stop=NOT_ROUNDING)).all()
    assert np.isnan(steps.sel(precision="float32", stop=1e-10)).all()
    assert np.isfinite(steps.sel(precision="float32", stop=1e-2)).all()


@pytest.mark.parametrize("axis", AXES)
def test_no_level_is_claimed_above_its_tolerance_and_a_lower_one_takes_no_fewer_steps(axis):
    """Checks of the bound, which are counted besides, may be fewer."""
    table = read_cost_table(axis)
    met = np.isfinite(table["steps"])
    assert np.array_equal(met, np.isfinite(table["algebraic_bound"]))
    share = (table["algebraic_bound"] / table["h1_discrete"] / table["stop"]).where(met)
    assert float(share.max()) <= 1 + 1e-12
    extra = table["steps"].diff("stop")
    assert (extra.where(np.isfinite(extra), 0) >= 0).all()
    assert ((table["operator_applications"] - table["steps"] - 1).where(met, 1) >= 1).all()


def triangle(table):
    """Whether |error - discrete error| <= bound, in L2 <= bound / lambda_min^{1/2}, everywhere."""
    bound = table["algebraic_bound"]
    discrete = table["h1_discrete"]
    in_L2 = table["l2_discrete"]
    in_h1 = abs(table["h1_error"] - discrete) <= bound + ROUNDING * discrete
    in_l2 = abs(table["l2_error"] - in_L2) <= bound / table["lambda_min"] ** 0.5 + ROUNDING * in_L2
    met = np.isfinite(table["steps"])
    return bool(in_h1.where(met, True).all()) and bool(in_l2.where(met, True).all())


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("name", ["h1_error", "l2_error"])
def test_errors_are_as_far_from_the_discrete_ones_as_the_bound_allows(axis, name):
    """Control: those of level 1 in the place of 1e-8."""
    assert triangle(read_cost_table(axis))
    table = read_cost_table(axis).copy(deep=True)
    table[name].loc[{"stop": 1e-8}] = table[name].sel(stop=1.0).values
    assert not triangle(table)


def test_refinement_takes_the_steps_of_double_precision_and_another_algebra_the_same():
    stored_steps = read_cost_table("precision")["steps"].sel(stop=NOT_ROUNDING)
    double = stored_steps.sel(precision="float64")
    refined = stored_steps.sel(precision="refined")
    assert double.sizes["stop"] >= 9
    assert (abs(double - refined) <= 1 + 1e-3 * double).all()
    steps = read_cost_table("algebra")["steps"]
    met = np.isfinite(steps.sel(algebra="A_3"))
    assert met.sum() >= 10
    assert (steps.sel(algebra="A_3") == steps.sel(algebra="S")).where(met, True).all()


@pytest.mark.parametrize("norm", ERROR_NORMS)
def test_half_an_error_costs_no_more_than_theory_says(norm):
    """Work ~ h^-3 and error ~ h^rate: 2^(3/rate), the rate less its tolerance.

    Control: with the two finest errors as large as those before it would cost more.
    """
    maximum = 2 ** (3 / (RATES[norm] - SLACK[norm]))
    for prices in cost_numbers.prices_by_norm(
        cost_numbers.split_by_case(read_cost_table("case")), 2, COARSEST
    )[norm].values():
        assert 1 < prices.halving <= maximum
        assert prices.over_setup > 1
    row = read_cost_table("case").sel(
        case="thirds", H_over_h=2, stop=0.1, H=read_cost_table("case")["H"] <= COARSEST
    )
    error = trade.relative_errors(row, norm).values.copy()
    error[2:] = error[:2]
    assert trade.halving_factor(row["operations"].values, error) > maximum


@pytest.mark.parametrize("norm", ERROR_NORMS)
def test_the_front_beats_every_run(norm):
    crossed = read_cost_table("algorithm").sel(stop=read_cost_table("algorithm")["stop"] < 1)
    front = work_precision.tabulate_front(read_cost_table("algorithm"), norm)
    work = crossed["operations"].values.ravel()
    error = trade.relative_errors(crossed, norm).values.ravel()
    for w, e in zip(work[np.isfinite(work)], error[np.isfinite(work)], strict=True):
        assert ((front["work"] <= w) & (front["error"] * trade.MAX_FRONT_QUOTIENT <= e)).any()
    assert (np.diff(front["work"]) > 0).all()
    assert (np.diff(front["error"]) < 0).all()


def test_a_ratio_is_best_for_a_case_and_lambda_loses_more_than_u():
    """The rate of lambda over the cells, 3/2 in H^(-1/2), is above that of u over the mesh, 1."""
    missing = cost_numbers.loss_spans(read_cost_table("case"), COARSEST)
    for by_ratio in (spans for by_work in missing.values() for spans in by_work.values()):
        assert min(minimum for minimum, _ in by_ratio.values()) == 1
    for counted in cost_numbers.WORK_TITLES:
        assert missing["hm12"][counted][8.0][0] > missing["h1"][counted][8.0][1]


def test_cheapest_is_met_and_nothing_cheaper_is():
    crossed = read_cost_table("algorithm").sel(
        algorithm="uzawa", stop=read_cost_table("algorithm")["stop"] < 1
    )
    for norm in ERROR_NORMS:
        cheapest_run = trade.cheapest_run(read_cost_table("algorithm"), norm, 0.1)
        assert cheapest_run is not None
        assert cheapest_run["error"] <= 0.1
        good = (trade.relative_errors(crossed, norm) <= 0.1) & (
            crossed["operations"] < cheapest_run["operations"]
        )
        assert not good.any()
    assert trade.cheapest_run(read_cost_table("algorithm"), "h1", 1e-9) is None
