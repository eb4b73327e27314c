"""What the project adds to click: exit codes, failures in one line, and streams that are closed or full.

Results go to standard output, messages, one line each, to standard error. `main` alone imports the commands,
so that an interrupt and a library that is broken are told as well.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TextIO

import click

from unilateral.errors import InputError, SolutionWarning, quote_input
from unilateral.system.signals import EXIT_INTERRUPTED, cleaning_up

EXIT_REJECTED = 1
EXIT_NOT_CONVERGED = 3
EXIT_FAILED = 4
"""Exit codes: what is judged fails; not converged or out of budget; the system or this program failed."""
COMPLETION_VARIABLE = "_UNILATERAL_COMPLETE"
"""The variable that a shell sets to ask for completions, as click names it."""
LETTER_NAMES = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "epsilon", "λ": "lambda", "μ": "mu",
    "ν": "nu", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau", "ω": "omega", "Λ": "Lambda", "Π": "Pi",
    "Σ": "sum ", "Ω": "Omega", "∂": "d", "‖": "||", "⟨": "<", "⟩": ">", "≤": "<=", "≥": ">=", "→": "->",
    "×": "x", "·": "*", "√": "sqrt", "²": "^2", "–": "-", "°": " degrees",
}  # fmt: skip
"""How letters that a terminal does not have are written; any other one by its code, such as \\u2026."""
ARGUMENT_PATTERN = re.compile(
    r"\b(absolute|algorithm|max_memory|max_seconds|max_steps|max_unknowns|polygon|rho)=([0-9.]?)"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: print_message(message)
        warnings.simplefilter("ignore", SolutionWarning)  # `solve` prints what they say
        code = run_safely(lambda: run_command(sys.argv[1:] if arguments is None else arguments))
        return run_safely(flush_output) or code


def run_safely(action: Callable[[], int]) -> int:
    """The action's exit code, or that of its failure, which is told in one line."""
    try:
        return action()
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except InputError as error:
        print_message(error)
        return error.exit_code
    except KeyboardInterrupt:
        print_message("interrupted")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        abandon_stream(sys.stdout)
        return 0
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            print_message(f"{quote_input(error.filename)} is too long for the name of a file")
            return InputError.exit_code
        if is_interrupt(error):
            print_message("interrupted")
            return EXIT_INTERRUPTED
        print_message(describe_failure(error))
        abandon_stream(sys.stdout)
        return EXIT_FAILED


def run_command(arguments: Sequence[str]) -> int:
    """Run click's commands; the exit code. `click.Command.main` would take KeyboardInterrupt for itself."""
    prepare_streams()
    from unilateral.cli.application import application

    if COMPLETION_VARIABLE in os.environ:
        from click.shell_completion import shell_complete

        return shell_complete(
            application, {}, "unilateral", COMPLETION_VARIABLE, os.environ[COMPLETION_VARIABLE]
        )
    try:
        with cleaning_up(), application.make_context("unilateral", [*arguments]) as context:
            return application.invoke(context) or 0
    except click.exceptions.Exit as end:  # after --help and --version
        return end.exit_code


def flush_output() -> int:
    """Writes what is still to be written, which would else fail when Python ends."""
    if sys.stdout is not None:
        sys.stdout.flush()
    return 0


def is_interrupt(error: BaseException | None) -> bool:
    """Whether an interrupt led to the error: some libraries raise another one if it comes in their import."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def describe_failure(error: Exception) -> str:
    """A sentence on a failure that is not the fault of the input."""
    if isinstance(error, MemoryError):
        return "there is not enough memory; take larger sizes --h and --H or a smaller --max-unknowns"
    if isinstance(error, OSError):
        place = f"{error.filename}: " if error.filename else ""
        return f"the system failed: {place}{error.strerror or error}"
    import traceback  # only here, because it is not needed by a command that works

    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{os.path.basename(last.filename)}, line {last.lineno}"
    return f"this program or a library failed, not the input: {type(error).__name__}: {error} ({place})"


def print_result(text: str) -> None:
    """Prints a text on standard output, at once."""
    print(text, flush=True)


def print_message(message: object) -> None:
    """Prints one line on standard error, where that can be written."""
    try:
        print("unilateral:", *rewrite_as_options(str(message)).split(), file=sys.stderr, flush=True)
    except OSError:
        abandon_stream(sys.stderr)


def rewrite_as_options(message: str) -> str:
    """The library's arguments, such as max_unknowns=9, as what is typed here: --max-unknowns 9."""

    def write_option(argument: re.Match[str]) -> str:
        """The option of an argument, and the first letter of its value."""
        name = argument[1].replace("_", "-")
        value = argument[2]
        return f"--{name} {value}" if value else f"--{name}"

    return ARGUMENT_PATTERN.sub(write_option, message)


def prepare_streams() -> None:
    """Make what is printed end neither in a letter that cannot be encoded nor in another file.

    Raises OSError where there is no standard output.
    """
    if sys.stderr is None:  # print would take standard output for it
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        raise OSError("standard output is closed")
    codecs.register_error("unilateral", name_letter)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        sys.stdout.reconfigure(errors="unilateral")


def name_letter(error: UnicodeError) -> tuple[str | bytes, int]:
    """The name of a letter that cannot be encoded, or its code; a handler of errors for `codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    if letter not in LETTER_NAMES:
        return codecs.backslashreplace_errors(error)
    return LETTER_NAMES[letter], error.start + 1


def abandon_stream(stream: TextIO | None) -> None:
    """Drops what a stream still holds, on which Python would fail once more at its end."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # type: ignore[union-attr]
