"""The kinds of arguments, and the options that several commands have."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import click
from click.shell_completion import CompletionItem

from unilateral.cli.command import option
from unilateral.cli.streams import load
from unilateral.errors import InputError, meant

Context: TypeAlias = click.Context | None
Parameter: TypeAlias = click.Parameter | None


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
            self.fail(f"'{value}' must be a positive number or a fraction such as 1/64{mended}", param, ctx)
        return number


class Count(click.ParamType):
    """A whole number of at least 1."""

    name = "count"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> int:
        if not str(value).isdecimal() or int(value) < 1:
            self.fail(f"'{value}' must be a whole number of at least 1", param, ctx)
        return int(value)


class Sides(click.ParamType):
    """Numbers of sides such as 1,2,3."""

    name = "sides"

    def convert(self, value: Any, param: Parameter, ctx: Context) -> tuple[int, ...]:
        parts = value.split(",")
        if not all(part.isdecimal() for part in parts):
            self.fail(f"'{value}' must be numbers of sides such as 1,2,3", param, ctx)
        return tuple(sorted({int(part) for part in parts}))


class Choice(click.Choice[str]):
    """One of a few names."""

    def get_invalid_choice_message(self, value: Any, ctx: Context) -> str:
        return f"'{value}' is none of {', '.join(self.choices)}{meant(value, self.choices)}"


class Name(click.ParamType):
    """A name that the library knows or, where it takes `files`, a file.

    The library says what is wrong with it.
    """

    name = "name"

    def __init__(self, known: Callable[[], Sequence[str]], files: bool = True) -> None:
        self.known, self.files = known, files

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
FILE, FOLDER = click.Path(readable=False), click.Path(readable=False, file_okay=False)
CASE, POLYGON = Name(_cases), Name(_polygons)
as_json = option("--json", is_flag=True, help="print one JSON object, and nothing else")
