"""What a search concludes from numbers of its levels, which are made up here."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from unilateral.adaptive import forecast
from unilateral.adaptive.forecast import (
    OVERHEAD_UNKNOWNS,
    RATE_LIMITS,
    allowed_unknowns,
    bytes_per_unknown,
    find_limits,
    observed_rate,
    predict_seconds,
)
from unilateral.adaptive.goal import Goal
from unilateral.adaptive.level import (
    ALGEBRAIC_SHARE,
    BELOW_ROUNDING,
    NOT_ENCLOSED,
    ZERO_SOLUTION_BOUND,
    contradict,
    find_fault,
    is_limited_by_data,
    measure_level,
    select_consistent,
)
from unilateral.adaptive.loop import make_search
from unilateral.adaptive.marking import LAMBDA_RATE, TARGET_SHARE, target_bound_ratio
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.form import Form
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_structured_mesh

LARGE_SQUARE = Polygon(2 * square().vertices, "large")


class Made(DiscreteSolution):
    """A solution with the numbers of a dictionary, on a mesh of the square with sides of 2."""

    def __init__(self, **numbers):
        expected = {"u_norm": 1.0, "lambda_norm": 1.0, "u_integral": 0.0, "force": 0.0}
        expected |= {
            "u": 0.1,
            "lambda_": 0.1,
            "algebraic": 0.0,
            "irreducible": 0.0,
            "growth": 1.0,
            "unknowns": 9,
        }
        expected |= numbers
        mesh = SimpleNamespace(
            exact_mesh_factor=expected.pop("growth"),
            n_nodes=expected.pop("unknowns"),
            areas=make_structured_mesh(LARGE_SQUARE, 1).areas,
            polygon=LARGE_SQUARE,
        )
        data = {
            "mesh": mesh,
            "form": Form(),
            "partition": SimpleNamespace(polygon=LARGE_SQUARE),
            "cells": [0],
            "beta": 0.5,
        }
        bound = SimpleNamespace(
            u=expected.pop("u"),
            lambda_=expected.pop("lambda_"),
            irreducible_remainder=expected.pop("irreducible"),
        )
        result = SimpleNamespace(bound=expected.pop("algebraic"), converged=True)
        vars(self).update(result=result, local_bound=bound, sharp_bound=bound, **data | expected)


def level(goal=None, seconds=1.0, **numbers):
    costs = {
        name: numbers.pop(name)
        for name in ("elapsed", "peak_mb", "enclosing_seconds", "predicted")
        if name in numbers
    }
    level = measure_level(Made(**numbers), goal or Goal(0.2), costs.pop("predicted", math.inf))
    return replace(level, seconds=seconds, **costs)


def test_the_norm_of_the_solution_is_below_the_discrete_one_by_the_error():
    """||u|| >= ||u_h|| / growth - bound, never below 0; likewise for lambda with its own numbers."""
    solved = Made(u_norm=3.0, u=0.5, lambda_norm=7.0, lambda_=2.0, growth=1.25)
    assert solved.norm_lower_bound("h1") == pytest.approx(3 / 1.25 - 0.5)
    assert solved.norm_lower_bound("h1") < (3 / 1.25) * (1 - 0.9 * SQUARES_ROUNDING) - 0.5
    assert solved.norm_lower_bound("hm12") == pytest.approx(7 / 1.25 - 2.0)
    assert Made(u_norm=1.0, u=2.0).norm_lower_bound("h1") == 0.0


def test_the_algebraic_error_of_lambda_is_divided_by_beta():
    solved = Made(algebraic=0.3)
    assert (solved.algebraic_bound("h1"), solved.algebraic_bound("hm12")) == (0.3, 0.6)
    assert Made(algebraic=0.3, beta=0.0).algebraic_bound("hm12") == math.inf


@pytest.mark.parametrize("norm", ["h1", "hm12"])
@pytest.mark.parametrize(("bound", "certified"), [(0.19, True), (0.21, False)])
def test_a_relative_accuracy_is_one_of_the_lower_bound_on_the_norm(norm, bound, certified):
    """The discrete norm is 1 + bound, so the solution's is at least 1; the other norm is far off."""
    norm_bounds = {
        "h1": {"u": bound, "u_norm": 1 + bound},
        "hm12": {"lambda_": bound, "lambda_norm": 1 + bound},
    }
    second = {"h1": {"lambda_": 9.0, "lambda_norm": 0.0}, "hm12": {"u": 9.0, "u_norm": 0.0}}
    assert level(Goal(0.2, norm), **norm_bounds[norm], **second[norm]).certified == certified


