"""The command `unilateral`: its commands, each imported when it is chosen, and its completion."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from importlib.util import find_spec

import click

from unilateral.cli.command import DOES_NOT_HOLD, NOT_CONVERGED, Command, said
from unilateral.cli.streams import load, say
from unilateral.errors import InputError
from unilateral.system.optional import lacking, wanted

NAME = "unilateral"
COMPLETE = "_UNILATERAL_COMPLETE"
"""The variable that a shell sets to ask for completions, as click names it."""
COMMANDS = {
    "solve": "solve a problem, with guaranteed bounds on the errors",
    "init": "write a commented problem file to start from",
    "check": "show how a problem file is read",
    "cases": "list the manufactured cases, or show one with its formulas",
    "export": "write a case as files for another solver",
    "score": "judge another solver's solutions of an exported case",
    "certify": "bound the errors of another solver's solution of your problem",
    "infsup": "check whether a mesh and a partition are stable",
    "claims": "show the verdict on each of the paper's statements",
}
"""Each command and what it is for."""
PACKAGES = {
    "cases": ("sympy",),
    "export": ("sympy", "meshio", "pandas", "xarray"),
    "score": ("sympy", "meshio", "pandas", "xarray"),
    "certify": ("meshio", "pandas"),
    "infsup": ("gmsh",),
}
"""The optional packages without which a command can do nothing."""
MODULES = {"solve": "unilateral.cli.solve_options", "claims": "study.ledger.command"}
"""Where a command is defined that is not in `commands`. The study's one is there after `make`."""


class Application(Command, click.Group):
    """The group of all commands."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [name for name in COMMANDS if name != "claims" or _has_study()]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        if name not in self.list_commands(ctx):
            ctx.fail("claims belongs to the study, which 'make' installs in a clone of the project")
        found: click.Command = getattr(load(MODULES.get(name, "unilateral.cli.commands")), name)
        found.short_help, found.packages = COMMANDS[name], PACKAGES.get(name, ())  # type: ignore[attr-defined]
        return found

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_options(ctx, formatter)
        with formatter.section("Commands"):
            names = self.list_commands(ctx)
            formatter.write_dl([(name, f"{COMMANDS[name]}{_needed(name)}") for name in names])


def _has_study() -> bool:
    """Whether the study is installed, which stands beside the library and has a command of its own."""
    try:
        return find_spec(MODULES["claims"]) is not None
    except ModuleNotFoundError:
        return False


def _needed(name: str) -> str:
    """What has to be installed before a command can be used."""
    missing = lacking(*PACKAGES.get(name, ()))
    return f" (needs {wanted(*missing)})" if missing else ""


def _version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        say(f"{NAME} {load('unilateral').__version__}")
        ctx.exit()


application = Application(
    NAME,
    help="Solve contact (Signorini) problems on polygons, with guaranteed bounds on the errors.",
    params=[
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_version,
            help="show the version and exit",
        )
    ],
    examples=(
        "unilateral init my_problem.yaml",
        "unilateral solve my_problem.yaml --accuracy 0.1",
        "unilateral solve --help",
    ),
    also=(DOES_NOT_HOLD, NOT_CONVERGED),
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def run(arguments: Sequence[str]) -> int:
    """Run what the arguments say; the exit code. Raises InputError for arguments that do not fit."""
    if COMPLETE in os.environ:
        from click.shell_completion import shell_complete

        return shell_complete(application, {}, NAME, COMPLETE, os.environ[COMPLETE])
    begin = time.perf_counter()
    try:
        with application.make_context(NAME, [*arguments], obj=begin) as context:
            return int(application.invoke(context))
    except click.exceptions.Exit as end:  # after --help and --version
        return end.exit_code
    except click.UsageError as error:
        raise InputError(said(error)) from None
