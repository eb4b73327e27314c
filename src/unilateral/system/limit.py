"""A limit on the time that a function of another library takes, such as a reader that never ends."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from threading import Thread
from time import monotonic
from typing import TypeVar

Result = TypeVar("Result")

POLL_SECONDS = 0.05
"""Seconds between two looks at the thread; Ctrl-C is heard between them on every system."""


class OutOfTime(Exception):
    """A function did not end within its limit."""


def run_with_limit(function: Callable[[], Result], seconds: float) -> Result:
    """Result of a function, or its exception; OutOfTime after so many seconds.

    It runs in a thread, which ends at its next line of Python. This works in any thread and on any system,
    unlike signals. A function that never returns to Python runs until the program ends, and one that holds
    Python's lock meanwhile is not limited.
    """
    returned = list[Result]()
    raised = list[BaseException]()

    def run_function() -> None:
        """Keeps the result or the exception for the caller's thread."""
        try:
            returned.append(function())
        except BaseException as error:
            raised.append(error)

    thread = Thread(target=run_function, daemon=True)
    thread.start()
    end = monotonic() + seconds
    try:
        while thread.is_alive() and monotonic() < end:
            thread.join(POLL_SECONDS)
    finally:
        late = thread.is_alive()
        if late:  # an exception that Python raises in that thread at its next line
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit)
            )
    if late:  # not what ending the thread may have raised in it meanwhile
        raise OutOfTime
    if raised:
        raise raised[0]
    return returned[0]
