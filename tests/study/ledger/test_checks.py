"""The checks of the ledger on made-up tables: every branch and filter of theirs is taken, by hand.

The controls of the ledger spoil the study's own tables; here numbers are so few that the finding is known.
"""

import math
import re

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
import xarray as xr

from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import named, square
from unilateral.norms.dual import Gram
from unilateral.study.experiments.adaptive import checks as adaptive
from unilateral.study.experiments.algorithm import checks as algorithm
from unilateral.study.experiments.cells import checks as transitions
from unilateral.study.experiments.cost import checks as cost
from unilateral.study.experiments.estimates import checks as estimates
from unilateral.study.experiments.extremes import checks as extremes
from unilateral.study.experiments.extremes.outcome import NOT_CONVERGED, NOTHING, REFUSED, RIGHT, WRONG
from unilateral.study.experiments.scenes import checks as rates
from unilateral.study.experiments.sharpness import checks as exponents
from unilateral.study.experiments.stability import checks as stability
from unilateral.study.ledger import checks as shared
from unilateral.study.ledger import evidence
from unilateral.study.ledger.evidence import Unjudged

NAN, INF = math.nan, math.inf
RUN, PAIRS = ("case", "mesh", "partition"), ("mesh", "partition")
NAMES = ("table", *(f"a/{name}" for name in ("errors", "rates", "dual_norm", "infsup")))


def table(variables, **coordinates):
    """One table by the names under which checks ask for it."""
    names = (*NAMES, "cost/algorithm", "cost/case", "cost/algebra")
    return dict.fromkeys(names, xr.Dataset(variables, coordinates))


def over(dims, **variables):
    """Variables over the same dimensions."""
    return {name: (dims, values) for name, values in variables.items()}


def made_is(expected, check, *given, **named):
    """Whether a check observes that number, and holds or not if that is said; or does not judge for it."""
    try:
        made = check(*given, **named)
    except Unjudged as reason:
        return isinstance(expected, str) and re.search(expected, str(reason)) is not None
    if isinstance(expected, str):
        return False
    number, *holds = expected if isinstance(expected, tuple) else (expected,)
    return made.observed == pytest.approx(number, abs=2e-14) and holds in ([], [made.holds])


def number(observed):
    """That has to be 1 at least."""
    return evidence.worst({"a": observed}, "", 1.0, True)


def test_the_worst_of_nothing_or_of_what_is_not_known_is_not_judged():
    given = ("the gap", 0.0, True)
    assert made_is("there is nothing of which to find the gap", evidence.worst, {}, *given)
    unknown = {"a": 1.0, "b": NAN, "c": NAN, "d": INF}
    assert made_is("the gap is not known of b; c", evidence.worst, unknown, *given)
    assert evidence.worst({"a": 1.0, "b": INF}, "", 0.0, False).observed == INF
    assert evidence.worst({"a": 1.0, "b": 2.0}, "", 0.0, True).observed == 1
    assert evidence.worst({"a": 1.0, "b": 2.0}, "", 0.0, False).observed == 2


def test_of_a_statement_in_parts_the_first_that_fails_is_told():
    parts = [number(observed) for observed in (3.0, 2.0, 0.5, 0.25)]
    assert evidence.all_of(*parts) is parts[2]
    assert evidence.all_of(*parts[:2]) is parts[0]


def test_faults_are_a_verdict_of_their_own_only_where_the_number_would_pass():
    assert made_is((0.5, False), evidence.provided, number(0.5), ["fault"])
    assert made_is((1.0, True), evidence.provided, number(1.0), [])
    assert made_is("^one fault; another$", evidence.provided, number(1.0), ["one fault", "another"])


def test_values_along_a_ratio_are_those_of_the_pairs_with_it():
    """h = 1/2, 1/4, 1/8 and H = 1, 5/8, 1/2: H = 2h at (0, 0) and (1, 2), and nearly so elsewhere."""
    h, H = np.array([1 / 2, 1 / 4, 1 / 8]), np.array([1, 5 / 8, 1 / 2])
    of = over(PAIRS, x=np.arange(9).reshape(3, 3), h_over_H=h[:, None] / H) | over("partition", y=H)
    assert evidence.along_ratio(table(of)["table"], "x", 2).tolist() == [0, 5]
    assert evidence.along_ratio(table(of)["table"], "y", 2).tolist() == [1, 1 / 2]


# Adapted meshes

LEVELS = ("kind", "case", "level")


def on_levels(rate, share=0.005, index=1.2, asymptotic=1.0):
    """Of one case on uniform meshes, which are bad, and on adapted ones; asymptotic but for the first one."""
    known = np.array([0.0, *(asymptotic,) * 4])
    values = {"error_rate": [NAN, *rate], "share": [9, *[share] * 4], "index": [9, *[index] * 4]}
    both = {name: [[9 * np.ones(5)], [of]] for name, of in values.items()} | {
        "asymptotic": [[known], [known]]
    }
    return table(over(LEVELS, **both), kind=["uniform", "adapted"], case=["c"])


@pytest.mark.parametrize(
    ("rate", "share", "expected"),
    [
        ([0.5, 0.48, 0.6, NAN], 0.01, (0.48, True)),
        ([0.5, 0.46, 0.6, NAN], 0.01, (0.46, False)),
        ([0.5, 0.46, 0.6, NAN], 0.02, (0.46, False)),
        ([0.5, 0.48, 0.6, NAN], 0.02, r"^the algebraic bound is 0\.02 of an error$"),
        ([0.5, 0.48, 0.6, NAN], NAN, "^the algebraic bound is nan of an error$"),
        ([0.5, 0.48, NAN, NAN], 0.01, "^c has 2 pairs$"),
        ([NAN, NAN, NAN, NAN], 0.01, "^c has 0 pairs$"),
        ([0.4, NAN, NAN, NAN], 0.01, (0.4, False)),
    ],
)
def test_every_pair_of_asymptotic_levels_has_a_rate(rate, share, expected):
    """Three at least, with algebraic bounds of 1 % at most."""
    given = on_levels(rate, share), "table", ["c"], "error_rate", 0.47, 0.01
    assert made_is(expected, adaptive.rate, *given)


@pytest.mark.parametrize(
    ("index", "asymptotic", "expected"),
    [(1.5, 1, (1.5, True)), (1.6, 1, (1.6, False)), (1.2, 0, "the largest bound over .* is not known of c")],
)
def test_how_large_a_bound_is_counts_on_asymptotic_levels(index, asymptotic, expected):
    of = on_levels([NAN] * 4, index=index, asymptotic=asymptotic)
    assert made_is(expected, adaptive.index, of, "table", ["c"], 1.5)


# The algorithm


def distances(meant, printed=(1, 1), clipless=(1, 1)):
    """Of two steps, half and twice the limit."""
    of = over(("case", "variant", "rho_share"), distance=np.array([[meant, printed, clipless]]))
    return table(of, case=["c"], variant=["as meant", "as printed", "without the clip"], rho_share=[0.5, 2.0])


@pytest.mark.parametrize(
    ("below", "above", "holds"), [(0.5, 3.0, True), (0.01, 3.0, False), (0.5, 11.0, False), (0.5, INF, False)]
)
def test_a_cycle_is_neither_a_limit_nor_unbounded(below, above, holds):
    """Between 0.1 and 10: the smallest distance counts, but the largest if it is above."""
    given = distances([below, above]), "table", ["c"], [0.5, 2.0], 0.1, 10.0
    assert made_is((above if above > 10 else below, holds), algorithm.cycle, *given)


