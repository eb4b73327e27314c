"""Kinds of arguments, the arguments and options that several commands share, and the examples of help."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem

from unilateral.errors import InputError, quote_input

MAX_COUNT_DIGITS = 18
"""Whole numbers have at most this many digits: any of these fits into 64 bits."""
FILE_TYPE = click.Path(readable=False)
FOLDER_TYPE = click.Path(readable=False, file_okay=False)
"""The library says whether files and folders can be read or written."""


def is_count(text: str) -> bool:
    """Whether a text is a whole number without a sign, of at most MAX_COUNT_DIGITS digits."""
    return text.isdecimal() and len(text) <= MAX_COUNT_DIGITS


def parse_positive(text: str | float) -> float:
    """A positive number, also as a fraction such as 1/64; as a type of arguments."""
    from unilateral.formulas.formula import parse_real
    from unilateral.formulas.grammar import syntax_hint

    try:
        number = float(parse_real(text, ""))
    except InputError:
        number = 0.0
    if not 0 < number < float("inf"):
        requirement = "must be a positive number or a fraction such as 1/64"
        raise click.BadParameter(f"'{quote_input(text)}' {requirement}{syntax_hint(str(text), (), None)}")
    return number


def parse_count(text: str | int) -> int:
    """A whole number of at least 1; as a type of arguments."""
    if not is_count(str(text)) or int(text) < 1:
        requirement = f"must be a whole number of at least 1, with at most {MAX_COUNT_DIGITS} digits"
        raise click.BadParameter(f"'{quote_input(text)}' {requirement}")
    return int(text)


def parse_sides(text: str) -> tuple[int | str, ...]:
    """Numbers or names of sides such as 1,2,lid, each once; as a type of arguments."""
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise click.BadParameter(f"'{quote_input(text)}' must be numbers or names of sides such as 1,2,3")
    return tuple(dict.fromkeys(int(word) if is_count(word) else word for word in words))


def complete_problem(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Files, and the names of cases."""
    from unilateral.problems.catalogue import case_names

    return complete_names(incomplete, case_names())


def complete_polygon(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Files, and the names of polygons."""
    from unilateral.geometry.polygon import polygon_names

    return complete_names(incomplete, polygon_names())


def complete_names(incomplete: str, names: list[str]) -> list[CompletionItem]:
    """Files and the names that begin so; files come first, because bash drops what stands before them."""
    fitting = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [CompletionItem(incomplete, type="file"), *fitting]


problem_argument = click.argument(
    "problem",
    shell_complete=complete_problem,
    help="the name of a case, or a YAML file that declares a problem or a case",
)
json_option = click.option("--json", is_flag=True, help="print one JSON object, and nothing else")
sharp_option = click.option(
    "--sharp", is_flag=True, help="tighter bounds, above all for lambda, which take longer"
)
output_option = click.option(
    "-o",
    "--output",
    type=FILE_TYPE,
    metavar="FILE",
    multiple=True,
    help="keep the solution: .vtu, .csv, .nc, .json, .svg, .png, .pdf or .html; may be repeated",
)
certificate_option = click.option(
    "--certificate",
    type=FILE_TYPE,
    metavar="FILE",
    help="a file, .json or .json.gz, from which a short separate program proves the bound",
)


def format_examples(*lines: str) -> str:
    """The end of a command's help: lines that work as typed, one after the other, in an empty folder."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])
