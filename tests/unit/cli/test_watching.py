"""The bar that is drawn before a search."""

import contextlib
import signal
import time

import pytest

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.watch import OutOfBudget, Watch
from unilateral.cli import main, watching
from unilateral.cli.watching import bar_during
from unilateral.problems import problem_file


@pytest.mark.parametrize("drawn", [True, False])
def test_a_bar_is_drawn_while_formulas_are_enclosed(monkeypatch, drawn):
    """It is gone at the end, like its clock; control: none is drawn where none is wanted."""
    lines, before = [], signal.getsignal(signal.SIGALRM)
    monkeypatch.setattr(watching, "_write", lines.append)
    monkeypatch.setattr(watching, "LONG", 0.0)
    with bar_during(Watch(), "the formulas enclosed", drawn):
        end = time.monotonic() + (5.0 if drawn else 5 * watching.TICK)
        while not lines and time.monotonic() < end:
            pass
    assert bool(lines) == drawn
    assert all("the formulas enclosed [" in line for line in lines[:-1])
    assert lines[-1:] == [""] * drawn
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_interrupt_ends_what_is_before_a_search():
    with pytest.raises(KeyboardInterrupt), bar_during(Watch(), "the formulas enclosed", True):
        signal.raise_signal(signal.SIGINT)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@contextlib.contextmanager
def as_another_error():
    """What some libraries written in C make of what is raised."""
    try:
        yield
    except OutOfBudget:
        raise ImportError from None


def work_late(watch, library):
    """Up to five seconds of work after a jump of the clock by two."""
    with bar_during(watch, "the formulas enclosed", False), library:
        watch.begin -= 2
        end = time.monotonic() + 5
        while time.monotonic() < end and not watch.raised:
            pass


@pytest.mark.parametrize(
    "library",
    [contextlib.nullcontext(), contextlib.suppress(OutOfBudget), as_another_error()],
    ids=["raised", "lost", "changed"],
)
def test_a_limit_ends_what_is_before_a_search(library):
    """Also where a library loses what is raised, or makes another error of it."""
    watch = Watch(goal=Goal(0.1, max_seconds=1.0))
    with pytest.raises(OutOfBudget, match=r"^max_seconds=1$"):
        work_late(watch, library)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_formulas_that_take_longer_than_the_limit_are_told(capsys, problem_file_of, monkeypatch):
    """Code 3 and one line; control: given sizes have no limit, and the reading ends."""
    file, ended = problem_file_of(f=1, g=0), []

    def slow(name):
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            pass
        ended.append(name)
        return load(name)

    load = problem_file.load
    monkeypatch.setattr(problem_file, "load", slow)
    assert main(["solve", file, "--accuracy", "0.5", "--max-seconds", "0.1"]) == 3
    said = f"unilateral: --max-seconds 0.1 does not suffice to enclose the formulas of '{file}'\n"
    assert capsys.readouterr() == ("", said)
    assert ended == []
    assert main(["solve", file, "--h", "1/4", "--H", "1/2"]) == 0
    assert ended == [file]