@pytest.mark.parametrize(("printed", "expected"), [(2.0, (500.0, True)), (2.01, (2.01, False))])
def test_the_printed_index_has_to_converge_below_half_the_limit(printed, expected):
    """Up to a factor of 2 of the distance as meant, 1; above the quotient is 1000/2."""
    of = distances([1.0, 2.0], [printed, 1000.0])
    assert made_is(expected, algorithm.printed_index, of, "table", ["c"], 0.5, 2.0, 1.0)


def test_the_clip_is_told_by_the_distance_without_it():
    of = distances([1, 0.02], clipless=[1, 2.0])
    assert made_is((100, True), algorithm.clip, of, "table", "c", 2.0, 1.0)


@pytest.mark.parametrize(("below", "holds"), [(5e-4, True), (2e-3, False), (-1e-14, True), (-1e-4, False)])
def test_an_eigenvalue_above_the_steklov_bound_is_no_small_distance(below, holds):
    """lambda_max(S) = (1 - below)/sigma_1 with sqrt(2) sigma_1 = tanh(1/sqrt(8)), on the finer mesh."""
    largest = math.sqrt(2) / math.tanh(1 / math.sqrt(8)) * (1 - below)
    of = table(over(PAIRS, lambda_max=[[0.9 * largest], [largest]]))
    assert made_is((below, holds), algorithm.step_limit, of, ["a"], 1e-3)


@pytest.mark.parametrize(("difference", "expected"), [(1e-11, (2.5, True)), (1e-9, (1e-9, False))])
def test_a_cheaper_step_has_to_be_the_same_step(difference, expected):
    of = over("mesh", with_A=[6.0, 10.0], with_A_3=[2.0, 4.0]) | over((), difference=difference)
    assert made_is(expected, algorithm.economy, table(of, h=("mesh", [1, 1 / 2])), "table", 1.0)


@pytest.mark.parametrize(("level", "observed"), [(0, 1.0), (1, 1.0), (2, 3.0), (4, 3.0)])
def test_steps_are_compared_with_their_law_from_H_16_on(level, observed):
    """Steps are log(1/tolerance)/H, three times that on one level; the first two do not count."""
    H = 0.5 ** np.arange(2, 7)
    tolerance = np.diag(0.1 ** np.arange(3, 8))
    steps = np.diag(np.log(1 / np.diag(tolerance)) / H)
    steps[level, level] *= 3
    of = over(RUN, iterations=[steps], tolerance=[tolerance]) | over(PAIRS, h_over_H=H[:, None] / (2 * H))
    made = table(of, case=["c"], H=("partition", H))
    assert made_is(pytest.approx(observed, rel=1e-12), algorithm.step_growth, made, "a", "c", 2, 1.25)


# The cost

SIZES = [1 / 4, 1 / 8, 1 / 16]


def steps_of(**steps):
    """Steps (H/h, H) of algorithms to the last of two levels; to the first one all take one."""
    values = np.array([np.broadcast_to(each, (2, 3)) for each in steps.values()], dtype=float)
    of = over(("algorithm", "H_over_h", "H", "stop"), steps=np.stack([values**0, values], axis=-1))
    return table(of, algorithm=list(steps), H_over_h=[2.0, 4.0], H=SIZES, stop=[0.1, 0.01])


@pytest.mark.parametrize(("coarsest", "observed"), [(1.0, 6), (0.125, 2)])
def test_the_growth_of_steps_is_compared_from_size_to_size(coarsest, observed):
    """Factors of 6/3 and 4/2 at H/h = 2; one run less at 4, so 8/(2 * 2). From H = 1/8 on 4/2 only."""
    of = steps_of(fast=[[1, 2, 4], [1, NAN, 8]], slow=[[3, 1, 1], [2, 2, 4]])
    assert made_is(observed, cost.slower, of, "fast", "slow", coarsest, 1.0)


def test_the_most_steps_of_all_runs_count():
    assert made_is(7, cost.few, steps_of(a=[[1, 2, 3], [7, 5, NAN]]), "a", 20)


@pytest.mark.parametrize(
    ("safe", "optimal", "expected"),
    [
        ([12, 23, 34], [10, 20, 30], (1.1, True)),
        ([12, 26, 34], [10, 20, 30], (1.25, False)),
        ([12, NAN, 34], [10, 20, 30], (1.0, False)),
        ([12, NAN, 34], [10, NAN, 30], (1.1, True)),
        ([12, 99, 34], [10, 0, 30], (1.1, True)),
    ],
)
def test_the_safe_step_may_not_miss_a_level(safe, optimal, expected):
    """Steps but one, where the optimal one took any; or the number of levels that only that one met."""
    assert made_is(expected, cost.safe_step, steps_of(safe=safe, optimal=optimal), 1.15, 0.01)


@pytest.mark.parametrize(("finest", "expected"), [(0.01, (1.25, False)), (0.05, (0.0, True))])
def test_levels_that_rounding_may_decide_do_not_count(finest, expected):
    """At the first level, 0.1, all take one step: none but one."""
    of = steps_of(safe=[12, 26, 34], optimal=[10, 20, 30])
    assert made_is(expected, cost.safe_step, of, 1.15, finest)


def errors_at_a_level(error, lower=1.0, ran=True):
    """Errors (H,) at the level 0.1, of a discrete solution with the error 1."""
    ones = np.ones((1, 1, 3))
    h1, hm12 = (np.broadcast_to(np.asarray(x, float), (3,)).reshape(1, 1, 3, 1) for x in (error, lower))
    of = over(("case", "H_over_h", "H"), h1_discrete=ones, hm12_discrete_lower=ones)
    of |= over(("case", "H_over_h", "H"), setup_operations=np.where(ran, ones, NAN))
    of |= over(("case", "H_over_h", "H", "stop"), h1_error=h1, hm12_error_lower=hm12)
    return table(of, case=["c"], H_over_h=[2.0], H=SIZES, stop=[0.1])


@pytest.mark.parametrize(
    ("error", "ran", "expected"),
    [
        ([9.0, 1.25, 1.0], True, 0.25),
        ([9.0, NAN, 1.5], True, 0.5),
        ([9.0, NAN, 1.0], [True, False, True], 0.0),
        ([9.0, NAN, 1.0], True, r"a run of c does not reach the level 0\.1"),
    ],
)
def test_the_largest_excess_at_a_level_counts(error, ran, expected):
    """From H = 1/8 on; what was not run does not count."""
    assert made_is(expected, cost.stop_is_enough, errors_at_a_level(error, ran=ran), "h1", 0.1, 0.125, 0.01)


@pytest.mark.parametrize(("coarsest", "observed"), [(0.125, 4 / 3), (1.0, 3 / 5)])
def test_the_least_growth_of_an_error_at_a_level_counts(coarsest, observed):
    """4/3 from 1/8 to 1/16, and 3/5 before."""
    of = errors_at_a_level(1.0, [5.0, 3.0, 4.0])
    assert made_is(observed, cost.stop_is_not_enough, of, "c", 2.0, 0.1, coarsest, 1.0)


@pytest.mark.parametrize(
    ("with_A", "same"),
    [([[5], [7]], True), ([[5], [NAN]], True), ([[5], [8]], False), ([[NAN], [NAN]], False)],
)
def test_a_step_by_cells_has_to_be_the_same_step(with_A, same):
    """n = e^2, e^4 with quotients of operations 2 and 6, so 6/4 over 2/2; S takes 5 and 7 steps."""
    by_algebra, n = ("algebra", "H"), np.exp([[2.0, 4.0], [2.0, 4.0]])
    of = over(by_algebra, step_operations=[[4.0, 18.0], [2.0, 3.0]], unknowns=n, h=[[0.5, 0.25], [0.5, 0.25]])
    made = table(of | over((*by_algebra, "stop"), steps=[with_A, [[5], [7]]]), algebra=["A", "S"])
    assert made_is(1.5, cost.economy, made, 1.6)
    unlike = "steps with A are not known to be as many as those with S"
    assert made_is(1.5 if same else unlike, cost.economy, made, 1.0)


