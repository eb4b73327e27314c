"""What an accuracy will take: unknowns against those that then come, and costs that agree with themselves."""

import re
from dataclasses import replace

import pytest
from conftest import load
from searched import levels, problem

from unilateral.adaptive import forecast, loop
from unilateral.adaptive.forecast import (
    HOPELESS_UNKNOWNS_RATIO,
    MIN_PLAN_UNKNOWNS,
    OVERHEAD_UNKNOWNS,
    allowed_unknowns,
    is_hopeless,
    make_plan,
    predict_mb,
    predict_seconds,
    predict_sizes,
    predict_unknowns,
    show_costs,
)
from unilateral.adaptive.goal import DEFAULT_MAX_SECONDS, Goal
from unilateral.adaptive.level import judge_for_goal
from unilateral.adaptive.loop import search
from unilateral.adaptive.marking import TARGET_SHARE, should_adapt
from unilateral.solvers.stop import Stop


def towards(goal, done):
    """The levels as if they were solved towards another goal."""
    return [judge_for_goal(level, goal) for level in done]


@pytest.fixture(scope="module")
def natural_levels():
    """Of a smooth problem."""
    return levels(load("natural").problem, Goal(0.02))


@pytest.fixture(scope="module")
def lshape_levels():
    """Of a problem whose u is singular at the re-entrant corner."""
    return levels(problem("lshape.yaml"), Goal(0.3))


@pytest.fixture
def soon(monkeypatch):
    """A plan from few unknowns on."""
    monkeypatch.setattr(forecast, "MIN_PLAN_UNKNOWNS", 400)


@pytest.fixture
def machine(monkeypatch):
    """One with so much memory whatever else runs on it, on which a level takes a second for 1e5 unknowns."""
    monkeypatch.setattr(forecast, "available_mb", lambda: 8000.0)
    monkeypatch.setattr(forecast, "observe_seconds", lambda _: (0.02, 1e-5))


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    ("name", "goal", "adapted"),
    [
        ("natural", Goal(0.01), False),
        ("natural", Goal(0.02, absolute=True), False),
        ("violates_j", Goal(0.02), True),
        ("hexagon_jump.yaml", Goal(0.03), True),
        ("lshape.yaml", Goal(0.02), True),
    ],
)
def test_a_plan_is_right_within_a_factor_of_2(name, goal, adapted):
    """Of the unknowns, from levels that have many times fewer: what the documents promise."""
    dry = search(problem(name), goal, dry_run=True)
    full = search(problem(name), goal, dry_run=False)
    assert full.certified
    assert not dry.certified
    assert dry.levels[-1].unknowns <= full.best.unknowns / 3
    assert 0.5 <= dry.plan.unknowns / full.best.unknowns <= 2
    assert dry.plan.adapted == adapted
    assert dry.plan.missed == ()


@pytest.mark.parametrize("kind", ["structured", "unstructured"])
def test_the_sizes_of_uniform_levels_are_those_that_come(kind):
    """To a node, by Euler's formula, from each level on: between two refinements no mesh is uniform."""
    goal = Goal(0.02, kind=kind)
    *before, last = levels(load("natural").problem, goal)
    assert last.certified
    unknowns = [level.unknowns for level in (*before, last)]
    for i in range(2, len(unknowns)):
        needed = predict_unknowns(before[:i])
        assert unknowns[-2] < needed < unknowns[-1]
        assert predict_sizes(before[:i]) == unknowns[i:]
        assert make_plan(before[:i]).unknowns == last.unknowns


def test_a_dry_run_ends_with_the_first_level_that_is_large_enough():
    """However long it took, so that two runs say the same of the unknowns."""
    result = search(problem("lshape.yaml"), Goal(1e-3), dry_run=True)
    second = search(problem("lshape.yaml"), Goal(1e-3), dry_run=True)
    *before, last = [level.unknowns for level in result.levels]
    assert max(before) < MIN_PLAN_UNKNOWNS <= last
    assert result.plan.unknowns == second.plan.unknowns
    assert repr(result) == f"Search: {len(result.levels)} levels, not certified"


def test_limits_that_do_not_allow_a_plan_are_named(natural_levels):
    """Each a little below what is planned; control: none a little above it."""
    free = make_plan(towards(Goal(0.001), natural_levels))
    for share, missed in ((0.99, ["max_unknowns", "max_memory", "max_seconds"]), (1.01, [])):
        limits = [share * value for value in (free.unknowns, free.peak_mb)]
        goal = Goal(0.001, max_unknowns=limits[0], max_seconds=share * free.seconds, max_memory=limits[1])
        missed_limits = make_plan(towards(goal, natural_levels)).missed
        assert [limit.split("=")[0] for limit in missed_limits] == missed


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("name", ["natural", "lshape.yaml"])
def test_an_accuracy_that_is_out_of_reach_ends_the_search_after_the_plan(name, machine):
    """And the one that is said to be in reach is, by its own plan; the next smaller one is not."""
    result = search(problem(name), Goal(1e-9))
    assert result.ended.startswith("out of reach (")
    assert re.search(r"\d MB of this machine's memory", result.ended)
    assert not result.certified
    assert result.best.unknowns <= 5000
    assert result.plan.unknowns > 1e12
    digits, k = f"{result.reach:.0e}".split("e")
    before = {"1": f"5e{int(k) - 1}", "2": f"1e{k}", "5": f"2e{k}"}[digits]
    missed = [
        make_plan(towards(Goal(accuracy), result.levels)).missed for accuracy in (result.reach, float(before))
    ]
    assert [bool(limits) for limits in missed] == [False, True]
    assert result.best.total / result.best.size > result.reach


