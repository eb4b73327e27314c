"""Limits and interrupts: what was found is kept, and no level begins that is predicted to be too much."""

import gc
import weakref
from time import perf_counter

import pytest
from conftest import load
from searched import levels, problem

from unilateral.adaptive import forecast, loop
from unilateral.adaptive.forecast import predict_mb, predict_seconds
from unilateral.adaptive.goal import Goal
from unilateral.adaptive.loop import search
from unilateral.discrete import multilevel
from unilateral.errors import BudgetError

STEPS = ("halve_triangle_edges", "discretise_level", "solve_next_level")
"""What is done on a level, in this order; the first level has another mesh."""


def failing(monkeypatch, step, error, position=2):
    """Makes a step of the loop raise an error the `at`-th time."""
    original = getattr(loop, step)
    calls = []

    def run(*arguments):
        calls.append(step)
        if len(calls) == position:
            raise error
        return original(*arguments)

    monkeypatch.setattr(loop, step, run)


@pytest.mark.parametrize("step", STEPS)
def test_an_interrupt_in_any_step_keeps_the_levels_before(monkeypatch, step):
    """In the second level, or the third, whose mesh is the second that is divided."""
    failing(monkeypatch, step, KeyboardInterrupt())
    result = search(load("natural").problem, Goal(1e-3))
    retained = 2 if step == "halve_triangle_edges" else 1
    assert (result.ended, len(result.levels), result.plan) == ("interrupted", retained, None)
    assert result.best is result.levels[-1]


@pytest.mark.parametrize("step", STEPS[1:])
def test_an_interrupt_in_the_first_level_is_raised(monkeypatch, step):
    """Nothing is left of it."""
    failing(monkeypatch, step, KeyboardInterrupt(), position=1)
    with pytest.raises(KeyboardInterrupt):
        search(load("natural").problem, Goal(1e-3))


def test_another_error_is_raised(monkeypatch):
    """Control: it is a fault, and no end of a search."""
    failing(monkeypatch, "solve_next_level", ZeroDivisionError())
    with pytest.raises(ZeroDivisionError):
        search(load("natural").problem, Goal(1e-3))


def test_memory_that_the_system_refuses_is_a_limit(monkeypatch):
    failing(monkeypatch, "solve_next_level", MemoryError())
    result = search(load("natural").problem, Goal(1e-3))
    assert result.ended == "out of budget (the memory of this machine)"
    assert len(result.levels) == 1
    failing(monkeypatch, "solve_next_level", MemoryError(), position=1)
    with pytest.raises(MemoryError):
        search(load("natural").problem, Goal(1e-3))


@pytest.mark.parametrize("name", ["max_seconds", "max_memory"])
def test_no_level_begins_that_is_predicted_to_exceed_a_limit(name, monkeypatch):
    """Seconds and memory are a little less than is predicted for the third level; what is enough is said.

    Control: with a little more it begins.
    """
    monkeypatch.setattr(forecast, "available_mb", lambda: 1e6)
    monkeypatch.setattr(loop, "perf_counter", iter(range(10**6)).__next__)
    monkeypatch.setattr(loop, "peak_mb", lambda: 100.0)
    monkeypatch.setattr(forecast, "peak_mb", lambda: 100.0)
    first, second, third, *_ = levels(load("natural").problem, Goal(0.02, kind="structured"))
    done = [first, second]
    unknowns = forecast.NEIGHBOUR_RATIO * 4 * second.unknowns
    predicted = {
        "max_seconds": second.elapsed + predict_seconds(done, unknowns),
        "max_memory": predict_mb(done, unknowns),
    }[name]
    for share, begun in ((1 - 1e-6, False), (1 + 1e-6, True)):
        monkeypatch.setattr(loop, "perf_counter", iter(range(10**6)).__next__)
        result = search(load("natural").problem, Goal(0.02, kind="structured", **{name: share * predicted}))
        assert (len(result.levels) > 2) == begun
        if not begun:
            assert result.ended == f"out of budget ({name}={share * predicted:g})"
            assert result.plan.unknowns > third.unknowns


def test_what_the_process_holds_is_no_part_of_what_a_level_may_take(monkeypatch):
    """Ten times more than is free, as beside data of one's own in Python."""
    monkeypatch.setattr(forecast, "available_mb", lambda: 1000.0)
    monkeypatch.setattr(loop, "peak_mb", lambda: 10_000.0)
    assert search(load("natural").problem, Goal(0.02)).certified


def test_without_a_limit_no_more_memory_is_taken_than_is_free(monkeypatch):
    """A MB is free, of which a level with some 800 unknowns takes the allowed part."""
    monkeypatch.setattr(forecast, "available_mb", lambda: 1.0)
    monkeypatch.setattr(loop, "peak_mb", lambda: 100.0)
    result = search(load("natural").problem, Goal(0.005, max_seconds=600.0))
    assert result.ended.endswith("MB of this machine's memory)")
    assert 100 < result.levels[-1].unknowns < 0.8 * 2**20 / forecast.MULTIGRID_LEVEL_BYTES


@pytest.mark.parametrize("limit", [{"max_seconds": 10.0}, {"max_memory": 1.0}])
def test_a_limit_that_is_used_up_before_the_first_level_leaves_nothing(limit):
    """The seconds count from `begin`, and the memory is that of the process."""
    (name,) = limit
    with pytest.raises(BudgetError, match=rf"{name}=\d+ is not enough .* coarsest mesh of 'square'") as error:
        search(load("natural").problem, Goal(0.1, **limit), start_time=perf_counter() - 11)
    assert error.value.exit_code == 3


def test_a_level_says_what_the_next_one_will_have_and_take():
    """The unknowns at most half too many, of which a mesh has room for neighbours; the last says nothing."""
    *before, last = levels(load("natural").problem, Goal(0.02, kind="structured"))
    for level, following in zip(before[1:], [*before[2:], last], strict=True):
        assert following.unknowns <= level.next_unknowns <= 1.5 * following.unknowns
        assert level.next_seconds > 0
    assert (last.next_unknowns, last.next_seconds) == (0.0, 0.0)


def test_what_solved_a_level_is_freed_when_the_next_one_is_solved(monkeypatch):
    """Its grids take half of the memory: no more than two problems are alive at a time."""
    references = []
    alive = []
    original = multilevel.discretise_on_adapted_mesh

    def count_discretisations(*arguments):
        discrete = original(*arguments)
        references.append(weakref.ref(discrete))
        return discrete

    def tell(_):
        gc.collect()
        alive.append(sum(problem() is not None for problem in references))

    monkeypatch.setattr(multilevel, "discretise_on_adapted_mesh", count_discretisations)
    assert len(search(problem("lshape.yaml"), Goal(0.2), tell).levels) > 2
    assert set(alive) == {1}
