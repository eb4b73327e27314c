"""The bar that is drawn before a search and while it works."""

import contextlib
import signal
import sys
import time

import pytest

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.watch import OutOfBudget, Watch
from unilateral.cli import main, watching
from unilateral.cli.watching import bar, bar_during
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

    load = problem_file.problem_in
    monkeypatch.setattr(problem_file, "problem_in", slow)
    assert main(["solve", file, "--accuracy", "0.5", "--max-seconds", "0.1"]) == 3
    said = f"unilateral: --max-seconds 0.1 is not enough to enclose the formulas of '{file}'\n"
    assert capsys.readouterr() == ("", said)
    assert ended == []
    assert main(["solve", file, "--h", "1/4", "--H", "1/2"]) == 0
    assert ended == [file]


def test_a_bar_on_a_terminal_and_nowhere_else(capfd, monkeypatch):
    """Of each level there is at least what clears it. No escapes, so no colours; the lines are as ever."""
    arguments = ["solve", "natural", "--accuracy", "0.2"]
    main(arguments)
    plain = capfd.readouterr()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    main([*arguments, "--json"])
    as_json = capfd.readouterr()
    main(arguments)
    drawn = capfd.readouterr()
    assert (plain.err, as_json.err) == ("", "")
    assert drawn.err.count("\r") >= 2 * 4
    assert "\033" not in drawn.err
    assert drawn.out.splitlines()[:-1] == plain.out.splitlines()[:-1]  # the last one has the seconds


def test_the_bar_shows_the_phase_and_is_never_full():
    """5 of 10 seconds are half of 20 cells; 30 are not all, for the level goes on; 0 is not known."""
    watch = Watch(phase="solve", unknowns=4225, expected=10.0)
    assert bar(watch, 5.0) == f"  4225 unknowns: solve [{'#' * 10}{'.' * 10}] 5 s"
    assert bar(watch, 30.0) == f"  4225 unknowns: solve [{'#' * 19}.] 30 s"
    assert bar(Watch(phase="mesh"), 5.0) == f"  mesh [{'.' * 20}] 5 s"
