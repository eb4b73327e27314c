"""The checks of the ledger on made-up tables: every branch and filter of theirs is taken, by hand.

The controls of the ledger spoil the study's own tables; here numbers are so few that the finding is known.
"""

import math

import numpy as np
import pytest
import xarray as xr

from unilateral.geometry.polygon import named, square
from unilateral.study.judge.checks import algorithm, cost, estimates, evidence, extremes, rates, stability
from unilateral.study.judge.checks.evidence import Unjudged

NAN, INF = math.nan, math.inf
RUN = ("case", "mesh", "partition")
PAIRS = ("mesh", "partition")


def table(variables, **coordinates):
    """One table by the names under which checks ask for it."""
    made = xr.Dataset(
        {name: (dims, values) for name, (dims, values) in variables.items()}, coords=coordinates
    )
    return dict.fromkeys(
        (
            "table",
            "a/errors",
            "a/rates",
            "a/dual_norm",
            "a/infsup",
            "cost/algorithm",
            "cost/case",
            "cost/algebra",
        ),
        made,
    )


def test_the_worst_of_nothing_or_of_what_is_not_known_is_not_judged():
    with pytest.raises(Unjudged, match="there is nothing of which to find the gap"):
        evidence.worst({}, "the gap", 0.0, True)
    with pytest.raises(Unjudged, match="the gap is not known of b; c"):
        evidence.worst({"a": 1.0, "b": NAN, "c": NAN, "d": INF}, "the gap", 0.0, True)
    assert evidence.worst({"a": 1.0, "b": INF}, "", 0.0, False).observed == INF
    assert evidence.worst({"a": 1.0, "b": 2.0}, "", 0.0, True).observed == 1
    assert evidence.worst({"a": 1.0, "b": 2.0}, "", 0.0, False).observed == 2


def number(observed):
    """That has to be 1 at least."""
    return evidence.worst({"a": observed}, "", 1.0, True)


def test_of_a_statement_in_parts_the_first_that_fails_is_told():
    parts = [number(observed) for observed in (3.0, 2.0, 0.5, 0.25)]
    assert evidence.all_of(*parts) is parts[2]
    assert evidence.all_of(*parts[:2]) is parts[0]


def test_faults_are_a_verdict_of_their_own_only_where_the_number_would_pass():
    assert evidence.provided(number(0.5), ["fault"]).observed == 0.5
    assert evidence.provided(number(1.0), []).holds
    with pytest.raises(Unjudged, match=r"^one fault; another$"):
        evidence.provided(number(1.0), ["one fault", "another"])


def test_values_along_a_ratio_are_those_of_the_pairs_with_it():
    """h = 1/2, 1/4, 1/8 and H = 1, 5/8, 1/2: H = 2h at (0, 0) and (1, 2), and nearly so elsewhere."""
    h, H = np.array([1 / 2, 1 / 4, 1 / 8]), np.array([1, 5 / 8, 1 / 2])
    of = {
        "x": (PAIRS, np.arange(9).reshape(3, 3)),
        "y": ("partition", H),
        "h_over_H": (PAIRS, h[:, None] / H),
    }
    assert evidence.along_ratio(table(of)["table"], "x", 2).tolist() == [0, 5]
    assert evidence.along_ratio(table(of)["table"], "y", 2).tolist() == [1, 1 / 2]


# The algorithm


def distances(meant, printed, clipless):
    """Of two steps, half and twice the limit."""
    values = np.array([[meant, printed, clipless]])
    names = ["as meant", "as printed", "without the clip"]
    return table(
        {"distance": (("case", "variant", "rho_share"), values)},
        case=["c"],
        variant=names,
        rho_share=[0.5, 2.0],
    )


@pytest.mark.parametrize(
    ("distance", "observed", "holds"),
    [
        ([0.5, 3.0], 0.5, True),
        ([0.01, 3.0], 0.01, False),
        ([0.5, 11.0], 11.0, False),
        ([0.5, INF], INF, False),
    ],
)
def test_a_cycle_is_neither_a_limit_nor_unbounded(distance, observed, holds):
    """Between 0.1 and 10: the smallest distance counts, but the largest if it is above."""
    of = distances(distance, [1, 1], [1, 1])
    made = algorithm.cycle(of, "table", ["c"], [0.5, 2.0], 0.1, 10.0)
    assert (made.observed, made.holds) == (observed, holds)


@pytest.mark.parametrize(("printed", "observed", "holds"), [(2.0, 500.0, True), (2.01, 2.01, False)])
def test_the_printed_index_has_to_converge_below_half_the_limit(printed, observed, holds):
    """Up to a factor of 2 of the distance as meant, 1; above the quotient is 1000/2."""
    of = distances([1.0, 2.0], [printed, 1000.0], [1, 1])
    made = algorithm.printed_index(of, "table", ["c"], 0.5, 2.0, 1.0)
    assert (made.observed, made.holds) == (observed, holds)