def test_nothing_is_certified_relative_to_a_norm_that_may_be_0():
    """||u|| >= 1 / 1.2 - 0.85, which is below 0, though 0.85 is less than 0.9 of the discrete norm, 1."""
    unsure = {"u_norm": 1.0, "growth": 1.2, "u": 0.85}
    assert level(Goal(0.9), **unsure).target == pytest.approx(0.9)
    assert not level(Goal(0.9), **unsure).certified
    assert level(Goal(0.9, absolute=True), **unsure).certified
    assert not level(Goal(0.8, absolute=True), **unsure).certified


@pytest.mark.parametrize(("share", "certified"), [(0.9, True), (1.1, False)])
def test_the_iteration_has_a_tenth_of_the_wanted_error(share, certified):
    assert level(u_norm=1.1, u=0.1, algebraic=share * ALGEBRAIC_SHARE * 0.2).certified == certified


@pytest.mark.parametrize(("bound", "certified"), [(0.9 * ZERO_SOLUTION_BOUND, True), (1e-100, False)])
def test_a_solution_of_0_is_certified_by_a_bound_that_is_next_to_nothing(bound, certified):
    assert level(u_norm=0.0, u=bound).certified == certified


@pytest.mark.parametrize(
    ("first", "second", "report"),
    [
        ({"u_norm": 1.0}, {"u_norm": 1.21}, True),
        ({"u_norm": 1.0}, {"u_norm": 1.19}, False),
        ({"u_integral": 0.0}, {"u_integral": 0.41}, True),
        ({"u_integral": 0.0}, {"u_integral": 0.39}, False),
        ({"force": 0.0}, {"force": 0.41}, True),
        ({"force": 0.0}, {"force": 0.39}, False),
    ],
)
def test_bounds_contradict_each_other_if_numbers_are_too_far_apart(first, second, report):
    """Both bounds are 0.1; an integral over an area of 4 is at most 2 times the norm.

    The bound on the error that the number does not belong to may be huge.
    """
    assert contradict(level(**first), level(**second)) == report
    unused = {"u": 9.0} if "force" in first else {"lambda_": 9.0}
    assert contradict(level(**first, **unused), level(**second, **unused)) == report


@pytest.mark.parametrize(("number", "maximum"), [("u_integral", 0.04), ("force", 4.0)])
def test_with_a_reaction_the_norm_of_constants_decides(number, maximum):
    """c = 100: |int v| <= (4 / 100)^(1/2) ||v||, |<mu, 1>| <= (4 100)^(1/2) ||mu||; both bounds are 0.1."""
    form = Form(c=100.0)
    for far, report in ((0.99, False), (1.01, True)):
        second = {number: far * maximum}
        assert contradict(level(form=form), level(form=form, **second)) == report


def test_norms_on_different_meshes_may_differ_by_their_growth():
    """1 and 1.4 are apart by 0.4: 0.2 by the bounds, and 1.1^2 - 1 of 1.4 by the exact meshes."""
    far = {"u_norm": 1.4, "growth": 1.1}
    assert not contradict(level(growth=1.1), level(**far))
    assert contradict(level(), level(u_norm=1.4))


def test_of_two_levels_that_contradict_none_is_believed():
    levels = [level(), level(u_norm=1.1), level(u_norm=5.0, u=0.01)]
    assert select_consistent(levels) == []
    assert select_consistent(levels[:2]) == levels[:2]
    search_result = make_search(levels, "bounds contradict each other")
    assert search_result.believed == []
    assert search_result.best is levels[-1]
    assert not search_result.certified
    assert levels[-1].certified


def test_the_best_level_is_certified_before_it_is_small():
    """The last one of those that are; of others that with the smallest bound."""
    certified = level(u_norm=1.1, u=0.1)
    smaller = level(u_norm=1.05, u=0.05, algebraic=1.0)
    assert make_search([certified, smaller], "").best is certified
    assert make_search([certified, smaller], "").certified
    assert make_search([level(u=0.9), smaller], "").best is smaller


@pytest.mark.parametrize(("irreducible", "report"), [(0.21, True), (0.19, False), (0.0, False)])
def test_what_stays_unknown_may_exceed_the_wanted_error(irreducible, report):
    """0.2 of the norm, at least 1."""
    assert is_limited_by_data(level(u_norm=1.1, u=0.1, irreducible=irreducible)) == report


@pytest.mark.parametrize(("irreducible", "why"), [(1e-9, NOT_ENCLOSED), (1e-11, BELOW_ROUNDING)])
def test_an_accuracy_below_rounding_is_not_blamed_on_the_data(irreducible, why):
    """Both exceed 1e-30 of a norm of 1; formulas without terms that cancel are known up to 1e-11 of it."""
    assert find_fault([level(Goal(1e-30), u_norm=1.1, u=0.1, irreducible=irreducible)]) == why


