"""The command `unilateral`: a group of commands."""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from shlex import join

import click

from unilateral.cli import commands, solve_commands
from unilateral.cli.arguments import format_examples
from unilateral.errors import quote_input

EXIT_CODES = """\b
Exit codes:
  0    done
  1    a claim or a judged solution fails
  2    bad input
  3    not converged or out of budget
  4    the system or this program failed
  130  interrupted
  143  ended by SIGTERM"""


class CommandGroup(click.Group):
    """A group of commands that answers a problem file in the place of a command with what to type."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is named, and its arguments; UsageError for an unknown one."""
        if args[0].endswith((".yaml", ".yml")) and not ctx.resilient_parsing:
            ctx.fail(f"No such command {quote_input(args[0])!r}. Type: unilateral solve {join(args)}")
        return super().resolve_command(ctx, args)


@click.group(
    cls=CommandGroup,
    epilog="\n\n".join(
        [
            format_examples(
                "unilateral init my_problem.yaml",
                "unilateral solve my_problem.yaml",
                "unilateral solve --help",
            ),
            EXIT_CODES,
        ]
    ),
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="unilateral", message="%(prog)s %(version)s")
def application() -> None:
    """Solve contact (Signorini) problems on polygons, with guaranteed bounds on the errors."""


@click.command(hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def claims_command() -> None:
    """Stands in for the study's command."""
    raise click.UsageError("claims belongs to the study, which 'make' installs in a clone of the project")


application.add_command(solve_commands.solve_command)
application.add_command(solve_commands.certify_command)
application.add_command(commands.init_command)
application.add_command(commands.check_command)
application.add_command(commands.cases_command)
application.add_command(commands.export_command)
application.add_command(commands.score_command)
application.add_command(commands.infsup_command)


def has_study() -> bool:
    """Whether this project's study is installed; another module of that name is not imported."""
    spec = find_spec("study")
    folders = spec.submodule_search_locations if spec else None
    return any(Path(folder, "ledger", "command.py").is_file() for folder in folders or ())


# The library does not know the study, which brings a command where it is installed
application.add_command(import_module("study.ledger.command").claims if has_study() else claims_command)