def test_the_clip_is_told_by_the_distance_without_it():
    made = algorithm.clip(distances([1, 0.02], [1, 1], [1, 2.0]), "table", "c", 2.0, 1.0)
    assert (made.observed, made.at_least) == (100, True)


@pytest.mark.parametrize(("below", "holds"), [(5e-4, True), (2e-3, False), (-1e-14, True), (-1e-4, False)])
def test_an_eigenvalue_above_the_steklov_bound_is_no_small_distance(below, holds):
    """lambda_max(S) = (1 - below)/sigma_1 with sqrt(2) sigma_1 = tanh(1/sqrt(8)), on the finer mesh."""
    largest = math.sqrt(2) / math.tanh(1 / math.sqrt(8)) * (1 - below)
    of = table({"lambda_max": (PAIRS, [[0.9 * largest], [largest]])})
    made = algorithm.step_limit(of, ["a"], 1e-3)
    assert made.observed == pytest.approx(below, abs=2e-14)
    assert made.holds == holds


@pytest.mark.parametrize(("difference", "observed", "holds"), [(1e-11, 2.5, True), (1e-9, 1e-9, False)])
def test_a_cheaper_step_has_to_be_the_same_step(difference, observed, holds):
    of = {"with_A": ("mesh", [6.0, 10.0]), "with_A_3": ("mesh", [2.0, 4.0]), "difference": ((), difference)}
    made = algorithm.economy(table(of, h=("mesh", [1, 1 / 2])), "table", 1.0)
    assert (made.observed, made.holds) == (observed, holds)


@pytest.mark.parametrize(("level", "observed"), [(0, 1.0), (1, 1.0), (2, 3.0), (4, 3.0)])
def test_steps_are_compared_with_their_law_from_H_16_on(level, observed):
    """Steps are log(1/tolerance)/H, three times that on one level; the first two do not count."""
    H = 0.5 ** np.arange(2, 7)
    tolerance = np.diag(0.1 ** np.arange(3, 8))
    steps = np.diag(np.log(1 / np.diag(tolerance)) / H)
    steps[level, level] *= 3
    of = {
        "iterations": (RUN, [steps]),
        "tolerance": (RUN, [tolerance]),
        "h_over_H": (PAIRS, H[:, None] / (2 * H)),
    }
    made = table(of, case=["c"], H=("partition", H))
    assert algorithm.step_growth(made, "a", "c", 2, 1.25).observed == pytest.approx(observed, rel=1e-12)


# The cost

SIZES = [1 / 4, 1 / 8, 1 / 16]


def steps_of(**steps):
    """Steps (H/h, H) of algorithms to the last of two levels; to the first one all take one."""
    values = np.array([np.broadcast_to(each, (2, 3)) for each in steps.values()], dtype=float)
    return table(
        {"steps": (("algorithm", "H_over_h", "H", "stop"), np.stack([values**0, values], axis=-1))},
        algorithm=list(steps), H_over_h=[2.0, 4.0], H=SIZES, stop=[0.1, 0.01],
    )  # fmt: skip


def test_the_growth_of_steps_is_compared_from_size_to_size():
    """Factors of 6/3 and 4/2 at H/h = 2; one run less at 4, so 8/(2 * 2). From H = 1/8 on 4/2 only."""
    of = steps_of(fast=[[1, 2, 4], [1, NAN, 8]], slow=[[3, 1, 1], [2, 2, 4]])
    assert cost.slower(of, "fast", "slow", 1.0, 1.0).observed == 6
    assert cost.slower(of, "fast", "slow", 0.125, 1.0).observed == 2


def test_the_most_steps_of_all_runs_count():
    assert cost.few(steps_of(a=[[1, 2, 3], [7, 5, NAN]]), "a", 20).observed == 7


@pytest.mark.parametrize(
    ("safe", "optimal", "observed", "holds"),
    [
        ([12, 23, 34], [10, 20, 30], 1.1, True),
        ([12, 26, 34], [10, 20, 30], 1.25, False),
        ([12, NAN, 34], [10, 20, 30], 1.0, False),
        ([12, NAN, 34], [10, NAN, 30], 1.1, True),
        ([12, 99, 34], [10, 0, 30], 1.1, True),
    ],
)
def test_the_safe_step_may_not_miss_a_level(safe, optimal, observed, holds):
    """Steps but one, where the optimal one took any; or the number of levels that only that one met."""
    made = cost.safe_step(steps_of(safe=safe, optimal=optimal), 1.15)
    assert (made.observed, made.holds) == (pytest.approx(observed), holds)


