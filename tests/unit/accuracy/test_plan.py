"""What an accuracy will take: unknowns against those that then come, and costs that agree with themselves."""

import re
from dataclasses import replace

import pytest
from conftest import load
from searched import problem

from unilateral.accuracy import levels as of_levels
from unilateral.accuracy import plan as of_plan
from unilateral.accuracy import search as of_search
from unilateral.accuracy.goal import MAX_SECONDS, Goal
from unilateral.accuracy.level import Prospect
from unilateral.accuracy.levels import MARGIN, levels, most_unknowns
from unilateral.accuracy.plan import FAR, enough, hopeless, plan
from unilateral.accuracy.search import search
from unilateral.solvers.stop import Stop


def planned(done, goal):
    return plan(Prospect([replace(level, goal=goal) for level in done], Stop(), "", 1.0))


@pytest.fixture
def at_once(monkeypatch):
    """A plan as soon as there are enough unknowns, however long they took."""
    monkeypatch.setattr(of_plan, "PROBE", 0.0)


@pytest.fixture
def machine(monkeypatch):
    """One with so much memory whatever else runs on it, on which a level takes a second for 1e5 unknowns."""
    monkeypatch.setattr(of_levels, "available_mb", lambda: 8000.0)
    monkeypatch.setattr(Prospect, "speed", 1.0)


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize(
    ("name", "goal", "adapted"),
    [
        ("natural", Goal(0.005), False),
        ("natural", Goal(0.02, absolute=True), False),
        ("violates_j", Goal(0.02), True),
        ("hexagon_jump.yaml", Goal(0.03), True),
        ("lshape.yaml", Goal(0.02), True),
    ],
)
def test_a_plan_is_right_within_a_factor_of_2(name, goal, adapted):
    """Of the unknowns, from levels that have many times fewer: what the documents promise."""
    dry, whole = (search(problem(name), goal, probe=probe) for probe in (True, False))
    assert whole.certified
    assert not dry.certified
    assert dry.done[-1].unknowns <= whole.best.unknowns / 3
    assert 0.5 <= dry.plan.unknowns / whole.best.unknowns <= 2
    assert dry.plan.adapted == adapted
    assert dry.plan.missed == ()


def test_limits_that_do_not_allow_a_plan_are_named():
    """Each a little below what is planned; control: none a little above it."""
    done = list(levels(load("natural").problem, Goal(0.05)))
    for share, missed in ((0.99, ["max_unknowns", "max_memory", "max_seconds"]), (1.01, [])):
        free = planned(done, Goal(0.001))
        limits = [share * value for value in (free.unknowns, free.seconds, free.peak_mb)]
        found = planned(done, Goal(0.001, "h1", *limits)).missed
        assert [limit.split("=")[0] for limit in found] == missed


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("name", ["natural", "lshape.yaml"])
def test_an_accuracy_that_is_out_of_reach_ends_the_search_after_the_plan(name, machine):
    """And the one that is said to be in reach is, by its own plan; the next smaller one is not."""
    found = search(problem(name), Goal(1e-9))
    assert found.ended.startswith("out of reach (")
    assert re.search(r"\d MB of this machine's memory", found.ended)
    assert not found.certified
    assert found.best.unknowns <= 5000
    assert found.plan.unknowns > 1e12
    digits, k = f"{found.reach:.0e}".split("e")
    before = {"1": f"5e{int(k) - 1}", "2": f"1e{k}", "5": f"2e{k}"}[digits]
    missed = [planned(found.done, Goal(accuracy)).missed for accuracy in (found.reach, float(before))]
    assert [bool(limits) for limits in missed] == [False, True]
    assert found.best.total / found.best.size > found.reach


@pytest.mark.usefixtures("at_once", "machine")
def test_a_limit_that_somebody_set_is_spent():
    """The same accuracy; so is one that the plan does not exclude by far."""
    found = search(load("natural").problem, Goal(1e-9, max_unknowns=2000))
    assert found.ended == "out of budget (max_unknowns=2000)"
    assert found.reach is None
    done = list(levels(load("natural").problem, Goal(0.02)))
    allowed = min(most_unknowns(Prospect(done, Stop(), "", 1.0)).values())
    for times, far in ((FAR / 2, False), (2 * FAR, True)):
        last = done[-1]
        goal = Goal(last.total / last.solved.u_norm / (times * allowed / last.unknowns) ** 0.5 / MARGIN)
        of_goal = [replace(level, goal=goal) for level in done]
        assert hopeless(Prospect(of_goal, Stop(), "", 1.0)) == far


@pytest.mark.usefixtures("at_once", "machine")
@pytest.mark.parametrize("limit", [{"max_seconds": MAX_SECONDS}, {"max_memory": 1e9}, {"max_unknowns": 1e9}])
def test_a_limit_is_spent_even_if_it_is_the_default_or_never_reached(limit):
    """The plan ends nothing; control: it does so without the limit."""
    done = list(levels(load("natural").problem, Goal(0.02)))
    for given, far in ((limit, False), ({}, True)):
        of_goal = [replace(level, goal=Goal(1e-9, **given)) for level in done]
        assert hopeless(Prospect(of_goal, Stop(), "", 1.0)) == far


@pytest.mark.usefixtures("at_once", "machine")
def test_out_of_reach_without_a_plan_names_no_limit(monkeypatch):
    monkeypatch.setattr(of_search, "plan", lambda _: None)
    found = search(load("natural").problem, Goal(1e-9))
    assert (found.ended, found.reach) == ("out of reach", None)


@pytest.mark.usefixtures("at_once", "machine")
def test_bounds_that_stand_still_on_coarse_meshes_end_nothing(monkeypatch):
    """As if the rate were 1/4: then a plan misses the limits by far, but nothing is concluded from that."""
    found = levels(load("natural").problem, Goal(0.02), kind="structured")
    done = [replace(level, goal=Goal(0.001)) for level in found]
    monkeypatch.setattr(of_plan, "observed_rate", lambda *_: 0.25)
    prospect = Prospect(done, Stop(), "structured", 1.0)
    assert enough(prospect)
    assert plan(prospect).unknowns > 100 * FAR * min(most_unknowns(prospect).values())
    assert not hopeless(prospect)


def test_what_is_certified_needs_nothing_more():
    found = search(load("natural").problem, Goal(0.2), probe=True)
    assert found.certified
    assert found.plan.unknowns == found.best.unknowns
    assert found.plan.missed == ()


def test_costs_and_what_they_allow_agree():
    """The unknowns within the seconds and the MB of a level are its own; none are within no time."""
    done = list(levels(load("natural").problem, Goal(0.05)))
    prospect = Prospect(done, Stop(), "", elapsed=7.0)
    assert prospect.within_seconds(7.0 + prospect.seconds(12_345)) == pytest.approx(12_345)
    assert prospect.within_mb(prospect.mb(12_345)) == pytest.approx(12_345)
    assert prospect.within_seconds(7.0) == prospect.within_mb(0.0) == 0.0
    assert prospect.mb(done[-1].unknowns) >= max(level.mb for level in done)


def test_only_what_is_left_free_is_adapted():
    """The bound comes from the L-shape's corner; a kind or a solver may ask for uniform meshes."""
    *_, last = levels(problem("lshape.yaml"), Goal(0.3), kind="structured")
    assert Prospect([last], Stop(), "", 0.0).adapted
    for stop, kind in ((Stop(), "structured"), (Stop(rho=0.1), ""), (Stop(algorithm="nesterov"), "")):
        assert not Prospect([last], stop, kind, 0.0).adapted