# The rates


def rates_table(rate, verdict, why=""):
    """Rates (case, pair) where 0.5 is proved and 0.75 expected, all 0 at another h/H.

    The first pair is not asymptotic.
    """
    both = np.stack([np.array(rate), np.zeros_like(rate)], axis=1)[:, None]
    shape, counts = both.shape[:-1], np.broadcast_to([0.0] + [1.0] * (both.shape[-1] - 1), both.shape)
    verdicts = np.broadcast_to(np.array(verdict)[:, None, None], shape)
    of = over(("case", "norm", "h_over_H"), verdict=verdicts, why=np.full(shape, why))
    of |= over(("case", "norm", "h_over_H"), proved=np.full(shape, 0.5), expected=np.full(shape, 0.75))
    of |= over(("case", "norm", "h_over_H", "pair"), rate=both, asymptotic=counts)
    return table(of, case=["c", "d"][: len(rate)], norm=["l2"], h_over_H=[0.5, 0.25])


RATES = [[0.1, 1.0, 0.9], [0.1, 0.8, 1.1]]


@pytest.mark.parametrize(
    ("verdict", "why", "ratio", "tolerance", "expected"),
    [
        ("holds", "", 2, 0.1, (0.8, True)),
        ("holds", "", 2, -0.4, (0.8, False)),
        ("exact", "", 2, 0.1, 0.9),
        ("fails", "a run did not converge", 2, 0.1, "^a, d, l2: a run did not converge$"),
        ("not judged", "", 2, 0.1, "^a, d, l2: not judged$"),
        ("not judged", "", 2, -0.4, (0.8, False)),
        ("holds", "", 4, 0.1, (0, False)),
    ],
)
def test_the_smallest_rate_of_both_cases_counts(verdict, why, ratio, tolerance, expected):
    """On asymptotic pairs at the judged ratio, against 0.5 less the tolerance; exact errors have none.

    A rate that is not judged to hold is no evidence, unless it is slow, which it then is for the claim too.
    """
    of = rates_table(RATES, ["holds", verdict], why)
    assert made_is(expected, rates.rate, of, ["a"], ["c", "d", "e"], "l2", ratio, tolerance)


def test_exact_errors_alone_are_no_rate():
    of = rates_table([[1.0, 1.0]], ["exact"])
    assert made_is("there is no rate: all errors are 0", rates.rate, of, ["a"], ["c"], "l2", 2, 0.1)


def test_no_faster_rate_is_looked_for_on_the_finest_pair_there_is():
    of = rates_table([[9.0, 1.0, 1.02, NAN], [9.0, 1.1, 0.7, 0.9]], ["holds", "holds"])
    assert made_is(1.02, rates.not_faster, of, ["a"], ["c", "d"], "l2", 2, 1.03)


@pytest.mark.parametrize(("tolerance", "holds"), [(0.3, True), (0.2, False)])
def test_on_the_finest_pair_no_rate_is_far_above_the_expected_one(tolerance, holds):
    """1 and 0.7 there, against 0.75."""
    of = rates_table([[9.0, 0.1, 1.0, NAN], [9.0, 1.1, 0.1, 0.7]], ["holds", "holds"])
    expected = (0.25 - tolerance, holds)
    assert made_is(expected, rates.attained, of, ["a"], ["c", "d"], 2, {"l2": tolerance})
    assert made_is("there is nothing", rates.attained, of, ["a"], ["e"], 2, {"l2": tolerance})


@pytest.mark.parametrize(
    ("rate", "verdict", "expected"),
    [
        ([[0.0, 0.8], [0.0, 0.4]], "holds", -0.25),
        ([[0.0, 0.8], [0.0, 0.4]], "fails", -0.25),
        ([[0.0, 0.8], [0.0, 0.4]], "not judged", 0.15),
        (RATES, "fails", "^a, d, l2: fails$"),
    ],
)
def test_rates_that_fail_are_compared_with_the_expected_ones_too(rate, verdict, expected):
    """0.8 and 0.4 against 0.75, with a tolerance of 0.1."""
    of = rates_table(rate, ["holds", verdict])
    assert made_is(expected, rates.expected, of, ["a"], ["c", "d"], 2, {"l2": 0.1})


@pytest.mark.parametrize(
    ("verdict", "tolerance", "expected"),
    [("holds", 0.1, (0.1, True)), ("holds", -0.2, (-0.2, False)), ("fails", 0.1, "^a, d, l2: fails$")],
)
def test_rates_against_the_order_of_regularity(verdict, tolerance, expected):
    """0.8 and 0.9 against 0.8 and 0.7: no excess, and 0.2."""
    of = rates_table([[0.1, 1.0, 0.8], [0.1, 0.9, 1.1]], ["holds", verdict])
    orders, tolerances = {"c": 0.8, "d": 0.7}, {"l2": tolerance}
    assert made_is(expected, rates.regularity, of, ["a"], orders, 2, tolerances)


def on_cells(bound=0.001, converged=1.0):
    """Of two cases, H falls from 1 by 4 and by 16; D like H^1 and H^(1/2), then like H^(1/2) and H^(3/4)."""
    errors = np.array([[[1, 1 / 4], [1, 1 / 4]], [[1, 1 / 2], [1, 1 / 8]]])
    run = over(("case", "start", "level"), discrete_error=errors, consistency=errors**2)
    run |= over(("case", "start", "level"), algebraic_bound=bound * errors, converged=0 * errors + converged)
    run |= over(("case",), flux_order=[1 / 2, 1 / 2], gap_order=[1, 3 / 4])
    return table(run, case=["c", "d"], H=(("start", "level"), [[1, 1 / 4], [1, 1 / 16]]))


def test_exponents_are_means_over_where_cells_begin():
    """3/4 and 5/8, which are (sigma + tau)/2 <= sigma + 1/2; of the consistency term 3/2 and 5/4."""
    of = on_cells()
    given = ("a/errors", "discrete_error")
    assert made_is((5 / 8, True), transitions.exponents, of, *given, ["c", "d"], 0.6, True)
    assert made_is((3 / 4, False), transitions.exponents, of, *given, ["c", "d"], 0.7, False)
    assert made_is((3 / 4, True), transitions.exponents, of, *given, ["c"], 0.7, True)
    assert made_is((0, True), transitions.consistency, of, "a/errors", 0.1)
    assert made_is((0, True), transitions.sharp, of, "a/errors", ["c", "d"], 0.1)
    of["a/errors"]["gap_order"][1] = 1
    assert made_is((0.125, False), transitions.sharp, of, "a/errors", ["c", "d"], 0.1)
    assert made_is((0.25, False), transitions.consistency, of, "a/errors", 0.1)


def test_exponents_of_errors_that_were_not_found_are_not_judged():
    given = ("a/errors", "discrete_error", ["c"], 0.7, True)
    said = "^the algebraic error is 0.02 of D$"
    assert made_is(said, transitions.exponents, on_cells(bound=0.02), *given)
    assert made_is("of D$", transitions.exponents, on_cells(converged=0.0), *given)


def test_rates_where_each_cell_has_contact_and_a_gap():
    """1/2 and 1 over factors of 4, where (1/4 + 3/4)/2 is 1/2."""
    errors = np.array([[1.0, 9], [1 / 2, 8], [1 / 8, 7]])
    run = over(("partition", "gamma"), discrete_error=errors, algebraic_bound=0 * errors, converged=errors**0)
    of = table(run, alpha=1 / 4, gamma=[3 / 4, 1], H=("partition", [1, 1 / 4, 1 / 16]))
    assert made_is((0.5, False), transitions.attained, of, "a/errors", 0.75, 0.1)
    of["a/errors"]["discrete_error"][2] = 1 / 4
    assert made_is((0, True), transitions.attained, of, "a/errors", 0.75, 0.1)


