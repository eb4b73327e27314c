"""The command line `unilateral`: `main` guards what `application` runs.

Exit codes are those of `command.CODES`. Results go to standard output, messages, one line each, to standard
error. Only `main` imports what takes long, so that an interrupt and a library that is broken are told as
well.
"""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence

from unilateral.cli import streams
from unilateral.cli.streams import tell
from unilateral.errors import InputError, SolutionWarning
from unilateral.system.signals import INTERRUPTED, cleaning_up

FAILED = 4


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: tell(message)
        warnings.simplefilter("ignore", SolutionWarning)  # `solve` prints what they say
        code = _guarded(lambda: _run(arguments))
        return _guarded(_flush) or code


def _run(arguments: Sequence[str] | None) -> int:
    streams.prepare()
    given = sys.argv[1:] if arguments is None else arguments
    run = streams.load("unilateral.cli.application").run
    with cleaning_up():
        return int(run(given))


def _flush() -> int:
    """Writes what is still to be written, which would else fail when Python ends."""
    if sys.stdout is not None:
        sys.stdout.flush()
    return 0


def _guarded(action: Callable[[], int]) -> int:
    """The action's exit code, or that of its failure, which is told in one line."""
    try:
        return action()
    except InputError as error:
        tell(error)
        return error.exit_code
    except KeyboardInterrupt:
        tell("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        streams.abandon(sys.stdout)
        return 0
    except Exception as error:
        tell(_reason(error))
        streams.abandon(sys.stdout)
        return FAILED


def _reason(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "there is not enough memory; take larger sizes --h and --H or a smaller --max-unknowns"
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return f"the system failed: {place}{error.strerror or error}"
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{os.path.basename(last.filename)}, line {last.lineno}"
    return f"this program or a library failed, not the input: {type(error).__name__}: {error} ({place})"
