"""The command `unilateral`: a group of commands."""

import click

from unilateral.cli import commands, solve_commands
from unilateral.cli.arguments import examples

EXIT_CODES = """\b
Exit codes:
  0    done
  1    a claim or a judged solution fails
  2    bad input
  3    not converged or out of budget
  4    the system or this program failed
  130  interrupted
  143  ended by SIGTERM"""


@click.group(
    epilog="\n\n".join(
        [
            examples(
                "unilateral init my_problem.yaml",
                "unilateral solve my_problem.yaml --accuracy 0.1",
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


for command in (
    solve_commands.solve,
    solve_commands.certify,
    commands.init,
    commands.check,
    commands.cases,
    commands.export,
    commands.score,
    commands.infsup,
    commands.claims,
):
    application.add_command(command)