def cases(error, lower=1.0, ran=True):
    """Errors (H,) at the level 0.1, of a discrete solution with the error 1."""
    of_run, of_stop = ("case", "H_over_h", "H"), ("case", "H_over_h", "H", "stop")
    ones = np.ones((1, 1, 3))
    h1, hm12 = (np.broadcast_to(np.asarray(x, float), (3,)).reshape(1, 1, 3, 1) for x in (error, lower))
    return table(
        {"h1_error": (of_stop, h1), "h1_discrete": (of_run, ones), "hm12_error_lower": (of_stop, hm12),
         "hm12_discrete_lower": (of_run, ones), "setup_operations": (of_run, np.where(ran, ones, NAN))},
        case=["c"], H_over_h=[2.0], H=SIZES, stop=[0.1],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("error", "ran", "observed"),
    [
        ([9.0, 1.25, 1.0], True, 0.25),
        ([9.0, NAN, 1.5], True, 0.5),
        ([9.0, NAN, 1.0], [True, False, True], 0.0),
    ],
)
def test_the_largest_excess_at_a_level_counts(error, ran, observed):
    """From H = 1/8 on; what was not run does not count."""
    assert cost.stop_is_enough(cases(error, ran=ran), "h1", 0.1, 0.125, 0.01).observed == observed


def test_of_a_level_that_a_run_does_not_reach_nothing_is_said():
    with pytest.raises(Unjudged, match=r"a run of c does not reach the level 0\.1"):
        cost.stop_is_enough(cases([9.0, NAN, 1.0]), "h1", 0.1, 0.125, 0.01)


def test_the_least_growth_of_an_error_at_a_level_counts():
    """4/3 from 1/8 to 1/16, and 3/5 before."""
    of = cases(1.0, [5.0, 3.0, 4.0])
    assert cost.stop_is_not_enough(of, "c", 2.0, 0.1, 0.125, 1.0).observed == pytest.approx(4 / 3)
    assert cost.stop_is_not_enough(of, "c", 2.0, 0.1, 1.0, 1.0).observed == pytest.approx(3 / 5)


@pytest.mark.parametrize(
    ("with_A", "same"),
    [([[5], [7]], True), ([[5], [NAN]], True), ([[5], [8]], False), ([[NAN], [NAN]], False)],
)
def test_a_step_by_cells_has_to_be_the_same_step(with_A, same):
    """n = e^2, e^4 with quotients of operations 2 and 6, so 6/4 over 2/2; S takes 5 and 7 steps."""
    by_algebra = ("algebra", "H")
    of = {
        "step_operations": (by_algebra, [[4.0, 18.0], [2.0, 3.0]]),
        "unknowns": (by_algebra, np.exp([[2.0, 4.0], [2.0, 4.0]])),
        "h": (by_algebra, [[0.5, 0.25], [0.5, 0.25]]),
        "steps": ((*by_algebra, "stop"), [with_A, [[5], [7]]]),
    }
    made = table(of, algebra=["A", "S"])
    if same:
        assert cost.economy(made, 1.0).observed == pytest.approx(1.5)
    else:
        assert cost.economy(made, 1.6).observed == pytest.approx(1.5)
        with pytest.raises(Unjudged, match="steps with A are not known to be as many as those with S"):
            cost.economy(made, 1.0)


# The estimates


def rates_table(rate, verdict, **changed):
    """Rates (case, pair) where 0.5 is proved and 0.75 expected, all 0 at another h/H.

    The first pair is not asymptotic.
    """
    of_case, of_pair = ("case", "norm", "h_over_H"), ("case", "norm", "h_over_H", "pair")
    both = np.stack([np.array(rate), np.zeros_like(rate)], axis=1)[:, None]
    shape = both.shape[:-1]
    counts = np.broadcast_to([0.0] + [1.0] * (both.shape[-1] - 1), both.shape)
    of = {
        "rate": (of_pair, both), "asymptotic": (of_pair, counts),
        "proved": (of_case, np.full(shape, 0.5)), "expected": (of_case, np.full(shape, 0.75)),
        "verdict": (of_case, np.broadcast_to(np.array(verdict)[:, None, None], shape)),
        "why": (of_case, np.full(shape, "")),
    }  # fmt: skip
    return table(of | changed, case=["c", "d"][: len(rate)], norm=["l2"], h_over_H=[0.5, 0.25])


RATES = [[0.1, 1.0, 0.9], [0.1, 0.8, 1.1]]


