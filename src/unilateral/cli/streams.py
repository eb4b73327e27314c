"""Standard output and error as they may be: closed, full, or without the letters that are printed."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import signal
import sys
from importlib import import_module
from typing import Any, TextIO

from unilateral.system.signals import leave

NAMES = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "epsilon", "λ": "lambda", "μ": "mu",
    "ν": "nu", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau", "ω": "omega", "Λ": "Lambda", "Π": "Pi",
    "Σ": "sum ", "Ω": "Omega", "∂": "d", "‖": "||", "⟨": "<", "⟩": ">", "≤": "<=", "≥": ">=", "→": "->",
    "×": "x", "·": "*", "√": "sqrt", "²": "^2", "–": "-", "°": " degrees",
}  # fmt: skip
"""How letters that a terminal does not have are written; any other one by its code, such as \\u2026."""


ARGUMENT = re.compile(r"\b(max_unknowns|max_seconds|max_memory|max_steps|rho|algorithm|polygon)=([0-9.]?)")


def say(text: str) -> None:
    """Prints a text on standard output, at once."""
    _print(text, sys.stdout)


def tell(message: object) -> None:
    """Prints one line on standard error, where that can be written."""
    try:
        _print(" ".join(["unilateral:", *as_options(str(message)).split()]), sys.stderr)
    except OSError:
        abandon(sys.stderr)


def as_options(message: str) -> str:
    """The library's arguments, such as max_unknowns=9, as what is typed here: --max-unknowns 9."""

    def option(argument: re.Match[str]) -> str:
        name, value = argument[1].replace("_", "-"), argument[2]
        return f"--{name} {value}" if value else f"--{name}"

    return ARGUMENT.sub(option, message)


def _print(text: str, stream: TextIO) -> None:
    print(text, file=stream, flush=True)


def sized(*files: str | os.PathLike[str]) -> str:
    """The size of files together, such as 12 kB."""
    size = float(sum(os.path.getsize(file) for file in files))
    for unit in ("B", "kB", "MB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def load(module: str) -> Any:
    """Import a module. An interrupt ends it at once: some libraries make another error of it."""
    before = signal.signal(signal.SIGINT, leave)
    try:
        return import_module(module)
    finally:
        signal.signal(signal.SIGINT, before)


def prepare() -> None:
    """Make what is printed end neither in a letter that cannot be encoded nor in another file.

    Raises OSError where there is no standard output.
    """
    if sys.stderr is None:  # print would take standard output for it
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        raise OSError("standard output is closed")
    codecs.register_error("unilateral", _named)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        sys.stdout.reconfigure(errors="unilateral")


def abandon(stream: TextIO | None) -> None:
    """Drops what a stream still holds, on which Python would fail once more at its end."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # type: ignore[union-attr]


def _named(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    if letter not in NAMES:
        return codecs.backslashreplace_errors(error)
    return NAMES[letter], error.start + 1
