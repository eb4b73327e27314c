"""Signals while a search works: Ctrl-C, and a clock that looks at the limits and draws a bar."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator

from unilateral.accuracy.watch import Watch
from unilateral.system.signals import leave

TICK = 0.02
"""Seconds from one look at the limits to the next, in which at most some ten MB are taken."""
LONG = 1.0
"""A level has a bar from this many seconds on."""
WIDTH, CELLS = 60, 20
"""The number of letters in the line, and in its bar."""


@contextlib.contextmanager
def watching(watch: Watch, drawn: bool) -> Iterator[None]:
    """The watch gets interrupts, and a second one ends the program at once; limits are checked repeatedly.

    A bar is `drawn` on standard error.
    """

    def interrupt(*_: object) -> None:
        if watch.asked:
            leave()
        watch.interrupt()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        with _ticking(watch, drawn):
            yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def bar_during(watch: Watch, phase: str, drawn: bool) -> Iterator[None]:
    """A bar on standard error, if it is `drawn`, while something takes long before a search begins.

    Ctrl-C ends it as usual. Raises OutOfBudget where a limit of the watch's goal, if it has one, is reached.
    """
    watch.at(phase)
    try:
        with _ticking(watch, drawn):
            yield
    finally:
        if watch.raised:  # of which some libraries make another error, or nothing
            raise watch.raised
    watch.at("")


@contextlib.contextmanager
def _ticking(watch: Watch, drawn: bool) -> Iterator[None]:
    """A clock looks at the limits again and again, and draws the bar.

    Where the system has no such clock, as Windows has none, limits are looked at between phases only.
    """
    if not hasattr(signal, "setitimer"):
        yield
        return

    def tick(*_: object) -> None:
        watch.look()
        if drawn:
            draw(watch)

    before = signal.signal(signal.SIGALRM, tick)
    signal.setitimer(signal.ITIMER_REAL, TICK, TICK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        clear(drawn)


def draw(watch: Watch) -> None:
    """The bar of a long level; to be called from a handler, so nothing is buffered."""
    taken = watch.level_seconds
    if watch.phase and taken >= LONG:
        _write(bar(watch, taken))


def clear(drawn: bool) -> None:
    """Clears the line where a bar may be."""
    if drawn:
        _write("")


def bar(watch: Watch, taken: float) -> str:
    """The seconds taken of those expected, never all, and the phase."""
    done = min(int(CELLS * taken / max(watch.expected, taken)), CELLS - 1) if watch.expected else 0
    unknowns = f"{watch.unknowns} unknowns: " if watch.unknowns else ""
    return f"  {unknowns}{watch.phase} [{'#' * done}{'.' * (CELLS - done)}] {taken:.0f} s"


def _write(text: str) -> None:
    with contextlib.suppress(OSError):
        os.write(sys.stderr.fileno(), f"\r{text[:WIDTH]:{WIDTH}}\r".encode())