@pytest.mark.parametrize(("verdict", "observed"), [("holds", 0.8), ("exact", 0.9)])
def test_the_smallest_rate_of_both_cases_counts(verdict, observed):
    """On asymptotic pairs, against 0.5 less 0.1; exact errors have none."""
    made = rates.rate(rates_table(RATES, ["holds", verdict]), ["a"], ["c", "d", "e"], "l2", 2, 0.1)
    assert made.observed == observed
    assert made.required == 0.4
    assert made.at_least


@pytest.mark.parametrize(
    ("verdict", "why", "said"),
    [("fails", "a run did not converge", "a run did not converge"), ("not judged", "", "not judged")],
)
def test_a_rate_that_is_not_judged_to_hold_is_no_evidence(verdict, why, said):
    """Unless it is slow, which it then is for the claim too: 0.8 where 0.9 is required."""
    of_case = ("case", "norm", "h_over_H")
    of = rates_table(RATES, ["holds", verdict], why=(of_case, np.full((2, 1, 2), why)))
    with pytest.raises(Unjudged, match=f"^a, d, l2: {said}$"):
        rates.rate(of, ["a"], ["c", "d"], "l2", 2, 0.1)
    assert not rates.rate(of, ["a"], ["c", "d"], "l2", 2, -0.4).holds


def test_exact_errors_alone_are_no_rate():
    with pytest.raises(Unjudged, match="there is no rate: all errors are 0"):
        rates.rate(rates_table([[1.0, 1.0]], ["exact"]), ["a"], ["c"], "l2", 2, 0.1)


def test_rates_are_those_at_the_judged_ratio():
    """At the other one all are 0."""
    made = rates.rate(rates_table(RATES, ["holds", "holds"]), ["a"], ["c", "d"], "l2", 4, 0.1)
    assert (made.observed, made.holds) == (0, False)


def test_no_faster_rate_is_looked_for_on_the_finest_pair_there_is():
    of = rates_table([[9.0, 1.0, 1.02, NAN], [9.0, 1.1, 0.7, 0.9]], ["holds", "holds"])
    assert rates.not_faster(of, ["a"], ["c", "d"], "l2", 2, 1.03).observed == 1.02


@pytest.mark.parametrize(("verdict", "observed"), [("holds", -0.25), ("fails", -0.25), ("not judged", 0.15)])
def test_rates_that_fail_are_compared_with_the_expected_ones_too(verdict, observed):
    """0.8 and 0.4 against 0.75, with a tolerance of 0.1."""
    of = rates_table([[0.0, 0.8], [0.0, 0.4]], ["holds", verdict])
    assert rates.expected(of, ["a"], ["c", "d"], 2, {"l2": 0.1}).observed == pytest.approx(observed)


def test_an_expected_rate_that_is_judged_to_fail_is_no_evidence():
    with pytest.raises(Unjudged, match=r"^a, d, l2: fails$"):
        rates.expected(rates_table(RATES, ["holds", "fails"]), ["a"], ["c", "d"], 2, {"l2": 0.1})


def test_rates_over_the_last_factor_of_four():
    """8 to 1 and 2 to 1 from the second level to the last, 2^3 and 2^1 over 4."""
    of = table({"x": (("case", "mesh"), [[1.0, 8, 5, 1], [9, 2, 9, 1]])}, case=["c", "d"])
    assert rates.rate_of(of, ["a"], "x", ["c", "d", "e"], 1.0).observed == pytest.approx(0.5)
    assert rates.slow(of, ["a"], "x", ["c", "d", "e"], 1.0).observed == pytest.approx(1.5)
    of = table({"consistency": (("case", "partition"), [[1.0, 8, 5, 1], [9, 2, 9, 1]])}, case=["c", "d"])
    assert rates.consistency_rate(of, ["a"], ["d"], 1.0).observed == pytest.approx(0.5)


def test_a_negative_consistency_term_is_none():
    of = table(
        {"consistency_elsewhere": (("case", "partition"), [[1e-16, -0.5], [0.25, 0]])}, case=["c", "d"]
    )
    made = estimates.no_consistency(of, ["a"])
    assert (made.observed, made.required) == (0.5, 1e-12)


def levels(**errors):
    """Errors at H = 2h on three levels; at H = h they grow."""
    h = 0.5 ** np.arange(3)
    H = np.array([2, 1, 0.5, 0.25])
    of = {name: np.full((1, 3, 4), NAN) for name in errors}
    for name, values in errors.items():
        of[name][0, np.arange(3), np.arange(3)] = values
        of[name][0, np.arange(3), np.arange(1, 4)] = [1, 10, 100]
    return table(
        {name: (RUN, x) for name, x in of.items()} | {"h_over_H": (PAIRS, h[:, None] / H)}, case=["c"]
    )


