"""Limits and interrupts in the midst of a level, at defined phases: what was found before is kept."""

import contextlib
import itertools
from itertools import pairwise

import pytest
from conftest import load

from unilateral.accuracy import levels as of_levels
from unilateral.accuracy import watch as of_watch
from unilateral.accuracy.goal import Goal
from unilateral.accuracy.levels import SPARE
from unilateral.accuracy.search import search
from unilateral.accuracy.watch import ENCLOSING, OutOfBudget, Watch
from unilateral.errors import BudgetError
from unilateral.system.memory import peak_mb

PHASES = ("mesh", "matrices", ENCLOSING, "solve", "bound")
"""What is done on a level with a uniform mesh, in this order."""


class Told(Watch):
    """Remembers phases; does something at the one in question."""

    def __init__(self, at=None, then=None):
        super().__init__()
        self.phases, self.question, self.then = [], at, then

    def _next(self, phase):
        super()._next(phase)
        self.phases.append(phase)
        if len(self.phases) == self.question:
            self.then(self)


def test_phases_are_told_and_their_seconds_are_those_of_the_level():
    watch, seconds = Told(), []
    found = search(
        load("natural").problem, Goal(0.3), tell=lambda _: seconds.append(watch.seconds), watch=watch
    )
    assert watch.phases == [*PHASES, ""] * len(found.done)
    for level, of_phases in zip(found.done, seconds, strict=True):
        assert list(of_phases) == list(PHASES)
        assert level.seconds == sum(of_phases.values())
        assert level.enclosing == of_phases[ENCLOSING]
    assert watch.goal is None


@pytest.mark.parametrize("phase", range(1, 6))
def test_an_interrupt_in_any_phase_keeps_the_levels_before(phase):
    """In the second level; control: in the first one nothing is left, and it is raised."""
    watch = Told(6 + phase, Watch.interrupt)
    found = search(load("natural").problem, Goal(1e-3), watch=watch)
    assert (found.ended, len(found.done), found.plan) == ("interrupted", 1, None)
    assert (watch.goal, watch.phase) == (None, "")
    with pytest.raises(KeyboardInterrupt):
        search(load("natural").problem, Goal(1e-3), watch=Told(phase, Watch.interrupt))


def test_an_interrupt_that_was_lost_is_seen_at_the_next_phase():
    """As where C code calls back and drops what is raised."""

    def lost(watch):
        with contextlib.suppress(KeyboardInterrupt):
            watch.interrupt()

    watch = Told(8, lost)
    assert search(load("natural").problem, Goal(1e-3), watch=watch).ended == "interrupted"
    assert len(watch.phases) == 8


def test_an_interrupt_of_which_a_library_makes_another_error_is_one():
    """As some do that are written in C, while they are imported; control: the error alone is raised."""

    def failing(watch):
        try:
            watch.interrupt()
        except KeyboardInterrupt:
            raise ImportError from None

    def broken(_):
        raise ImportError

    assert search(load("natural").problem, Goal(1e-3), watch=Told(8, failing)).ended == "interrupted"
    with pytest.raises(ImportError):
        search(load("natural").problem, Goal(1e-3), watch=Told(8, broken))


@pytest.mark.parametrize("name", ["max_seconds", "max_memory"])
def test_a_limit_in_the_midst_of_a_level_keeps_those_before(name, monkeypatch):
    """The clock, or the memory, jumps in the third level; what would have been enough is said."""
    limit = 1e6
    monkeypatch.setattr(of_levels, "available_mb", lambda: 10 * limit)

    def jump(watch):
        if name == "max_seconds":
            watch.begin -= limit
        else:
            monkeypatch.setattr(of_watch, "peak_mb", lambda: 2 * limit)

    found = search(load("natural").problem, Goal(0.02, **{name: limit}), watch=Told(15, jump))
    assert len(found.done) == 2
    assert found.ended == f"out of budget ({name}=1e+06)"
    assert found.plan.unknowns > found.done[-1].unknowns


def test_without_a_limit_no_more_memory_is_taken_than_was_free(monkeypatch):
    """Beside what the process held; a level that was predicted to take less is given up all the same."""
    monkeypatch.setattr(of_levels, "available_mb", lambda: 500.0)

    def jump(watch):
        held = watch.most_mb - SPARE * 500
        assert 0 < held <= peak_mb()
        monkeypatch.setattr(of_watch, "peak_mb", lambda: 1.01 * watch.most_mb)

    watch = Told(15, jump)
    found = search(load("natural").problem, Goal(0.02), watch=watch)
    assert len(found.done) == 2
    assert found.ended == f"out of budget ({watch.most_mb:.0f} MB of this machine's memory)"


def test_what_the_process_holds_is_no_part_of_what_a_level_may_take(monkeypatch):
    """Ten times more than is free, as beside data of one's own in Python."""
    monkeypatch.setattr(of_levels, "available_mb", lambda: 1000.0)
    monkeypatch.setattr(of_levels, "peak_mb", lambda: 10_000.0)
    assert search(load("natural").problem, Goal(0.02)).certified


def test_a_limit_in_the_first_level_leaves_nothing():
    with pytest.raises(
        BudgetError, match=r"max_seconds=10 is not enough .* coarsest mesh of 'square'"
    ) as told:
        search(load("natural").problem, Goal(0.1, max_seconds=10.0), watch=Watch(begin=-1e9))
    assert told.value.exit_code == 3


def test_memory_that_the_system_refuses_is_a_limit():
    def refused(_):
        raise MemoryError

    found = search(load("natural").problem, Goal(1e-3), watch=Told(8, refused))
    assert found.ended == "out of budget (the memory of this machine)"
    assert len(found.done) == 1


def test_what_ends_a_search_is_raised_once(monkeypatch):
    """Or it would disturb what is done with the result."""
    monkeypatch.setattr(of_watch, "peak_mb", lambda: 2.0)
    watch = Watch(goal=Goal(0.1, max_memory=1.0))
    with pytest.raises(OutOfBudget, match="max_memory=1"):
        watch.look()
    watch.look()
    watch.interrupt()
    with pytest.raises(KeyboardInterrupt):
        watch.resume(Goal(0.1), "true errors")


def test_the_seconds_of_a_level_grow_while_it_lasts(monkeypatch):
    count = itertools.count()
    monkeypatch.setattr(Watch, "elapsed", property(lambda _: float(next(count))))
    watch = Watch()
    watch.begin_level()
    seen = []
    for phase in ("solve", "bound", "bound"):
        seen.append(watch.level_seconds)
        watch.at(phase)
    assert all(a < b for a, b in pairwise(seen))