@pytest.mark.usefixtures("soon", "machine")
def test_a_limit_that_somebody_set_is_spent(natural_levels):
    """The same accuracy; so is one that the plan does not exclude by far."""
    result = search(load("natural").problem, Goal(1e-9, max_unknowns=2000))
    assert result.ended == "out of budget (max_unknowns=2000)"
    assert result.reach is None
    allowed = min(allowed_unknowns(natural_levels).values())
    for times, far in ((HOPELESS_UNKNOWNS_RATIO / 2, False), (2 * HOPELESS_UNKNOWNS_RATIO, True)):
        last = natural_levels[-1]
        accuracy = last.total / last.solved.u_norm / (times * allowed / last.unknowns) ** 0.5 / TARGET_SHARE
        assert is_hopeless(towards(Goal(accuracy), natural_levels)) == far


@pytest.mark.usefixtures("soon", "machine")
@pytest.mark.parametrize(
    "limit", [{"max_seconds": DEFAULT_MAX_SECONDS}, {"max_memory": 1e9}, {"max_unknowns": 1e9}]
)
def test_a_limit_is_spent_even_if_it_is_the_default_or_never_reached(limit, natural_levels):
    """The plan ends nothing; control: it does so without the limit."""
    for data, far in ((limit, False), ({}, True)):
        assert is_hopeless(towards(Goal(1e-9, **data), natural_levels)) == far


@pytest.mark.usefixtures("soon", "machine")
def test_out_of_reach_without_a_plan_names_no_limit(monkeypatch):
    monkeypatch.setattr(loop, "make_plan", lambda _: None)
    result = search(load("natural").problem, Goal(1e-9))
    assert (result.ended, result.reach) == ("out of reach", None)


@pytest.mark.usefixtures("soon", "machine")
def test_bounds_that_stand_still_on_coarse_meshes_end_nothing(monkeypatch):
    """As if the rate were 1/4: then a plan misses the limits by far, but nothing is concluded from that."""
    done = levels(load("natural").problem, Goal(0.02, kind="structured"))
    monkeypatch.setattr(forecast, "observed_rate", lambda *_: 0.25)
    done = towards(Goal(0.001, kind="structured"), done)
    assert show_costs(done)
    assert make_plan(done).unknowns > 100 * HOPELESS_UNKNOWNS_RATIO * min(allowed_unknowns(done).values())
    assert not is_hopeless(done)


def test_what_is_certified_needs_nothing_more():
    result = search(load("natural").problem, Goal(0.2), dry_run=True)
    assert result.certified
    assert result.plan.unknowns == result.best.unknowns
    assert result.plan.missed == ()


def test_costs_and_what_they_allow_agree(natural_levels):
    """The unknowns within the seconds and the MB of a level are its own; none are within no time."""
    last = natural_levels[-1]
    seconds = last.elapsed + predict_seconds(natural_levels, 12_345)
    goal = Goal(0.05, max_seconds=seconds, max_memory=predict_mb(natural_levels, 12_345))
    _, by_memory, by_seconds = allowed_unknowns(towards(goal, natural_levels)).values()
    assert by_memory == pytest.approx(12_345)
    assert by_seconds == pytest.approx(12_345)
    no_time = towards(Goal(0.05, max_seconds=1e-9), natural_levels)
    assert allowed_unknowns(no_time)["max_seconds=1e-09"] == 0.0
    assert predict_mb(natural_levels, last.unknowns) >= max(level.peak_mb for level in natural_levels)


def test_seconds_are_predicted_by_the_rate_of_the_levels(lshape_levels):
    """Twice the unknowns and the overhead take twice the time of the last level, beside what encloses f."""
    first, *_, last = lshape_levels
    done = [replace(first, enclosing_seconds=0.25), replace(last, seconds=1.0, enclosing_seconds=0.25)]
    twice = 2 * (done[-1].unknowns + OVERHEAD_UNKNOWNS) - OVERHEAD_UNKNOWNS
    assert predict_seconds(done, twice) == pytest.approx(0.25 + 2 * 0.75)


def test_what_encloses_f_is_taken_to_grow_on_but_not_to_fall(lshape_levels):
    """Linearly from the last two levels: by 0.1 s with as many new unknowns as it grew by 0.1 s before."""
    first, *_, last = lshape_levels
    extra = last.unknowns - first.unknowns
    for before, added in ((0.1, 0.1), (0.3, 0.0)):
        done = [
            replace(first, seconds=before, enclosing_seconds=before),
            replace(last, seconds=0.2, enclosing_seconds=0.2),
        ]
        assert predict_seconds(done, last.unknowns + extra) == pytest.approx(0.2 + added)


def test_a_level_on_the_same_mesh_tells_nothing_of_growth(lshape_levels):
    """As where a bound was missed by so little that no triangle is halved for it."""
    first, *_, last = lshape_levels
    done = [first, replace(last, enclosing_seconds=0.1), replace(last, seconds=0.2, enclosing_seconds=0.2)]
    assert predict_seconds(done[1:], last.unknowns) == pytest.approx(0.2)


def test_only_what_is_left_free_is_adapted():
    """The bound comes from the L-shape's corner; a kind or a solver may ask for uniform meshes."""
    *_, last = levels(problem("lshape.yaml"), Goal(0.3, kind="structured"))
    (free,) = towards(Goal(0.3), [last])
    assert should_adapt(free)
    for goal in (
        Goal(0.3, kind="structured"),
        Goal(0.3, stop=Stop(rho=0.1)),
        Goal(0.3, stop=Stop(algorithm="nesterov")),
    ):
        (bound,) = towards(goal, [last])
        assert not should_adapt(bound)