@pytest.mark.parametrize(
    ("h1", "lower", "observed"),
    [([4, 2, 1], [8, 2, 1.5], 0.75), ([4, 5, 1], [8, 2, 1], 1.25), ([4, 2, 1], [1, 2, 1], 2)],
)
def test_errors_have_to_fall_on_every_level_in_both_norms(h1, lower, observed):
    of = levels(h1_error=h1, hm12_error_lower=lower)
    assert estimates.keeps_falling(of, ["a"], "c", 2).observed == observed


def test_a_decrease_is_from_the_lower_bound_to_the_upper_one():
    """From at least 8 to at most 2."""
    of = levels(hm12_error_lower=[8, 1, 1], hm12_error_upper=[9, 1, 2])
    assert estimates.decrease(of, ["a"], ["c", "e"], 2, 0.1).observed == 0.25


def forms_of(lower, upper, **others):
    """What a table of the dual norm on the unit square has, one case, by diagonals of its forms."""
    cells = len(lower) - 1
    of = {
        "points": ("point", np.arange(cells + 1) * 4 / cells),
        "lambda_means": (("case", "cell"), np.zeros((1, cells))),
        "norm_lower": (("functional", "functional_too"), np.diag(lower)),
        "norm_upper": (("functional", "functional_too"), np.diag(upper)),
        "oscillation": ("case", [0.0]),
        "polygon": ((), "square"),
    }
    return of | others


def forms_of_L2(n, H):
    """||.||_0 in the place of the dual norm, n cells a side, lambda = 4 s mod 1."""
    middle = (np.arange(n) + 0.5) / n
    size = np.append(np.full(4 * n, 1 / n), 4 * 16 / n**2 / 12)
    means = (("case", "cell"), [np.tile(4 * middle % 1, 4)])
    of = forms_of(0.5 * size, 1.5 * size, lambda_means=means)
    return table(of, case=["c"], H=("partition", H))


@pytest.mark.parametrize(("coarsest", "observed"), [(1.0, -0.75), (0.25, 0.25)])
def test_rates_of_the_projection_count_from_a_size_on(coarsest, observed):
    """lambda - Pi_H lambda, of slope 4, has the norm 4 * 2H/12^(1/2) for H <= 1/4, and no other for larger H.

    So rates are 1 and 0, less the expected 3/4. On H = 1/32 there is no form.
    """
    of = forms_of_L2(16, [1, 1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32])
    made = estimates.projection(of, ["a"], {"c": 0.75, "e": 9}, coarsest, 0.1)
    assert made.observed == pytest.approx(observed)


def test_forms_are_known_on_the_partitions_that_they_refine():
    known = evidence.forms(forms_of_L2(4, [1, 1 / 4, 1 / 8]), "a")
    assert [cells.n_cells for cells, _ in known] == [4, 16]
    assert {cells.polygon.name for cells, _ in known} == {square().name}
    of = forms_of_L2(4, [1])
    of["a/dual_norm"] = of["a/dual_norm"].assign(points=("point", np.arange(17) / 2), polygon="lshape")
    assert [cells.polygon.name for cells, _ in evidence.forms(of, "a")] == [named("lshape").name]


@pytest.mark.parametrize(
    ("changed", "observed"),
    [({}, 1.0), ({"hm12_error_upper": 0.0}, 1.25), ({"consistency": 0.0}, 2.0), ({"h1_error": 2.0}, 4 / 1.3)],
)
def test_the_abstract_bound_by_hand(changed, observed):
    """E^2 = 1 over (E + L) r + m E + c = 2 * 0.2 + 0.1 + 0.5, where m is what oscillates, 0.1, alone.

    A finer mesh with the error 9, whose L is not known, is not judged.
    """
    of = {"h1_error": 1.0, "hm12_error_upper": 1.0, "ritz_error": 0.2, "consistency": 0.5} | changed
    errors = {
        "h1_error": (RUN, [[[of["h1_error"]], [9.0]]]),
        "hm12_error_upper": (RUN, [[[of["hm12_error_upper"]], [NAN]]]),
        "ritz_error": (("case", "mesh"), [2 * [of["ritz_error"]]]),
        "consistency": (("case", "partition"), [[of["consistency"]]]),
    }
    forms = forms_of(5 * [0.0], 5 * [0.0], oscillation=("case", [0.1]))
    made = table(forms | errors, case=["c"], H=("partition", [1.0]))
    assert estimates.abstract_bound(made, ["a"], ["c", "e"]).observed == pytest.approx(observed)


