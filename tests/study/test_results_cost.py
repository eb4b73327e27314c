"""The stored study of cost against theory. Nothing is solved here.

Triangle inequalities bound how far an unfinished run may be from the discrete solution; work like h^-3 and
the rates of the best approximation bound the price of half an error.
"""

from functools import cache

import numpy as np
import pytest
import yaml
from conftest import ROOT

from unilateral.study import tables
from unilateral.study.figures import work_precision
from unilateral.study.judge import cost as trade
from unilateral.study.judge.rates import NORMS
from unilateral.study.runs.cost.variants import Variant, plan
from unilateral.study.text import cost_tables

STUDY = yaml.safe_load((ROOT / "workflow/config/study.yaml").read_text())["cost"]
COARSEST = 1 / 16
RATES = {"h1": 1.0, "hm12": 1.5, "l2": 1.0}
JUDGED = yaml.safe_load((ROOT / "workflow/config/rates.yaml").read_text())["rates"]["norms"]
SLACK = {norm: JUDGED[norm]["tolerance"] for norm in NORMS}
"""What a rate may lack."""
ROUNDING = 1e-12


@cache
def stored(name):
    return tables.load(ROOT / "results/cost" / f"{name}.nc")


def of(table, **fields):
    kept = np.logical_and.reduce([table[name].values == value for name, value in fields.items()])
    return table.isel(run=np.flatnonzero(kept))


def test_every_variant_ran_on_every_mesh_that_has_it():
    table = stored("cost")
    runs = {Variant(*fields) for fields in zip(*(table[f].values for f in Variant._fields), strict=True)}
    assert runs == set(plan(STUDY))
    np.testing.assert_allclose(table["H"], table["H_over_h"] * table["h"], rtol=1e-12)
    assert [name for name in table.data_vars if not table[name].attrs.get("units")] == ["case"]


def test_the_table_of_seconds_has_the_same_runs():
    table, timings = stored("cost"), stored("timings")
    for name in (*Variant._fields, "h", "H"):
        np.testing.assert_array_equal(table[name].values, timings[name].values)
    assert np.array_equal(np.isfinite(timings["seconds"]), np.isfinite(table["steps"]))
    S_in_mb = 8 * table["multipliers"].values ** 2 / 2**20
    assert np.all(timings["peak_mb"].values > S_in_mb)


def test_every_run_in_double_precision_with_S_reached_every_level():
    for name in ("float64", "refined"):
        found = of(stored("cost"), algebra="S", precision=name)
        assert found.sizes["run"] >= 5
        assert np.isfinite(found["steps"]).all()


def test_single_precision_ends_above_the_last_level():
    """Its unit round-off is 6e-8, amplified by the condition of S."""
    single = of(stored("cost"), precision="float32")
    assert np.isnan(single["steps"].sel(stop=1e-10)).all()
    assert np.isfinite(single["steps"].sel(stop=1e-2)).all()


def test_no_level_is_claimed_above_its_tolerance():
    table = stored("cost")
    met = np.isfinite(table["steps"])
    assert np.array_equal(met, np.isfinite(table["algebraic_bound"]))
    share = (table["algebraic_bound"] / table["h1_discrete"] / table["stop"]).where(met)
    assert float(share.max()) <= 1 + 1e-12


def triangle(table):
    """Whether |error - discrete error| <= bound, in L2 <= bound / lambda_min^{1/2}, everywhere."""
    bound, discrete, in_L2 = table["algebraic_bound"], table["h1_discrete"], table["l2_discrete"]
    in_h1 = abs(table["h1_error"] - discrete) <= bound + ROUNDING * discrete
    in_l2 = abs(table["l2_error"] - in_L2) <= bound / table["lambda_min"] ** 0.5 + ROUNDING * in_L2
    met = np.isfinite(table["steps"])
    return bool(in_h1.where(met, True).all()) and bool(in_l2.where(met, True).all())


def test_errors_are_as_far_from_the_discrete_ones_as_the_bound_allows():
    assert triangle(stored("cost"))


@pytest.mark.parametrize("name", ["h1_error", "l2_error"])
def test_errors_of_another_level_are_noticed(name):
    """Those of level 1 in the place of 1e-10."""
    table = stored("cost").copy(deep=True)
    table[name].loc[{"stop": 1e-10}] = table[name].sel(stop=1.0).values
    assert not triangle(table)