def test_the_way_from_what_is_proved_to_the_best_approximation():
    """3/4 is at (1/2 + 1)/2, and 5/8 at (1/2 + 3/4)/2; with tau = 1/4 it is 1/4 of 5/8 above 3/8."""
    of = on_cells()
    assert made_is((0, False), transitions.beyond_theorem, of, "a/errors", ["c", "d"], 0.5)
    of["a/errors"]["gap_order"][:] = 1 / 4
    assert made_is((0.4, False), transitions.beyond_theorem, of, "a/errors", ["d"], 0.5)
    assert made_is((0.6, True), transitions.beyond_theorem, of, "a/errors", ["c"], 0.5)


def test_rates_over_the_last_factor_of_four():
    """8 to 1 and 2 to 1 from the second level to the last, 2^3 and 2^1 over 4."""
    errors = [[1.0, 8, 5, 1], [9, 2, 9, 1]]
    of = table(over(("case", "mesh"), x=errors), case=["c", "d"])
    assert made_is(0.5, rates.rate_of, of, ["a"], "x", ["c", "d", "e"], 1.0)
    assert made_is(1.5, rates.slow, of, ["a"], "x", ["c", "d", "e"], 1.0)
    of = table(over(("case", "partition"), consistency=errors), case=["c", "d"])
    assert made_is(0.5, rates.rate_of, of, ["a"], "consistency", ["d"], 1.0)


def surfaces():
    """Rates on three pairs over alpha = 0, 1/4, 1/2 and gamma = 1, 2, where 1 is predicted.

    Of consistency terms alpha + gamma + 1 is.
    """
    rate = np.ones((1, 3, 3, 2))
    rate[0, 0], rate[0, :, 0], rate[0, :, :, 1] = 0.0, 0.5, 0.25
    rate[0, 1, 1, 0], rate[0, 2, 2, 0] = 0.875, 0.9375
    alpha, gamma = np.array([0, 0.25, 0.5]), np.array([1.0, 2.0])
    predicted = alpha[:, None] + gamma + 1
    terms = np.tile(predicted, (3, 1, 1))
    terms[0] = 0
    terms[2, 1, 1] -= 0.25
    of = over(("norm", "pair", "alpha", "gamma"), rate=rate)
    of |= over(("norm", "alpha"), predicted=np.ones((1, 3)))
    of |= over(("pair", "alpha", "gamma"), consistency_rate=terms)
    of |= over(("alpha", "gamma"), consistency_predicted=predicted)
    return table(of, norm=["l2"], alpha=alpha, gamma=gamma)


def test_surfaces_are_judged_on_their_two_finest_pairs():
    """From alpha = 1/4 on and at gamma = 1 the least is 0.875, on the pair before the last."""
    assert made_is(-0.125, exponents.surface, surfaces(), "table", "l2", 0.25, [1.0], 0.1)
    assert made_is(-0.0625, exponents.surface, surfaces(), "table", "l2", 0.5, [1.0], 0.1)
    assert made_is(-0.75, exponents.surface, surfaces(), "table", "l2", 0.25, [1.0, 2.0], 0.1)


def powers(changed=(), **variables):
    """Errors H^(1 + alpha) over alpha = -1/4, 1/4, 1/2 and gamma = 1/10, 1, and `changed` ones.

    Those are factors by places (level, alpha, gamma). Predicted is 1 + alpha, left by the proof half that of
    gamma more.
    """
    H, alpha, gamma = 0.5 ** np.arange(2, 6), np.array([-0.25, 0.25, 0.5]), np.array([0.1, 1.0])
    error = np.tile(H[:, None, None] ** (1 + alpha[:, None]), (1, 1, 2))
    for place, factor in changed:
        error[place] *= factor
    of = over(("norm", "level", "alpha", "gamma"), error=np.stack([error, error]))
    of |= over(("norm", "alpha"), predicted=np.stack([1 + alpha, 1 + alpha]))
    left = 0.5 * (1 + alpha[:, None] + gamma)
    of |= over(("norm", "alpha", "gamma"), left_by_proof=np.stack([left, left])) | variables
    return table(of, norm=["hm12", "discrete"], alpha=alpha, gamma=gamma, H=("level", H))


LOWER = (np.s_[-1, 1, 0], 2**0.75)
"""Over three pairs the rate is lower by 1/4 at alpha = 1/4, gamma = 1/10."""


@pytest.mark.parametrize(
    ("changed", "observed"),
    [
        ([], 0.0),
        ([LOWER], -0.25),
        ([(np.s_[:, 0], 9)], 0.0),
        ([(np.s_[1:3], 9)], 0.0),
        ([(-1, NAN)], "not known"),
    ],
)
def test_D_has_its_rate_over_all_levels_for_alpha_above_0(changed, observed):
    """What is between the ends does not count, nor what is at alpha = -1/4."""
    assert made_is(observed, exponents.theorem_2, powers(changed), "table", 0.1)


@pytest.mark.parametrize(
    ("changed", "tolerance", "observed"),
    [([], 0.1, (0.25, True)), ([], 0.125, (0.25, True)), ([], 0.15, (0.575, True)),
     ([LOWER], 0.1, (0.25, True)), ([LOWER, LOWER], 0.1, (0.075, False))],
)  # fmt: skip
def test_D_is_compared_with_the_other_proof_where_both_are_apart(changed, tolerance, observed):
    """At gamma = 1 they are 1/8 and 1/4 apart, at 1/10 0.575 and 0.7."""
    assert made_is(observed, exponents.beyond_consistency, powers(changed), "table", tolerance)


HELD = (np.s_[:2, 1, 1], 0.5)
"""On the coarser levels; so the rate at gamma = 1 is lower at a pair, that of the largest error is not."""


@pytest.mark.parametrize(
    ("changed", "least", "most"),
    [([], 0.1, 0.0), ([HELD], 0.1, 0.0), ([(np.s_[-1, 1, 1], 2**0.25)], -0.15, 0.0),
     ([(np.s_[:2], 0.5)], -0.9, 0.0), ([(np.s_[-1, 2], 0.5)], 0.1, 1.0),
     ([(-1, NAN)], "not known", "not known")],
)  # fmt: skip
def test_the_largest_error_over_gamma_is_judged_on_the_last_pairs(changed, least, most):
    given = powers(changed)
    assert made_is(least, exponents.theorem_4, given, "table", {"hm12": 0.1})
    assert made_is(most, exponents.attained, given, "table", {"hm12": 2.0}, 0.1)


def test_rates_are_attained_up_to_an_alpha():
    given = powers([(np.s_[-1, 2], 0.5)])
    assert made_is((0.0, True), exponents.attained, given, "table", {"hm12": 0.25}, 0.1)


@pytest.mark.parametrize(
    ("place", "largest"),
    [((2, 1, 1, 0), 1.5), ((3, 2, 1, 1), 1.5), ((1, 1, 1, 0), 1.0), ((3, 0, 1, 0), 1.0)],
)
def test_errors_are_compared_with_those_of_the_smallest_gamma(place, largest):
    """At single positions on the last two levels, for alpha > 0. There no cell may be held, at 1 it may."""
    error, held = np.ones((4, 3, 2, 2)), np.zeros((4, 3, 2, 2))
    error[place], held[:, :, 1], held[:, 0], held[0] = 1.5, 1.0, 1.0, 1.0
    of = over(("level", "alpha", "gamma", "position"), l2_error=error, held=held)
    given = table(of, alpha=[-0.25, 0.25, 0.5], gamma=[0.1, 1.0])
    assert made_is(largest, exponents.released, given, "table", ["l2"], 1.5)
    held[2, 1, 0, 1] = 1.0
    assert made_is((1.0, False), exponents.released, given, "table", ["l2"], 1.5)


