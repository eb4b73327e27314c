"""What all commands share: how their help ends, and how arguments that do not fit are told."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import click

from unilateral.errors import meant

CODES = {
    0: "done",
    1: "a claim or a judged solution does not hold",
    2: "bad input",
    3: "not converged or out of budget",
    4: "the system or this program failed",
    130: "interrupted",
    143: "ended by SIGTERM",
}
"""What the exit codes say."""


class Option(click.Option):
    """An option that help lists below a heading."""

    def __init__(self, *args: Any, heading: str = "Options", **rest: Any) -> None:
        super().__init__(*args, **rest)
        self.heading = heading


class Command(click.Command):
    """A command whose help ends with examples that work as typed and with the codes that it may return.

    Examples are lines to be typed one after the other.
    """

    def __init__(self, *args: Any, examples: Sequence[str], codes: Sequence[int], **rest: Any) -> None:
        super().__init__(*args, **rest)
        self.examples, self.codes = examples, codes

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx  # which an option without its argument does not have
            raise

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
        return f"there is no option {error.option_name}{meant(error.option_name, known)}"
    if isinstance(error, click.NoSuchCommand) and error.ctx and isinstance(error.ctx.command, click.Group):
        known = error.ctx.command.list_commands(error.ctx)
        return f"there is no command '{error.command_name}'{meant(error.command_name, known)}"
    if isinstance(error, click.MissingParameter) and error.param:
        return f"{_name(error.param)} is missing"
    if isinstance(error, click.BadParameter) and error.param:
        return f"argument {_name(error.param)}: {error.message}"
    return f"{error.message[:1].lower()}{error.message[1:].rstrip('.')}"


def _name(param: click.Parameter) -> str:
    return param.human_readable_name if isinstance(param, click.Argument) else max(param.opts, key=len)
