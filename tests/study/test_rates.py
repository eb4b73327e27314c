"""The judge itself: on made-up tables whose rates are known, and spoilt ones that it must refuse."""

from dataclasses import replace

import numpy as np
import pytest
import sentences
import xarray as xr

from study.rates import Expectation, judge_errors, smallest_rate, summarise_rates, tabulate_judgements
from unilateral.errors import InputError

UNFIT = "algebraic error is above"
LEVELS = 0.5 ** np.arange(3, 9)
H1 = Expectation(
    proved=1,
    rate=1.0,
    tolerance=0.03,
    start=1 / 8,
    factor=2,
    reference="interpolation_error",
    power=0,
    bound=2,
    algebraic_share=0.01,
    judged_ratio=1 / 2,
)


def table(power=1.0, **changes):
    """Errors 3 h^power along H = 2h, all else as it should be."""
    n = len(LEVELS)
    grid = np.full((1, n, n), np.nan)
    error = grid.copy()
    algebraic = grid.copy()
    converged = grid.copy()
    i = np.arange(n)
    error[0, i, i] = 3 * LEVELS**power
    algebraic[0, i, i] = 1e-3 * error[0, i, i]
    converged[0, i, i] = 1.0
    run = ("case", "mesh", "partition")
    table = xr.Dataset(
        {
            "h1_error": (run, error),
            "hm12_error_lower": (run, error),
            "hm12_error_upper": (run, error.copy()),
            "l2_error": (run, error),
            "algebraic_bound": (run, algebraic),
            "converged": (run, converged),
            "u_norm": (("case", "mesh"), np.ones((1, n))),
            "interpolation_error": (("case", "mesh"), 2 * LEVELS[None]),
            "projection_error": (("case", "partition"), 2 * LEVELS[None]),
            "lambda_min": (("mesh", "partition"), np.ones((n, n))),
            "beta_lower": (("mesh", "partition"), np.ones((n, n))),
        },
        coords={
            "case": ["made_up"],
            "h": ("mesh", LEVELS),
            "H": ("partition", 2 * LEVELS),
            "h_over_H": (("mesh", "partition"), LEVELS[:, None] / (2 * LEVELS)[None]),
        },
    )
    for name, (index, value) in changes.items():
        table[name].values[(0, *index)] = value
    return table


def judge_table(table, norm="h1", expected=H1):
    return judge_errors(table, "made_up", norm, 0.5, expected)


def change_expectation(**fields):
    return replace(H1, **fields)


def test_an_exact_power_is_observed_on_every_pair():
    verdict = judge_table(table(1.0))
    assert verdict.verdict == "holds"
    np.testing.assert_allclose(verdict.rate, 1.0, rtol=1e-12)
    assert verdict.fitted == pytest.approx(1.0, rel=1e-12)
    assert len(verdict.rate) == 5
    assert verdict.bound == pytest.approx(2 * 2 * LEVELS[-1])


def test_rates_are_observed_between_sizes_a_factor_of_four_apart():
    verdict = judge_table(table(1.0), expected=change_expectation(factor=4))
    np.testing.assert_allclose(verdict.h_coarse / verdict.h_fine, 4)
    assert len(verdict.rate) == 4


EARLY = table(h1_error=((0, 0), 3 * LEVELS[1]))
ALL = (slice(None), slice(None))
VERDICTS = {
    "as expected": (table(), H1, "holds", ""),
    "better": (table(1.5), H1, "holds", ""),
    "slow": (table(0.9), H1, "fails", "is below 0.970"),
    "one slow pair": (table(h1_error=((2, 2), 1.05 * 3 * LEVELS[2])), H1, "fails", "is below 0.970"),
    "slower than expected": (table(1.2), change_expectation(rate=1.5), "fails", "is below 1.470"),
    "bound": (table(), change_expectation(bound=1.4), "fails", "is above its bound"),
    "too few levels": (table(), change_expectation(start=1 / 64), "fails", "fewer than 3 pairs"),
    "slow early": (EARLY, H1, "fails", "is below 0.970"),
    "slow before levels count": (EARLY, change_expectation(start=1 / 16), "holds", ""),
    "unconverged": (table(converged=((4, 4), 0.0)), H1, "not judged", "did not converge"),
    "slow and unconverged": (table(0.9, converged=((4, 4), 0.0)), H1, "not judged", "did not converge"),
    "algebraic": (table(algebraic_bound=((3, 3), 0.011 * 3 * LEVELS[3])), H1, "not judged", UNFIT),
    "no algebraic bound": (table(algebraic_bound=((3, 3), np.nan)), H1, "not judged", UNFIT),
    "no finest error": (table(h1_error=((5, 5), np.nan)), H1, "not judged", UNFIT),
    "zero": (table(h1_error=(ALL, 1e-13)), change_expectation(rate="exact"), "exact", ""),
    "no zero": (
        table(h1_error=(ALL, 1e-11)),
        change_expectation(rate="exact"),
        "fails",
        "the error should be 0",
    ),
}