def test_t_may_lack_its_logarithm():
    """At alpha = 1/2 log_2 of (1 + ln 32)/(1 + ln 16), at 1/4 nothing; the first pair does not count."""
    rate = np.array([[0, 0, 0], [0, 1.125, 1.5], [0, 1.25, 1.5]])
    lacking = powers(t_rate=(("pair", "alpha"), rate))
    assert made_is((-0.125, False), exponents.superclose, lacking, "table", 0.1)
    rate[1, 1], rate[2, 2] = 2, 1.25
    lacking = powers(t_rate=(("pair", "alpha"), rate))
    taken = math.log2((1 + math.log(32)) / (1 + math.log(16)))
    assert made_is(min(0, taken - 0.25), exponents.superclose, lacking, "table", 0.1)


@pytest.mark.parametrize(("nu", "power"), [(0.25, 0), (0.5, 1), (0.9, 0.5), (INF, 0.5)])
def test_the_ritz_projection_may_lack_its_logarithm(nu, power):
    """Errors h^2, over the last factor of 4; 3/2 + nu is expected, and 2 at most."""
    h = 0.5 ** np.arange(1, 6)
    of = over(("case", "mesh"), ritz_boundary_error=[[9, 9, *h[2:] ** 2]])
    given = table(of, case=["c"], h=("mesh", h))
    taken = power * math.log((1 + math.log(32)) / (1 + math.log(8))) / math.log(4)
    expected = 2 - min(2, 1.5 + nu) + taken
    assert made_is(expected, exponents.proposition_3, given, ["a"], {"c": nu, "e": 1.0}, 0.1)


@pytest.mark.parametrize(
    ("changed", "observed"),
    [({}, 1.0), ({"ritz_means": 0.25, "consistency": 0.5}, 1.25), ({"discrete_error": 5.0}, 2.0),
     ({"beta_lower": 0.0}, "nothing of which"), ({"discrete_error": 0.0}, "nothing of which")],
)  # fmt: skip
def test_lemma_1_by_hand(changed, observed):
    """m = 1, k = min(0.5/0.5, 9/0.5) = 1, c = 1/4: D^2 = D + (1 + D) + 1/4 at D = 5/2.

    With k = 0.25/0.5 and c = 1/2 it is at 2. beta counts from above. Where beta or D is 0 nothing is judged.
    """
    values = {"discrete_error": 2.5, "ritz_means": 9.0, "beta_lower": 0.4, "beta_upper": 0.5, "beta_0": 0.5}
    values |= {"ritz_error": 0.5, "u_norm": 1.0, "consistency": 0.25} | changed
    of = over(RUN, **{name: [[[values[name]]]] for name in ("discrete_error", "ritz_means")})
    of |= over(
        ("mesh", "partition"), **{name: [[values[name]]] for name in ("beta_lower", "beta_upper", "beta_0")}
    )
    of |= over(("case", "mesh"), **{name: [[values[name]]] for name in ("ritz_error", "u_norm")})
    of |= over(("case", "partition"), consistency=[[values["consistency"]]])
    forms = forms_of([0, 0, 0, 0, 1.0], 5 * [9.0])
    assert made_is(observed, exponents.lemma_1, table(forms | of, case=["c"], H=("partition", [1.0])), ["a"])


def test_rates_of_the_consistency_term_may_not_be_lower_either():
    assert made_is(0.25, exponents.consistency_surface, surfaces(), "table", 0.1)


# The estimates


def test_a_negative_consistency_term_is_none():
    """And 1e-12 is allowed."""
    of = over(("case", "partition"), consistency_elsewhere=[[1e-16, -0.5], [0.25, 0]])
    assert made_is((0.5, False), estimates.no_consistency, table(of, case=["c", "d"]), ["a"])
    of = over(("case", "partition"), consistency_elsewhere=[[1e-16, -0.9e-12]])
    assert made_is((0.9e-12, True), estimates.no_consistency, table(of, case=["c"]), ["a"])


def levels(**errors):
    """Errors at H = 2h on three levels; at H = h they grow."""
    h, H = 0.5 ** np.arange(3), np.array([2, 1, 0.5, 0.25])
    of = {name: np.full((1, 3, 4), NAN) for name in errors}
    for name, values in errors.items():
        of[name][0, np.arange(3), np.arange(3)] = values
        of[name][0, np.arange(3), np.arange(1, 4)] = [1, 10, 100]
    return table(over(RUN, **of) | over(PAIRS, h_over_H=h[:, None] / H), case=["c"])


@pytest.mark.parametrize(
    ("h1", "lower", "observed"),
    [([4, 2, 1], [8, 2, 1.5], 0.75), ([4, 5, 1], [8, 2, 1], 1.25), ([4, 2, 1], [1, 2, 1], 2)],
)
def test_errors_have_to_fall_on_every_level_in_both_norms(h1, lower, observed):
    of = levels(h1_error=h1, hm12_error_lower=lower)
    assert made_is(observed, estimates.keeps_falling, of, ["a"], "c", 2)


def test_a_decrease_is_from_the_lower_bound_to_the_upper_one():
    """From at least 8 to at most 2."""
    of = levels(hm12_error_lower=[8, 1, 1], hm12_error_upper=[9, 1, 2])
    assert made_is(0.25, estimates.decrease, of, ["a"], ["c", "e"], 2, 0.1)


def forms_of(lower, upper, **others):
    """What a table of the dual norm on the unit square has, one case, by diagonals of its forms."""
    cells = len(lower) - 1
    of = {"points": ("point", np.arange(cells + 1) * 4 / cells), "polygon": ((), "square")}
    of |= over(("case", "cell"), lambda_means=np.zeros((1, cells))) | over("case", oscillation=[0.0])
    of |= over(("functional", "functional_too"), norm_lower=np.diag(lower), norm_upper=np.diag(upper))
    return of | others


def forms_of_L2(n, H):
    """||.||_0 in the place of the dual norm, n cells a side, lambda = 4 s mod 1."""
    size = np.append(np.full(4 * n, 1 / n), 4 * 16 / n**2 / 12)
    means = (("case", "cell"), [np.tile(4 * (np.arange(n) + 0.5) / n % 1, 4)])
    return table(forms_of(0.5 * size, 1.5 * size, lambda_means=means), case=["c"], H=("partition", H))


@pytest.mark.parametrize(("coarsest", "observed"), [(1.0, -0.75), (0.25, 0.25)])
def test_rates_of_the_projection_count_from_a_size_on(coarsest, observed):
    """lambda - Pi_H lambda, of slope 4, has the norm 4 * 2H/12^(1/2) for H <= 1/4, and no other for larger H.

    So rates are 1 and 0, less the expected 3/4. On H = 1/32 there is no form.
    """
    given = forms_of_L2(16, 0.5 ** np.arange(6)), ["a"], {"c": 0.75, "e": 9}, coarsest, 0.1
    assert made_is(pytest.approx(observed), estimates.projection, *given)


def test_forms_are_known_on_the_partitions_that_they_refine():
    known = evidence.forms(forms_of_L2(4, [1, 1 / 4, 1 / 8]), "a")
    assert [cells.n_cells for cells, _ in known] == [4, 16]
    assert {cells.polygon.name for cells, _ in known} == {square().name}
    of = forms_of_L2(4, [1])
    of["a/dual_norm"] = of["a/dual_norm"].assign(points=("point", np.arange(17) / 2), polygon="lshape")
    assert [cells.polygon.name for cells, _ in evidence.forms(of, "a")] == [named("lshape").name]


