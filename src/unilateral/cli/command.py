"""What commands are declared with: kinds of arguments, how help ends, how what does not fit is told."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

import click
from click.shell_completion import CompletionItem

from unilateral.cli.streams import load
from unilateral.errors import InputError, meant, shown
from unilateral.system.optional import require

CODES = {
    0: "done",
    1: "a claim or a judged solution fails",
    2: "bad input",
    3: "not converged or out of budget",
    4: "the system or this program failed",
    130: "interrupted",
    143: "ended by SIGTERM",
}
"""What the exit codes say."""
DOES_NOT_HOLD, NOT_CONVERGED = 1, 3
MAX_DIGITS = 18
"""Whole numbers have at most this many digits: any of these fits into 64 bits."""
MAX_NAME, MAX_PATH = 255, 4095
"""No name of a file, and no path, is longer."""
LONG = re.compile(rf"(?<=\()[^()]{{{MAX_NAME + 1},}}(?=\))|(?<=')[^']{{{MAX_NAME + 1},}}(?=')")
"""What click's messages quote of the command line, if it is long."""
EVERY = {0, 2, 4, 130, 143}
"""The codes of every command."""


class Option(click.Option):
    """An option that help lists below a heading."""

    def __init__(self, *args: Any, heading: str = "Options", **rest: Any) -> None:
        super().__init__(*args, **rest)
        self.heading = heading


class Command(click.Command):
    """A command whose help ends with examples and with the exit codes that it may return.

    The examples work as typed, one after the other. `also` are codes that not every command has. Without the
    optional `packages` there is help, but nothing else.
    """

    packages: Sequence[str] = ()

    def __init__(self, *args: Any, examples: Sequence[str], also: Sequence[int] = (), **rest: Any) -> None:
        super().__init__(*args, **rest)
        self.examples, self.codes = examples, sorted({*EVERY, *also})

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx  # which an option without its argument does not have
            raise

    def invoke(self, ctx: click.Context) -> Any:
        require(f"'{ctx.command_path}' needs", *self.packages)
        return super().invoke(ctx)

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        found = super().get_help_option(ctx)
        if found:
            found.help = "show this message and exit"
        return found

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and not isinstance(param, click.Argument):
                sections.setdefault(getattr(param, "heading", "Options"), []).append(record)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Examples"):
            for line in self.examples:
                formatter.write(f"{'':{formatter.current_indent}}{line}\n")
        with formatter.section("Exit codes"):
            formatter.write_dl([(str(code), CODES[code]) for code in self.codes])


command, option, argument = (
    partial(click.command, cls=Command),
    partial(click.option, cls=Option),
    click.argument,
)


def said(error: click.UsageError) -> str:
    """What is wrong with the arguments, and where to look."""
    place = f"; see '{error.ctx.command_path} --help'" if error.ctx else ""
    return f"{_fault(error)}{place}"


def _fault(error: click.UsageError) -> str:
    if isinstance(error, click.NoSuchOption) and error.ctx:
        known = [name for param in error.ctx.command.get_params(error.ctx) for name in param.opts]
        return f"there is no option {shown(error.option_name)}{meant(error.option_name, known)}"
    if isinstance(error, click.NoSuchCommand) and error.ctx and isinstance(error.ctx.command, click.Group):
        known = error.ctx.command.list_commands(error.ctx)
        name = shown(error.command_name)
        is_problem = name.endswith((".yaml", ".yml")) or name in _cases()
        instead = f"; did you mean solve {name}?" if is_problem else meant(error.command_name, known)
        return f"there is no command '{name}'{instead}"
    if isinstance(error, click.MissingParameter) and error.param:
        return f"{_name(error.param)} is missing"
    if isinstance(error, click.BadParameter) and error.param:
        return f"argument {_name(error.param)}: {LONG.sub(lambda long: shown(long[0]), error.message)}"
    message = LONG.sub(lambda long: shown(long[0]), error.message)
    return f"{message[:1].lower()}{message[1:].rstrip('.')}"


def _name(param: click.Parameter) -> str:
    return param.human_readable_name if isinstance(param, click.Argument) else max(param.opts, key=len)


Context: TypeAlias = click.Context | None
Parameter: TypeAlias = click.Parameter | None


def is_count(text: str) -> bool:
    """Whether a text is a whole number without a sign, of a size that is read."""
    return text.isdecimal() and len(text) <= MAX_DIGITS


class File(click.Path):
    """The name of a file or a folder; the library says whether it can be read or written."""

    def convert(self, value: Any, param: Parameter, ctx: Context) -> Any:
        if too_long(value):
            self.fail(f"'{shown(value)}' is too long for the name of a file", param, ctx)
        return super().convert(value, param, ctx)


def too_long(name: str) -> bool:
    """Whether no system has a file of that name."""
    return len(name) > MAX_PATH or max(map(len, name.split("/"))) > MAX_NAME


class Positive(click.ParamType):
    """A positive number, or a fraction such as 1/64."""

    name = "positive"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> float:
        if isinstance(value, float):  # a default
            return value
        try:
            number = float(load("unilateral.formulas.formula").real(value, ""))
        except InputError:
            number = math.nan
        if not 0 < number < math.inf:
            mended = load("unilateral.formulas.grammar").comma(value)
            what = "must be a positive number or a fraction such as 1/64"
            self.fail(f"'{shown(value)}' {what}{mended}", param, ctx)
        return number


class Count(click.ParamType):
    """A whole number of at least 1."""

    name = "count"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> int:
        if not is_count(str(value)) or int(value) < 1:
            limits = f"of at least 1, with at most {MAX_DIGITS} digits"
            self.fail(f"'{shown(value)}' must be a whole number {limits}", param, ctx)
        return int(value)


class Sides(click.ParamType):
    """Numbers of sides such as 1,2,3."""

    name = "sides"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> tuple[int, ...]:
        parts = value.split(",")
        if not all(map(is_count, parts)):
            self.fail(f"'{shown(value)}' must be numbers of sides such as 1,2,3", param, ctx)
        return tuple(sorted({int(part) for part in parts}))


class Choice(click.Choice[str]):
    """One of a few names."""

    def get_invalid_choice_message(self, value: Any, ctx: Context) -> str:
        return f"'{shown(value)}' is none of {', '.join(self.choices)}{meant(value, self.choices)}"


class Name(click.ParamType):
    """A name that the library knows or, where it takes `files`, a file; the library says what is wrong."""

    name = "name"

    def __init__(self, known: Callable[[], Sequence[str]], files: bool = True) -> None:
        self.known, self.files = known, files

    def convert(self, value: Any, param: Parameter, ctx: Context) -> Any:
        if too_long(value):
            self.fail(f"'{shown(value)}' is too long for a name", param, ctx)
        return value

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """The completions, files first, because bash drops what comes before them."""
        found = [CompletionItem(incomplete, type="file")] if self.files else []
        return found + [CompletionItem(name) for name in self.known() if name.startswith(incomplete)]


def _cases() -> list[str]:
    return list(load("unilateral.problems.catalogue").names())


def _polygons() -> list[str]:
    return list(load("unilateral.geometry.polygon").names())


POSITIVE, COUNT, SIDES = Positive(), Count(), Sides()
FILE, FOLDER = File(readable=False), File(readable=False, file_okay=False)
CASE, POLYGON = Name(_cases), Name(_polygons)
as_json = option("--json", is_flag=True, help="print one JSON object, and nothing else")