@pytest.mark.parametrize(("bound", "missed"), [(0.1, 1.0), (0.12, 1.2), (0.3, 1.5), (0.01, 0.9)])
def test_the_next_bound_is_taken_to_miss_as_the_last_one_did(bound, missed):
    """Between 0.9 and 1.5; what is wanted is 0.2 absolutely."""
    last = level(Goal(0.2, absolute=True), predicted=0.1, u=bound)
    assert target_bound_ratio(last) == pytest.approx(TARGET_SHARE * 0.2 / (bound * missed))


def test_the_bound_of_lambda_falls_like_the_unknowns_to_a_power():
    """A part p of the bound takes p^(-1 / LAMBDA_RATE) times the unknowns; for u they take p^-2."""
    last = level(Goal(0.02, "hm12", absolute=True), predicted=0.1)
    component = TARGET_SHARE * 0.02 / 0.1
    assert target_bound_ratio(last) ** -2 == pytest.approx(component ** (-1 / LAMBDA_RATE))
    assert target_bound_ratio(level(u=math.inf)) == 0.0


@pytest.mark.parametrize(
    ("coarse", "fine", "rate"),
    [(1.0, 0.5, 1.0), (1.0, 0.99, RATE_LIMITS[0]), (1.0, 0.01, RATE_LIMITS[1])],
)
def test_a_rate_is_believed_within_its_limits(coarse, fine, rate):
    done = [level(u=coarse), level(u=fine)]
    for item, H in zip(done, (1.0, 0.5), strict=True):
        item.partition.H = H
    assert observed_rate(done) == pytest.approx(rate)
    assert math.isnan(observed_rate(done[:1]))
    assert math.isnan(observed_rate([level(u=math.inf), done[1]]))


@pytest.mark.parametrize(
    ("data", "free", "maximum"), [(None, 100.0, 90.0), (50.0, 100.0, 50.0), (200.0, 100.0, 90.0)]
)
def test_no_more_memory_is_planned_than_is_free(monkeypatch, data, free, maximum):
    """0.8 of what is free beside the 10 MB that the process has; the limit that counts is named."""
    monkeypatch.setattr(forecast, "available_mb", lambda: free)
    _, (name, mb), _ = find_limits(Goal(0.1, max_memory=data), 10.0)
    assert mb == pytest.approx(maximum)
    assert ("machine" in name) == (mb != data)


def make_measured_levels(goal=None):
    """Levels of 9, 1000 and 3000 unknowns, by 1 ms for each of these and of the overhead, 0.5 s to enclose f.

    The first one took much longer than that.
    """
    rate = 1e-3
    ends = {1000: 20.0, 3000: 98.0}
    later = [
        level(
            goal,
            0.5 + rate * (n + OVERHEAD_UNKNOWNS),
            unknowns=n,
            elapsed=end,
            enclosing_seconds=0.5,
            peak_mb=10.0,
        )
        for n, end in ends.items()
    ]
    return [level(goal, 10.0, unknowns=9, elapsed=10.0, peak_mb=10.0), *later]


def test_the_time_that_is_spent_is_not_left():
    """After 98 s of 103.5 there are 5 for unknowns, as to enclose f takes half a second."""
    levels = make_measured_levels(Goal(0.1, max_seconds=103.5))
    assert list(allowed_unknowns(levels).values())[2] == pytest.approx(5 / 1e-3 - OVERHEAD_UNKNOWNS)
    assert list(allowed_unknowns(make_measured_levels(Goal(0.1, max_seconds=98.5))).values())[2] == 0.0
    assert predict_seconds(levels, 5 / 1e-3 - OVERHEAD_UNKNOWNS) == pytest.approx(5.5)


def test_the_time_of_the_first_level_says_nothing():
    """Code is loaded in it: whatever it took, there is another one if time is left."""
    for maximum, allowed in ((11.0, math.inf), (9.0, 0.0)):
        only = make_measured_levels(Goal(0.1, max_seconds=maximum))[:1]
        assert list(allowed_unknowns(only).values())[2] == allowed


def test_each_limit_allows_its_own_unknowns(monkeypatch):
    """Half of what memory and time allow, and all of the unknowns."""
    monkeypatch.setattr(forecast, "available_mb", lambda: 100.0)
    goal = Goal(0.1, max_unknowns=500, max_seconds=103.5)
    allowed = list(allowed_unknowns(make_measured_levels(goal), 0.5).values())
    in_memory = 0.8 * 100 * 2**20 / bytes_per_unknown(goal)
    assert allowed == pytest.approx([500, 0.5 * in_memory, 0.5 * (5 / 1e-3 - OVERHEAD_UNKNOWNS)])