@pytest.mark.parametrize(
    ("E", "L", "c", "observed"),
    [(1.0, 1.0, 0.5, 1.0), (1.0, 0.0, 0.5, 1.25), (1.0, 1.0, 0.0, 2.0), (2.0, 1.0, 0.5, 4 / 1.3)],
)
def test_the_abstract_bound_by_hand(E, L, c, observed):
    """E^2 = 1 over (E + L) r + m E + c = 2 * 0.2 + 0.1 + 0.5, where m is what oscillates, 0.1, alone.

    A finer mesh with the error 9, whose L is not known, is not judged.
    """
    of = over(RUN, h1_error=[[[E], [9.0]]], hm12_error_upper=[[[L], [NAN]]])
    of |= over(("case", "mesh"), ritz_error=[[0.2, 0.2]]) | over(("case", "partition"), consistency=[[c]])
    forms = forms_of(5 * [0.0], 5 * [0.0], oscillation=("case", [0.1]))
    made = table(forms | of, case=["c"], H=("partition", [1.0]))
    assert made_is(observed, estimates.abstract_bound, made, ["a"], ["c", "e"])


def runs(**changed):
    """Two runs of equal numbers, H = 1/4 and 1/16, but for those of the second that are `changed`."""
    of = over(RUN, h1_error=0.125, l2_error=1.25, hm12_best=0.125, discrete_error=0.1)
    of |= over(RUN, hm12_error_lower=0.5, hm12_error_upper=0.625)
    of |= over(("case", "partition"), projection_error=0.25, consistency=0.046875)
    of |= over(("case", "mesh"), ritz_error=0.25, u_norm=1.0)
    of |= over(PAIRS, beta_0=0.5, beta_lower=0.75, beta_upper=1.0)
    for name, (dims, value) in of.items():
        values = np.full([2 if d == "partition" else 1 for d in dims], value)
        if "partition" in dims:
            values[..., 1] = changed.get(name, value)
        of[name] = (dims, values)
    return table(of, case=["c"], H=("partition", [1 / 4, 1 / 16]))


EXACT = {"l2_error": 1e-13, "projection_error": 0.0, "h1_error": 0.0, "hm12_best": 1e-14}


@pytest.mark.parametrize(
    ("changed", "observed"),
    [({}, 1.0), ({"l2_error": 3.375}, 1.5), ({"l2_error": 9.0, "beta_0": 0.0}, 1.0), (EXACT, 1.0)],
)
def test_the_bound_of_the_multiplier_in_L2_by_hand(changed, observed):
    """1.25 = 1/4 + (1/8 + 1/8)/(1/2 * (1/4)^(1/2)), an equality; with H = 1/16 the right side is 2.25.

    Where beta_0 is 0, and where the error is, to round-off, there is nothing to judge.
    """
    assert made_is(observed, estimates.multiplier_bound, runs(**changed), ["a"])


def one_cell_a_side(lambda_means, gap_means, **runs):
    """The unit square with a cell a side; diag(1) and diag(4) for the norm, 1/4 for lambda - Pi_H lambda.

    The numbers of the runs are those of two meshes. beta is 1 on the first one and 0 on the other.
    """
    of = over(("case", "cell"), lambda_means=[lambda_means], gap_means=[gap_means])
    made = forms_of([1, 1, 1, 1, 0.25], [4, 4, 4, 4, 0.25], **of)
    made |= over(RUN, **{name: [[[each] for each in values]] for name, values in runs.items()})
    made |= over(PAIRS, beta_upper=[[1.0], [0.0]]) | over(("case", "partition"), projection_error=[[0.25]])
    made |= over(("case", "mesh"), ritz_error=[[1.0, 1.0]], u_norm=[[1.0, 1.0]])
    return table(made, case=["c"], H=("partition", [1.0]))


@pytest.mark.parametrize(("l2", "observed"), [([0.75, NAN], 1.0), ([0.75, 1.5], 2.0), ([0.75, 1e-13], 1.0)])
def test_the_bound_of_the_multiplier_by_the_inverse_estimate_by_hand(l2, observed):
    """C = 1/4^(1/2), from the larger form; 0.75 = 0.25 + C (0.5 + 0.25^(1/2)), all with H = 1.

    Where the error is not known, or is 0 to round-off, there is nothing to judge.
    """
    made = one_cell_a_side([0, 0, 0, 0], [0, 0, 0, 0], l2_error=l2, hm12_error_lower=[0.5, 0.5])
    assert made_is(observed, estimates.by_inverse_estimate, made, ["a"])


@pytest.mark.parametrize(
    ("lambda_means", "gap_means", "square", "observed"),
    [
        ([2.0, 0.0, 0.0, 0.0], [1.0, 3.0, 3.0, 3.0], 12.0, 1.0),
        ([2.0, 0.0, 0.0, 0.0], [8.0, 3.0, 3.0, 3.0], 21.0, 1.0),
        ([0.0, 0.0, 2.0, 1.0], [1.0, 3.0, 0.0, 0.0], 2.5, 0.5),
    ],
)
def test_quasi_optimality_by_hand(lambda_means, gap_means, square, observed):
    """c = 1 + 3/1 before 1 + 1/4 + inf (2 - mu)^2 + mu w: mu is 3/2 for w = 1, and 0, not -2, for w = 8.

    So that is 2 + 1 and 4.25 + 1; with complementary means mu = Pi_H lambda leaves 1/4 + 1. Infima of both
    terms apart would be 0 in each case. The other mesh, with beta = 0 and the error 99, is not judged.
    """
    made = one_cell_a_side(lambda_means, gap_means, h1_error=[math.sqrt(square), 99.0])
    assert made_is(pytest.approx(observed), estimates.quasi_optimal, made, ["a"], 4)
    with pytest.raises(Unjudged):
        estimates.quasi_optimal(made, ["a"], 3)


def test_the_infimum_over_multipliers_is_a_quadratic_programme():
    """Against Clarabel, another method, with a form that is not diagonal and random data."""
    rng = np.random.default_rng(0)
    half = rng.standard_normal((17, 17))
    form, w, means = half.T @ half, rng.random(16), rng.random((1, 16))
    of = forms_of(
        17 * [1.0], 17 * [1.0], lambda_means=(("case", "cell"), means), gap_means=(("case", "cell"), [w])
    )
    dual = xr.Dataset(of | over(("functional", "functional_too"), norm_lower=form))
    gram, cells = Gram.of_table(dual), uniform(square(), 1 / 4)
    P, q = 2 * form[:16, :16], -2 * (form[:16, :16] @ means[0] + form[:16, 16]) + w / 4
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cone = [clarabel.NonnegativeConeT(16)]
    upper, minus = sp.csc_matrix(np.triu(P)), sp.csc_matrix(-np.eye(16))
    mu = clarabel.DefaultSolver(upper, q, minus, np.zeros(16), cone, settings).solve().x
    x = np.append(means[0] - np.array(mu), 1.0)
    assert estimates.infima(dual, cells, gram)[0] == pytest.approx(x @ form @ x + w @ mu / 4, rel=1e-7)


@pytest.mark.parametrize(("upper", "observed"), [(0.625, 5 / 3), (0.75, 2.0), (0.1, 5 / 3)])
def test_lemma_4_3_is_judged_by_its_worst_run(upper, observed):
    """0.625 over (1 + 1/beta)/8 + 1/(8 beta) with beta = 1."""
    assert made_is(observed, estimates.lemma_4_3, runs(hm12_error_upper=upper), ["a"])


# The extremes


def points(**values):
    """On an axis a, the sixth one on another."""
    n = len(values["value"])
    return table(over("point", axis_of=5 * ["a"] + ["b"] if n == 6 else n * ["a"], **values))