def runs(**changed):
    """Two runs of equal numbers, H = 1/4 and 1/16, but for those of the second that are `changed`."""
    of = {
        "h1_error": (RUN, 0.125),
        "l2_error": (RUN, 1.25),
        "hm12_best": (RUN, 0.125),
        "hm12_discrete": (RUN, 0.1),
        "hm12_error_lower": (RUN, 0.5),
        "hm12_error_upper": (RUN, 0.625),
        "projection_error": (("case", "partition"), 0.25),
        "consistency": (("case", "partition"), 0.046875),
        "ritz_error": (("case", "mesh"), 0.25),
        "u_norm": (("case", "mesh"), 1.0),
        "beta_0": (PAIRS, 0.5),
        "beta_lower": (PAIRS, 0.75),
        "beta_upper": (PAIRS, 1.0),
    }
    size = {"case": 1, "mesh": 1, "partition": 2}
    made = {}
    for name, (dims, value) in of.items():
        values = np.full([size[d] for d in dims], value)
        if "partition" in dims:
            values[..., 1] = changed.get(name, value)
        made[name] = (dims, values)
    return table(made, case=["c"], H=("partition", [1 / 4, 1 / 16]))


@pytest.mark.parametrize(
    ("changed", "observed"),
    [
        ({}, 1.0),
        ({"l2_error": 3.375}, 1.5),
        ({"l2_error": 9.0, "beta_0": 0.0}, 1.0),
        ({"l2_error": 1e-13, "projection_error": 0.0, "h1_error": 0.0, "hm12_best": 1e-14}, 1.0),
    ],
)
def test_the_bound_of_the_multiplier_in_L2_by_hand(changed, observed):
    """1.25 = 1/4 + (1/8 + 1/8)/(1/2 * (1/4)^(1/2)), an equality; with H = 1/16 the right side is 2.25.

    Where beta_0 is 0, and where the error is, to round-off, there is nothing to judge.
    """
    assert estimates.multiplier_bound(runs(**changed), ["a"]).observed == pytest.approx(observed)


@pytest.mark.parametrize(
    ("changed", "observed"),
    [({}, 1 / 8), ({"h1_error": 1.0}, 8.0), ({"h1_error": 9.0, "beta_lower": 0.5}, 1 / 8)],
)
def test_the_constant_of_quasi_optimality_by_hand(changed, observed):
    """1/64 over 1/16 + 1/64 + 3/64; runs with a beta of at most 1/2 are not counted."""
    assert estimates.quasi_optimal(runs(**changed), ["a"], 2.0).observed == pytest.approx(observed)


@pytest.mark.parametrize(
    ("changed", "observed"),
    [({}, 5 / 3), ({"hm12_error_upper": 0.75}, 2.0), ({"hm12_error_upper": 0.1}, 5 / 3)],
)
def test_lemma_4_3_is_judged_by_its_worst_run(changed, observed):
    """0.625 over (1 + 1/beta)/8 + 1/(8 beta) with beta = 1."""
    assert estimates.lemma_4_3(runs(**changed), ["a"]).observed == pytest.approx(observed)


def surfaces():
    """Rates on three pairs over alpha = 0, 1/4, 1/2 and gamma = 1, 2, where 1 is predicted.

    Of consistency terms alpha + gamma + 1 is.
    """
    rate = np.ones((1, 3, 3, 2))
    rate[0, 0], rate[0, :, 0], rate[0, :, :, 1] = 0.0, 0.5, 0.25
    rate[0, 1, 1, 0], rate[0, 2, 2, 0] = 0.875, 0.9375
    alpha, gamma = np.array([0, 0.25, 0.5]), np.array([1.0, 2.0])
    terms = np.tile(alpha[:, None] + gamma + 1, (3, 1, 1))
    predicted = terms[0].copy()
    terms[0] = 0
    terms[2, 1, 1] -= 0.25
    of = {
        "rate": (("norm", "pair", "alpha", "gamma"), rate),
        "predicted": (("norm", "alpha"), np.ones((1, 3))),
        "consistency_rate": (("pair", "alpha", "gamma"), terms),
        "consistency_predicted": (("alpha", "gamma"), predicted),
    }
    return table(of, norm=["l2"], alpha=alpha, gamma=gamma)


def test_surfaces_are_judged_on_their_two_finest_pairs():
    """From alpha = 1/4 on and at gamma = 1 the least is 0.875, on the pair before the last."""
    assert rates.surface(surfaces(), "table", "l2", 0.25, [1.0], 0.1).observed == -0.125
    assert rates.surface(surfaces(), "table", "l2", 0.5, [1.0], 0.1).observed == -0.0625
    assert rates.surface(surfaces(), "table", "l2", 0.25, [1.0, 2.0], 0.1).observed == -0.75


def test_rates_of_the_consistency_term_may_not_be_lower_either():
    assert rates.consistency_surface(surfaces(), "table", 0.1).observed == 0.25


# The extremes