@pytest.mark.parametrize(("rate", "expected", "verdict", "reason"), VERDICTS.values(), ids=VERDICTS)
def test_the_verdict_compares_observed_and_expected_rates_and_gives_reasons(rate, expected, verdict, reason):
    """With its reasons, and without any where there are none: what rests on bad runs is not judged."""
    judgement = judge_table(rate, expected=expected)
    assert judgement.verdict == verdict
    assert any(reason in why for why in judgement.reasons) if reason else judgement.reasons == ()


def test_where_nothing_is_judged_no_level_counts():
    """Not even of a table that would fail; its rates are still there to be looked at."""
    verdict = judge_table(table(0.5), expected=change_expectation(rate="none"))
    assert verdict.verdict == "not judged"
    assert not verdict.asymptotic.any()
    assert np.isnan(verdict.fitted)
    np.testing.assert_allclose(verdict.rate, 0.5, rtol=1e-12)


def test_a_coarse_partition_is_not_asymptotic_either():
    """With H = 4h a level counts one halving of h later than with H = 2h."""
    errors = table()
    errors["H"] = 2 * errors["H"]
    errors["h_over_H"] = errors["h_over_H"] / 2
    judgement = judge_errors(errors, "made_up", "h1", 0.25, change_expectation(start=1 / 8))
    assert list(judgement.asymptotic) == [False, True, True, True, True]


def make_bounded_errors(**factors):
    """Errors in H^{-1/2} between bounds 1/2 and (7/4)^{1/2} of them, whose r.m.s. mean they are."""
    errors = table()
    errors["hm12_error_lower"] *= 0.5
    errors["hm12_error_upper"] *= 1.75**0.5
    for name, factor in factors.items():
        errors[name] *= factor
    return errors


BOUNDED = {
    "both met": (make_bounded_errors(), 2, ""),
    "finest error": (make_bounded_errors(), 1.9, "is above its bound"),
    "share met": (make_bounded_errors(algebraic_bound=4.9), 2, ""),
    "share": (make_bounded_errors(algebraic_bound=5.1), 2, UNFIT),
    "no bound": (table(interpolation_error=((5,), np.nan)), 2, "is above its bound"),
}


@pytest.mark.parametrize(("errors", "bound", "reason"), BOUNDED.values(), ids=BOUNDED)
def test_each_of_the_bounds_of_an_error_is_on_its_unfavourable_side(errors, bound, reason):
    """The finest error is up to 3 (7/4)^{1/2} = 3.97 times h, where 2 h times `bound` is allowed.

    A hundredth of its lower bound is 5 times the algebraic error, 1e-3 of the mean.
    """
    judgement = judge_table(errors, "hm12", change_expectation(bound=bound))
    assert judgement.verdict == {"": "holds", UNFIT: "not judged"}.get(reason, "fails")
    assert reason in str(judgement)
    np.testing.assert_allclose(judgement.rate, 1.0, rtol=1e-12)


def test_the_bound_on_the_finest_level_may_have_a_power_of_H():
    """2 H^{1/2} times the reference 2 h, with H = 2h."""
    bound = judge_table(table(), expected=change_expectation(power=0.5)).bound
    assert bound == pytest.approx(4 * LEVELS[-1] * (2 * LEVELS[-1]) ** 0.5, rel=1e-14)


def test_an_error_that_vanishes_leaves_no_fit():
    assert np.isnan(judge_table(table(h1_error=((2, 2), 0.0))).fitted)


@pytest.mark.parametrize(("norm", "factor"), [("hm12", 0.05), ("l2", 1e-2)])
def test_the_algebraic_share_is_taken_in_the_norm_that_is_judged(norm, factor):
    """A bound in ||.||_{-1/2,h} is worth 1/beta as much in H^{-1/2}, lambda_min^{-1/2} as much in L2."""
    errors = table(1.0)
    errors["lambda_min"][:] = 1e-4
    errors["beta_lower"][:] = 0.05
    errors["algebraic_bound"] *= 10 * factor * 0.99
    assert judge_table(errors, norm).verdict == "holds"
    errors["algebraic_bound"] *= 1.02
    assert judge_table(errors, norm).verdict == "not judged"


def test_an_exact_zero_is_one_of_the_upper_bound_relative_to_u():
    small = {"hm12_error_lower": (ALL, 1e-13), "hm12_error_upper": (ALL, 1e-11)}
    assert judge_table(table(**small), "hm12", change_expectation(rate="exact")).verdict == "fails"
    large = table(**small, u_norm=((slice(None),), 100.0))
    assert judge_table(large, "hm12", change_expectation(rate="exact")).verdict == "exact"