@pytest.mark.parametrize(("exponent", "observed"), [(-2, 0), (-1, 1), (-3, 1)])
def test_the_slope_is_fitted_below_a_value_on_its_axis(exponent, observed):
    """3 x^-2 on x = 1/4, 1/8, 1/32 has the slope -2; what is coarser, not known or elsewhere is not in it."""
    of = points(value=[1, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64], measured=[9, 48, 192, NAN, 3072, 1])
    near = pytest.approx(observed, abs=1e-12)
    assert made_is(near, extremes.power, of, "table", "a", 0.25, exponent, 0.1)


def test_a_slope_needs_two_numbers():
    of, said = points(value=[0.5, 0.25], measured=[1, NAN]), "fewer than two numbers are known on the axis a"
    assert made_is(said, extremes.power, of, "table", "a", 1.0, -2, 0.1)


def test_the_first_step_that_fails_is_the_measured_one():
    of = table(over("axis", measured_limit=[1.5, 1.0], predicted_limit=[1.0, 1.0]), axis=["a", "b"])
    assert made_is((1.5, True), extremes.step_beyond, of, "table", "a", 1.01)


def axes(**changed):
    """A table of two axes, the first upwards with a limit, the second downwards without."""
    of_point = {
        "axis_of": ["up", "up", "down", "down"],
        "value": [1.0, 2.0, 1.0, 0.5],
        "outcome": [RIGHT, NOT_CONVERGED, RIGHT, REFUSED],
        "tool": [RIGHT, RIGHT, RIGHT, REFUSED],
        "true_error": [0.5, 0.5, 1.05, NAN],
        "guaranteed": [1.0, 1.0, 1.0, NAN],
        "allowance": [0.1, 0.1, 0.1, NAN],
    }
    of_axis = {"predicted_limit": [1.999, NAN], "measured_limit": [2.0, NAN]}
    of_axis |= {"predicted_tool_limit": [NAN, NAN], "measured_tool_limit": [NAN, NAN]}
    point, axis = ({name: changed.get(name, of[name]) for name in of} for of in (of_point, of_axis))
    return table(over("point", **point) | over("axis", **axis), axis=["up", "down"])


def by_another(error, bound):
    """Of the last point, that one solver refuses, numbers by another one."""
    return {
        "true_error": [0.5, 0.5, 1.05, error],
        "guaranteed": [1.0, 1.0, 1.0, bound],
        "allowance": 4 * [0.1],
    }


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        ({}, 0),
        ({"true_error": [0.5, 1.2, 1.05, NAN]}, 1),
        ({"true_error": [0.5, NAN, 1.05, NAN]}, 1),
        ({"outcome": [WRONG, RIGHT, RIGHT, REFUSED]}, 1),
        ({"guaranteed": [1.0, INF, 1.0, NAN]}, 1),
        ({"allowance": [0.1, INF, 0.1, NAN]}, 1),
        (by_another(0.5, 1.0), 0),
        (by_another(2.0, 1.0), 1),
        (by_another(NAN, 1.0), 1),
        (by_another(0.5, INF), 1),
    ],
)
def test_the_check_of_outcomes_recomputes_them(changed, wrong):
    assert made_is(wrong, extremes.outcomes, axes(**changed), "table")


@pytest.mark.parametrize(
    ("changed", "early"),
    [
        ({}, 0),
        ({"predicted_limit": [2.001, NAN]}, 1),
        ({"measured_limit": [2.0, 0.5]}, 1),
        ({"measured_tool_limit": [2.0, NAN]}, 1),
        ({"measured_tool_limit": [NAN, 1.0]}, 1),
        ({"predicted_limit": [1.999, NOTHING], "measured_limit": [2.0, 1.0]}, 0),
    ],
)
def test_a_limit_met_early_or_where_all_was_promised_counts(changed, early):
    """Where nothing is promised nothing is early."""
    assert made_is(early, extremes.no_earlier, axes(**changed), "table")


@pytest.mark.parametrize(
    ("limit", "outcome", "distance", "expected"),
    [
        (1.5, (RIGHT, NOT_CONVERGED), 1 / 3, 0),
        (1.5, (RIGHT, RIGHT), 1 / 3, 1),
        (1.5, (REFUSED, NOT_CONVERGED), 1 / 3, 1),
        (2.5, (RIGHT, NOT_CONVERGED), 0.2, 1),
        (1.5, (RIGHT, NOT_CONVERGED), 0.1, r"^0\.9 of the limit was not tried on the axis up"),
    ],
)
def test_steps_on_the_wrong_side_of_their_limit_count_if_it_was_tried_next_to_it(
    limit, outcome, distance, expected
):
    made = axes(predicted_limit=[limit, NAN], outcome=[*outcome, RIGHT, REFUSED])
    assert made_is(expected, extremes.step_limit, made, "table", {"up": distance})


@pytest.mark.parametrize(
    ("measured", "observed"),
    [
        ([2.0, 16.0], 0),
        ([2.0, 26.0], 1),
        ([0.19, 5.0], 1),
        ([2.0, 8.0], 1),
        ([3.0, 3.0], 1),
        ([2.0, NAN], 1),
    ],
)
def test_floors_are_within_a_factor_and_outgrow_their_predictions(measured, observed):
    of = points(value=[1.0, 0.5], predicted=[1.0, 4.0], measured=measured)
    assert made_is(observed, extremes.floor, of, "table", "a", 5.0)


# Stability


def test_values_that_are_not_known_are_not_judged_unless_none_is():
    of = over(("case", "step"), x=[[3.0, NAN], [4.0, 5.0]]) | over("case", y=[NAN, NAN])
    of, chosen = table(of, case=["c", "d"], step=[0, 1]), {"case": ["c"], "mesh": 0}
    assert made_is(3, shared.values, of, "table", "x", 1.0, True)
    assert made_is(5, shared.values, of, "{scene}/errors", "x", 1.0, False, ["a"])
    assert made_is(3, shared.values, of, "table", "x", 1.0, False, select=chosen)
    assert made_is("y is not known of table", shared.values, of, "table", "y", 1.0, True)
    assert made_is(3, shared.smallest, of, "{scene}/errors", ["a"], ["x"], 1.0, "")


def test_the_smallest_value_at_a_ratio_counts():
    of = table(over(PAIRS, x=[[5.0, 1.0], [9.0, 4.0]], h_over_H=[[0.5, 1], [0.25, 0.5]]))
    assert made_is(4, shared.at_ratio, of, "{scene}/errors", ["a"], "x", 2, 0.5)


@pytest.mark.parametrize(
    ("ratio", "expected"),
    [([0.5, 1, 2], 0.25), ([0.5, 0.75, 2], 0.125), ([0.5, 0.5, 0.5], "at H <= h is")],
)
def test_eigenvalues_have_to_vanish_from_H_equal_to_h_on(ratio, expected):
    """lambda_min/lambda_max is 1, 1/4, 1/8; without such a pair nothing is judged."""
    of = over(PAIRS, lambda_min=[[2.0, 1.0, 0.5]], lambda_max=[[2.0, 4.0, 4.0]], h_over_H=[ratio])
    assert made_is(expected, stability.vanishes, table(of), ["a"])


@pytest.mark.parametrize(
    ("lower", "upper", "observed"), [(1.0, 1.0, 0.0), (0.8, 1.2, 0.5), (1.25, 1.25, 0.25), (0.75, 0.75, 0.25)]
)
def test_bounds_of_the_norm_of_1_enclose_it_and_are_close(lower, upper, observed):
    """Diagonal forms in which 1 on four cells has that multiple of the norm, by e^s in place of coth."""
    quarter = 2 + (math.e + 1) / (math.e - 1)
    of = table(forms_of(5 * [lower**2 * quarter], 5 * [upper**2 * quarter]))
    assert made_is(observed, estimates.closed_form, of, "a")