def test_the_slope_is_fitted_below_a_value_on_its_axis():
    """3 x^-2 on x = 1/4, 1/8, 1/32 has the slope -2; what is coarser, not known or elsewhere is not in it."""
    of = {
        "axis_of": ("point", ["a", "a", "a", "a", "a", "b"]),
        "value": ("point", [1, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64]),
        "measured": ("point", [9, 48, 192, NAN, 3072, 1]),
    }
    assert extremes.power(table(of), "table", "a", 0.25, -2, 0.1).observed == pytest.approx(0, abs=1e-12)
    for exponent in (-1, -3):
        assert extremes.power(table(of), "table", "a", 0.25, exponent, 0.1).observed == pytest.approx(1)


def test_a_slope_needs_two_numbers():
    of = {"axis_of": ("point", ["a", "a"]), "value": ("point", [0.5, 0.25]), "measured": ("point", [1, NAN])}
    with pytest.raises(Unjudged, match="fewer than two numbers are known on the axis a"):
        extremes.power(table(of), "table", "a", 1.0, -2, 0.1)


@pytest.mark.parametrize(("last", "wrong"), [(2.0, 0), (1.001, 0), (0.9, 1)])
def test_a_limit_is_judged_only_if_it_was_tried_next_to_it(last, wrong):
    """0.999 of the limit converges, and a second value does not, which is wrong below the limit."""
    of = {
        "axis_of": ("point", ["a", "a"]),
        "value": ("point", [0.999, last]),
        "outcome": ("point", ["right", "not converged"]),
        "predicted_limit": ("axis", [1.0]),
    }
    made = table(of, axis=["a"])
    if last == 2.0:
        with pytest.raises(Unjudged, match=r"^1\.001 of the limit was not tried on the axis a$"):
            extremes.step_limit(made, "table", {"a": 0.001})
    else:
        assert extremes.step_limit(made, "table", {"a": 0.001}).observed == wrong


def test_the_first_step_that_fails_is_the_measured_one():
    of = {"measured_limit": ("axis", [1.5, 1.0]), "predicted_limit": ("axis", [1.0, 1.0])}
    made = extremes.step_beyond(table(of, axis=["a", "b"]), "table", "a", 1.01)
    assert (made.observed, made.at_least) == (1.5, True)


# Stability


def test_values_that_are_not_known_are_not_judged_unless_none_is():
    of = table(
        {"x": (("case", "step"), [[3.0, NAN], [4.0, 5.0]]), "y": ("case", [NAN, NAN])},
        case=["c", "d"],
        step=[0, 1],
    )
    assert stability.values(of, "table", "x", 1.0, True).observed == 3
    assert stability.values(of, "{scene}/errors", "x", 1.0, False, ["a"]).observed == 5
    assert stability.values(of, "table", "x", 1.0, False, select={"case": ["c"], "mesh": 0}).observed == 3
    with pytest.raises(Unjudged, match="y is not known of table"):
        stability.values(of, "table", "y", 1.0, True)
    assert stability.smallest(of, "{scene}/errors", ["a"], ["x"], 1.0, "").observed == 3


def test_the_smallest_value_at_a_ratio_counts():
    of = table({"x": (PAIRS, [[5.0, 1.0], [9.0, 4.0]]), "h_over_H": (PAIRS, [[0.5, 1], [0.25, 0.5]])})
    assert stability.at_ratio(of, "{scene}/errors", ["a"], "x", 2, 0.5).observed == 4


@pytest.mark.parametrize(
    ("ratio", "observed"), [([0.5, 1.0, 2.0], 0.25), ([0.5, 0.75, 2.0], 0.125), ([0.5, 0.5, 0.5], None)]
)
def test_eigenvalues_have_to_vanish_from_H_equal_to_h_on(ratio, observed):
    """lambda_min/lambda_max is 1, 1/4, 1/8; without such a pair nothing is judged."""
    of = {
        "lambda_min": (PAIRS, [[2.0, 1.0, 0.5]]),
        "lambda_max": (PAIRS, [[2.0, 4.0, 4.0]]),
        "h_over_H": (PAIRS, [ratio]),
    }
    if observed is not None:
        assert stability.vanishes(table(of), ["a"]).observed == observed
    else:
        with pytest.raises(Unjudged, match="at H <= h is not known of a"):
            stability.vanishes(table(of), ["a"])


@pytest.mark.parametrize(
    ("lower", "upper", "observed"), [(1.0, 1.0, 0.0), (0.8, 1.2, 0.5), (1.25, 1.25, 0.25), (0.75, 0.75, 0.25)]
)
def test_bounds_of_the_norm_of_1_enclose_it_and_are_close(lower, upper, observed):
    """Diagonal forms in which 1 on four cells has that multiple of the norm, by e^s in place of coth."""
    quarter = 2 + (math.e + 1) / (math.e - 1)
    of = forms_of(5 * [lower**2 * quarter], 5 * [upper**2 * quarter])
    assert stability.closed_form(table(of), "a").observed == pytest.approx(observed, abs=1e-14)