def test_a_lower_level_takes_no_fewer_steps():
    """Checks of the bound, which are counted besides, may be fewer."""
    more = stored("cost")["steps"].diff("stop")
    assert (more.where(np.isfinite(more), 0) >= 0).all()
    checks = stored("cost")["operator_applications"] - stored("cost")["steps"] - 1
    assert (checks.where(np.isfinite(checks), 1) >= 1).all()


def test_ways_to_S_y_take_the_same_steps():
    steps = stored("algebra")["steps"]
    for name in ("A", "A_3"):
        met = np.isfinite(steps.sel(algebra=name))
        assert met.sum() >= 10
        assert (steps.sel(algebra=name) == steps.sel(algebra="S")).where(met, True).all()


def test_refinement_takes_the_steps_of_double_precision():
    steps = stored("precision")["steps"]
    double, refined = (steps.sel(precision=name) for name in ("float64", "refined"))
    assert (abs(double - refined) <= 1 + 1e-3 * double).all()


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("case", ["natural", "smooth", "thirds"])
def test_half_an_error_costs_no_more_than_theory_says(norm, case):
    """Work ~ h^-3 and error ~ h^rate: 2^(3/rate), the rate less its tolerance."""
    found = cost_tables.prices(cost_tables.by_case(stored("case")), 2, COARSEST)[norm][case]
    assert 1 < found.halving <= 2 ** (3 / (RATES[norm] - SLACK[norm]))


def test_an_error_that_does_not_fall_is_noticed():
    """The two finest errors as large as those before."""
    cases = stored("case").sel(case="thirds", H_over_h=2)
    at = cases.sel(stop=0.1, H=cases["H"] <= COARSEST)
    error = trade.relative(at, "h1").values.copy()
    error[2:] = error[:2]
    assert trade.halving(at["operations"].values, error) > 2 ** (3 / (RATES["h1"] - SLACK["h1"]))


@pytest.mark.parametrize("norm", NORMS)
def test_the_front_beats_every_run(norm):
    crossed = stored("algorithm").sel(stop=stored("algorithm")["stop"] < 1)
    front = work_precision.front(stored("algorithm"), norm)
    work, error = crossed["operations"].values.ravel(), trade.relative(crossed, norm).values.ravel()
    for w, e in zip(work[np.isfinite(work)], error[np.isfinite(work)], strict=True):
        assert ((front["work"] <= w) & (front["error"] * trade.GAIN <= e)).any()
    assert (np.diff(front["work"]) > 0).all()
    assert (np.diff(front["error"]) < 0).all()


def test_advice_names_only_runs_that_were_made():
    cases = stored("case")
    for norm, by_name in cost_tables.prices(cost_tables.by_case(cases), 2, COARSEST).items():
        for name, of in by_name.items():
            at = cases.sel(case=name, H_over_h=2, stop=of.stop)
            assert np.isclose(trade.relative(at, norm), of.error).any()
            assert of.over_setup > 1


def test_a_ratio_is_best_for_a_case_and_lambda_loses_more_than_u():
    """The rate of lambda over the cells, 3/2 in H^(-1/2), is above that of u over the mesh, 1."""
    lost = cost_tables.losses(stored("case"), COARSEST)
    for by_ratio in (spans for by_work in lost.values() for spans in by_work.values()):
        assert min(least for least, _ in by_ratio.values()) == 1
    for counted in cost_tables.COUNTED:
        assert lost["hm12"][counted][8.0][0] > lost["h1"][counted][8.0][1]


def test_cheapest_is_met_and_nothing_cheaper_is():
    crossed = stored("algorithm").sel(algorithm="uzawa", stop=stored("algorithm")["stop"] < 1)
    for norm in NORMS:
        found = trade.cheapest(stored("algorithm"), norm, 0.1)
        assert found is not None
        assert found["error"] <= 0.1
        good = (trade.relative(crossed, norm) <= 0.1) & (crossed["operations"] < found["operations"])
        assert not good.any()
    assert trade.cheapest(stored("algorithm"), "h1", 1e-9) is None


def test_no_number_of_seconds_is_in_a_table_that_is_compared():
    for name in ("cost", "algorithm", "algebra", "case"):
        assert not [each for each in stored(name).data_vars if "seconds" in each or "peak" in each]