def test_the_inverse_estimate_in_a_norm_in_which_it_is_known():
    """In ||.||_0/2^(1/2), from below, C = (2H)^(1/2): 2^(1/2) for H = 1, times 1/4, and 2^(-1/2), times 1.

    H = 1/4 is with h = 1/8 as with 1/16, of which only the first counts; H = 1/2 is on no mesh with H = 2h.
    """
    of = forms_of_L2(4, [1, 1 / 2, 1 / 4])
    ratios = over(PAIRS, h_over_H=[[1 / 2, 1.0, 2.0], [1 / 8, 1 / 4, 1 / 2], [1 / 16, 1 / 8, 1 / 4]])
    of["a/errors"] = of["a/errors"].assign(
        **ratios, **over(PAIRS, beta_0=[[0.25, 9, 9], [9, 9, 1.0], [9, 9, 9]])
    )
    made = estimates.inverse_estimate(of, ["a"], 2)
    assert made.observed == pytest.approx(math.sqrt(0.5))
    assert [line.strip() for line in made.lines] == [
        f"a, H = {H:g}: C = {math.sqrt(2 * H):.4g}" for H in (1, 0.25)
    ]


@pytest.mark.parametrize(
    ("ratios", "angles", "expected"),
    [
        ([2.0, 1.9, 3.0], [45.0, 45, 19], 0.9),
        ([2.0, 2.0, 3.0], [45.0, 20, 19], 0.5),
        ([2.0, 1.9, 3.0], [45.0, 45, 20], 0.25),
        ([2 - 1e-10, 1, 1], [45.0, 45, 45], 0.9),
        ([1.0, 1, 1], [45.0, 45, 45], "nothing of which to find the smallest beta"),
    ],
)
def test_the_local_rule_asks_for_short_edges_and_no_flat_triangles(ratios, angles, expected):
    """beta is 0.9, 0.5, 0.25; a cell of 2 edges, to round-off, and an angle of 20 degrees are enough."""
    of = over(PAIRS, beta_lower=[[0.9, 0.5, 0.25]], cell_over_edge=[ratios], smallest_angle=[angles])
    assert made_is(expected, stability.local_rule, table(of), ["a"], 0.7)


@pytest.mark.parametrize(
    ("deltas", "ratios", "angles", "expected"),
    [
        ([0.5, 0.5, 0.5], [1.0, 1, 1], [45.0, 45, 45], 0.3),
        ([0.5, 0.25, 0.1], [1.0, 1, 1], [45.0, 45, 45], 0.6 / 0.75),
        ([0.5, 0.25, 0.5], [1.0, 1, 10.1], [45.0, 45, 45], 0.6 / 0.75),
        ([0.5, 0.25, 0.5], [10.0, 1, 1], [45.0, 20, 19.9], 0.6 / 0.75),
        ([0.5, 0, 0], [1.0, 1, 1], [45.0, 45, 45], 0.9),
        ([0.0, 0, 0], [1.0, 1, 1], [45.0, 45, 45], "nothing of which to find the smallest beta_lower"),
    ],
)
def test_the_rule_of_inner_nodes_asks_for_delta_comparable_cells_and_no_flat_triangles(
    deltas, ratios, angles, expected
):
    """beta is 0.9, 0.6, 0.3; over 4 delta (1 - delta), which is 1, 0.75, 0.36 at 1/2, 1/4, 1/10."""
    of = over(PAIRS, beta_lower=[[0.9, 0.6, 0.3]], delta=[deltas], alpha_1=[ratios], smallest_angle=[angles])
    assert made_is(expected, stability.inner_nodes, table(of), ["a"], "beta_lower", 0.5, 10.0, 20.0)


@pytest.mark.parametrize(
    ("deltas", "expected"),
    [([0.5, 0.32], 2.0), ([0.5, 0.0], 2.0), ([0.125, 0.32], 5.0), ([0.0, 0.0], "nothing of which")],
)
def test_the_pairing_is_judged_where_every_cell_has_an_inner_node(deltas, expected):
    """The bound, delta/4, is 1/8 at 1/2, 0.08 at 0.32, 1/32 at 1/8."""
    found = [[0.25 if delta else np.nan for delta in deltas]]
    found[0][1] = 0.4 if deltas[1] else np.nan
    of = over(PAIRS, pairing=found, delta=[deltas])
    assert made_is(expected, stability.pairing, table(of), ["a"])


@pytest.mark.parametrize(
    ("bounds", "expected"), [([0.25, 0.1], 2.0), ([0.0, 0.1], 4.0), ([0.0, 0.0], "nothing of which")]
)
def test_a_certified_constant_is_judged_where_there_is_one(bounds, expected):
    of = over(PAIRS, beta_0_cellwise=[[0.5, 0.4]], beta_0_certified=[bounds])
    assert made_is(expected, stability.certified, table(of), ["a"])


@pytest.mark.parametrize(("last", "expected"), [(0.2, 0.0), (0.1, 1.0), (0.4, 1.0)])
def test_near_the_ends_beta_falls_with_the_cells_from_both_sides(last, expected):
    """beta of 0.4 at delta = H = 1/2 and of 0.2 at 1/4 is of the order 1; so it is at the least delta."""
    beta = [[0.4, 9.0], [9.0, last], [0.3, 0.15]]
    of = over(PAIRS, beta_lower=beta, delta=np.outer([0.5, 0.25, 0.01], [1, 1]))
    assert made_is(expected, stability.near_ends, table(of, H=("partition", [0.5, 0.25])), "a", 0.1)


@pytest.mark.parametrize(("edges", "expected"), [(2.0, 0.5), (3.0, "with 3 edges in every cell is not")])
def test_edges_alone_are_judged_where_every_cell_has_them(edges, expected):
    of = table(over(PAIRS, beta_upper=[[0.25, 0.5]], edges_per_cell=[[1.0, 2 - 1e-10]]))
    assert made_is(expected, stability.edges_alone, of, "a", edges, 0.35)


def test_near_is_from_either_side():
    assert made_is(0.25, shared.near, table(over("case", x=[2.125, 1.5])), "table", "x", 2.0, 1e-6, "")


@pytest.mark.parametrize(("in_v", "in_mu", "observed"), [(1, 1, 1), (-0.5, 1, -0.5), (1, -0.5, -0.5)])
def test_a_saddle_grows_in_both_variables(in_v, in_mu, observed):
    of = table(over("case", saddle_in_v=[1.0, in_v], saddle_in_mu=[1.0, in_mu]), case=["c", "d"])
    assert made_is(observed, algorithm.saddle, of, "table")


@pytest.mark.parametrize(
    ("violation", "distance", "expected"),
    [(1e-15, 0.5, (1e-14, True)), (1e-3, 0.5, (1e-3, False)), (1e-15, 0.05, (0.05, False))],
)
def test_two_multipliers_are_two_only_if_they_are_apart(violation, distance, expected):
    of = table(over((), violation=violation, same_u=1e-14, multiplier_distance=distance))
    assert made_is(expected, algorithm.two_multipliers, of, "table", 0.1)


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (1.0, 1.5, (0.5, True)),
        (1.0, 0.75, (-0.25, False)),
        (1e-14, 1e-13, (0.25, True)),
        (1e-10, 2e-10, (1.0, False)),
        (NAN, NAN, (0.25, True)),
    ],
)
def test_bounds_that_cross_have_no_gap(lower, upper, expected):
    """Beside 1 and 1.25. Errors that are 0 to round-off, or not known, have none that counts."""
    of = over(RUN, hm12_error_lower=[[[1.0, lower]]], hm12_error_upper=[[[1.25, upper]]])
    assert made_is(expected, estimates.gap, table(of | over(("case", "mesh"), u_norm=[[1.0]])), ["a"], 0.75)
