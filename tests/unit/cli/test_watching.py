"""The bar that is drawn before a search."""

import signal
import time

import pytest

from unilateral.cli import watching
from unilateral.cli.watching import bar_during


@pytest.mark.parametrize("drawn", [True, False])
def test_a_bar_is_drawn_while_formulas_are_enclosed(monkeypatch, drawn):
    """It is gone at the end, like its clock; control: none is drawn where none is wanted."""
    lines, before = [], signal.getsignal(signal.SIGALRM)
    monkeypatch.setattr(watching, "_write", lines.append)
    monkeypatch.setattr(watching, "LONG", 0.0)
    with bar_during("the formulas enclosed", drawn):
        end = time.monotonic() + (5.0 if drawn else 5 * watching.TICK)
        while not lines and time.monotonic() < end:
            pass
    assert bool(lines) == drawn
    assert all("the formulas enclosed [" in line for line in lines[:-1])
    assert lines[-1:] == [""] * drawn
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_interrupt_ends_what_is_before_a_search():
    with pytest.raises(KeyboardInterrupt), bar_during("the formulas enclosed", True):
        signal.raise_signal(signal.SIGINT)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