@pytest.mark.parametrize("rate", [1.0, "exact"])
def test_no_run_at_a_ratio_fails(rate):
    assert judge_errors(table(), "made_up", "h1", 1 / 3, change_expectation(rate=rate)).verdict == "fails"


def test_the_collected_table_tells_what_was_judged():
    judgements = tabulate_judgements(
        {("made_up", "h1", 0.5): judge_table(table(0.9)), ("made_up", "h1", 0.25): judge_table(table())}, 0.5
    )
    row = judgements.sel(case="made_up", norm="h1")
    assert row["verdict"].sel(h_over_H=0.5).item() == "fails"
    assert row["verdict"].sel(h_over_H=0.25).item() == "not judged"
    assert smallest_rate(row.sel(h_over_H=0.5)) == pytest.approx(0.9)
    assert "is below 0.970" in summarise_rates(judgements, 0.5)


def test_the_collected_table_has_what_was_observed_and_expected():
    """Errors 3 h, 3 h^{3/2}; what was not judged has no reasons, and a pair that there is not no rate."""
    few = judge_table(table(0.5), expected=change_expectation(proved=0.5, rate=0.75, factor=4))
    exact = judge_table(table(), expected=change_expectation(rate="exact"))
    ratios = {0.5: few, 0.25: judge_table(table(1.5)), 1.0: exact}
    judgements = tabulate_judgements(
        {("made_up", "h1", ratio): record for ratio, record in ratios.items()}, 0.25
    )
    row = judgements.sel(case="made_up", norm="h1")
    np.testing.assert_allclose(row["finest_error"], 3 * LEVELS[-1] ** np.array([1.5, 0.5, 1]), rtol=1e-12)
    np.testing.assert_allclose(row["fitted"], [1.5, 0.5, np.nan], rtol=1e-12)
    assert row["proved"].values.tolist() == [1, 0.5, 1]
    np.testing.assert_equal(row["expected"].values, [1, 0.75, np.nan])
    assert row["why"].values.tolist() == ["", "", ""]
    assert np.isfinite(row["rate"]).sum("pair").values.tolist() == [5, 4, 0]


@pytest.mark.parametrize(("ratio", "levels"), [(1 / 2, 5), (1, 4), (1 / 8, 5)])
def test_a_level_counts_from_an_H_on_that_the_judged_ratio_gives(ratio, levels):
    """H = 2h and h from 1/8 on, where levels start."""
    assert judge_table(table(), expected=change_expectation(judged_ratio=ratio)).asymptotic.sum() == levels


def test_the_smallest_rate_is_of_asymptotic_pairs():
    table = xr.Dataset({"rate": ("pair", [0.1, 1.5, 1.2]), "asymptotic": ("pair", [0.0, 1.0, 1.0])})
    assert smallest_rate(table) == 1.2
    assert np.isnan(smallest_rate(table.isel(pair=[0])))


def test_what_is_expected_is_as_declared():
    general = {
        "proved": "1/2",
        "tolerance": 0.1,
        "bound": {"reference": "x", "factor": 3, "power_of_H": "1/4"},
    }
    study = {
        "algebraic_share": 0.01,
        "judged_ratio": "1/3",
        "norms": {"l2": general, "h1": general | {"bound": {"reference": "x", "factor": 3}}},
        "cases": {"made_up": {"l2": {"rate": "3/4"}, "h1": {"rate": "exact"}}},
    }
    general["ritz_bound"] = {"reference": "y", "factor": 4, "power_of_H": "-1/2"}
    levels = {"l2": {"from": "1/8", "factor": 4}, "h1": {"from": "1/16"}}
    expected = Expectation(0.5, 0.75, 0.1, 1 / 8, 4, "x", 0.25, 3, 0.01, 1 / 3)
    assert Expectation.read(study, "made_up", "l2", levels) == expected
    expected = Expectation(0.5, "exact", 0.1, 1 / 16, 2, "x", 0, 3, 0.01, 1 / 3)
    assert Expectation.read(study, "made_up", "h1", levels) == expected
    study["cases"]["made_up"]["l2"]["judged_by"] = "ritz_bound"
    expected = Expectation(0.5, 0.75, 0.1, 1 / 8, 4, "y", -0.5, 4, 0.01, 1 / 3)
    assert Expectation.read(study, "made_up", "l2", levels) == expected


def test_a_case_without_expected_rates_is_named():
    with sentences.raises(InputError):
        Expectation.read({"cases": {}, "norms": {}}, "made_up", "h1", {})
