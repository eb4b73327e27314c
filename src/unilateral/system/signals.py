"""What ends a program from outside, Ctrl-C and SIGTERM. Next to nothing is imported, so it can come first."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

EXIT_INTERRUPTED = 130
EXIT_TERMINATED = 128 + signal.SIGTERM


def exit_at_once(*_: object) -> NoReturn:
    """Ends the program at once, after an interrupt."""
    _write_message("interrupted")
    os._exit(EXIT_INTERRUPTED)


def exit_on_interrupt() -> None:
    """Makes interrupts end the program at once, from now on.

    If interrupts are ignored, as those of a command in the background are, they stay so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, exit_at_once)


@contextmanager
def cleaning_up() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt, SIGTERM raises SystemExit, so files that are not whole are removed."""
    handlers = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: _terminate}
    before = {number: signal.getsignal(number) for number in handlers}
    for number in handlers:
        if before[number] is not signal.SIG_IGN:  # as of a command in the background
            signal.signal(number, handlers[number])
    try:
        yield
    finally:
        for number in handlers:
            signal.signal(number, before[number])


@contextmanager
def keeping_handlers() -> Iterator[None]:
    """Afterwards the handlers that Python has set are set again, if this is the main thread.

    Libraries written in C reset some without Python knowing: gmsh those of SIGTERM and SIGPIPE.
    """
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():  # only that one may set handlers
            for number, handler in handlers.items():
                if handler not in (None, signal.SIG_DFL):  # which others, such as faulthandler, may have set
                    signal.signal(number, handler)


def _terminate(*_: object) -> NoReturn:
    _write_message("terminated")
    raise SystemExit(EXIT_TERMINATED)


def _write_message(message: str) -> None:
    """One line on standard error, by a call that a signal handler may make."""
    with suppress(OSError):
        os.write(2, f"unilateral: {message}\n".encode())