def test_the_inverse_estimate_in_a_norm_in_which_it_is_known():
    """In ||.||_0/2^(1/2), from below, C = (2H)^(1/2): 2^(1/2) for H = 1."""
    made = stability.inverse_estimate(forms_of_L2(4, [1, 1 / 4]), ["a"], 4.0)
    assert made.observed == pytest.approx(math.sqrt(2))
    assert made.lines[1].endswith(f": {math.sqrt(0.5):.4g}")


@pytest.mark.parametrize(
    ("ratios", "angles", "observed"),
    [
        ([2.0, 1.9, 3.0], [45.0, 45, 19], 0.9),
        ([2.0, 2.0, 3.0], [45.0, 20, 19], 0.5),
        ([2.0, 1.9, 3.0], [45.0, 45, 20], 0.25),
        ([2 - 1e-10, 1, 1], [45.0, 45, 45], 0.9),
        ([1.0, 1, 1], [45.0, 45, 45], None),
    ],
)
def test_the_local_rule_asks_for_short_edges_and_no_flat_triangles(ratios, angles, observed):
    """beta is 0.9, 0.5, 0.25; a cell of 2 edges, to round-off, and an angle of 20 degrees are enough."""
    of = {"beta_lower": [[0.9, 0.5, 0.25]], "cell_over_edge": [ratios], "smallest_angle": [angles]}
    made = table({name: (PAIRS, x) for name, x in of.items()})
    if observed is not None:
        assert stability.local_rule(made, ["a"], 2.0, 20.0, 0.7).observed == observed
    else:
        with pytest.raises(Unjudged, match="nothing of which to find the smallest beta"):
            stability.local_rule(made, ["a"], 2.0, 20.0, 0.7)


def test_edges_alone_are_judged_where_every_cell_has_them():
    of = table({"beta_upper": (PAIRS, [[0.25, 0.5]]), "edges_per_cell": (PAIRS, [[1.0, 2 - 1e-10]])})
    assert stability.edges_alone(of, "a", 2.0, 0.35).observed == 0.5
    with pytest.raises(Unjudged, match="with 3 edges in every cell is not known of a"):
        stability.edges_alone(of, "a", 3.0, 0.35)


def test_near_is_from_either_side():
    of = table({"x": ("case", [2.125, 1.5])})
    assert stability.near(of, "table", "x", 2.0, 1e-6, "").observed == 0.25


@pytest.mark.parametrize("name", ["saddle_in_v", "saddle_in_mu"])
def test_a_saddle_grows_in_both_variables(name):
    of = {"saddle_in_v": ("case", [1.0, 1.0]), "saddle_in_mu": ("case", [1.0, 1.0])}
    assert stability.saddle(table(of, case=["c", "d"]), "table").observed == 1
    assert (
        stability.saddle(table(of | {name: ("case", [1.0, -0.5])}, case=["c", "d"]), "table").observed == -0.5
    )


@pytest.mark.parametrize(
    ("violation", "same_u", "distance", "observed"),
    [
        (1e-15, 1e-14, 0.5, (1e-14, True)),
        (1e-3, 1e-14, 0.5, (1e-3, False)),
        (1e-15, 1e-14, 0.05, (0.05, False)),
    ],
)
def test_two_multipliers_are_two_only_if_they_are_apart(violation, same_u, distance, observed):
    of = {"violation": ((), violation), "same_u": ((), same_u), "multiplier_distance": ((), distance)}
    made = stability.two_multipliers(table(of), "table", 0.1)
    assert (made.observed, made.holds) == observed


@pytest.mark.parametrize(
    ("lower", "upper", "observed", "holds"),
    [
        ([1.0, 1.0], [1.25, 1.5], 0.5, True),
        ([1.0, 1.0], [1.25, 0.75], -0.25, False),
        ([1.0, 1e-14], [1.25, 1e-13], 0.25, True),
        ([1.0, 1e-10], [1.25, 2e-10], 1.0, False),
        ([1.0, NAN], [1.25, NAN], 0.25, True),
    ],
)
def test_bounds_that_cross_have_no_gap(lower, upper, observed, holds):
    """Errors that are 0 to round-off, or not known, have none that counts."""
    of = {
        "hm12_error_lower": (RUN, [[lower]]),
        "hm12_error_upper": (RUN, [[upper]]),
        "u_norm": (("case", "mesh"), [[1.0]]),
    }
    made = stability.gap(table(of), ["a"], 0.75)
    assert (made.observed, made.holds) == (observed, holds)
