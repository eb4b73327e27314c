"""The commands: what they take from the command line, and what they run.

What takes long to import is imported for the command that needs it, so that help comes at once.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from unilateral.cli.streams import load, say
from unilateral.errors import InputError

CLAIM_FAILS = 1
OF_ACCURACY = {"absolute", "dry_run", "norm", "max_unknowns", "max_seconds", "max_memory"}
EXIT_CODES = (
    "exit codes: 0 done, 1 a claim does not hold, 2 bad input, 3 not converged or out of budget, "
    "4 the system or this program failed, 130 interrupted"
)


def run(arguments: Sequence[str] | None) -> int:
    """Run what the arguments say; the exit code. Raises InputError for arguments that do not fit."""
    try:
        options = _parser().parse_args(arguments, argparse.Namespace(begin=time.perf_counter()))
    except SystemExit:  # after --help and --version
        return 0
    return int(options.run(options))


class _Parser(argparse.ArgumentParser):
    add: Callable[[argparse.ArgumentParser], None] | None = None
    """Adds the arguments of a command once that is chosen."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        if self.add:
            self.add(self)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see '{self.prog} --help'")

    def _print_message(self, message: str, file: object = None) -> None:
        """Help and version; argparse's own method keeps silent where they cannot be written."""
        say(message.rstrip("\n"))


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        say(f"unilateral {load('unilateral').__version__}")
        parser.exit()


def _parser() -> _Parser:
    parser = _Parser(
        prog="unilateral",
        allow_abbrev=False,
        description="Mixed finite elements for unilateral problems, verified.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    common: dict[str, Any] = {"allow_abbrev": False, "epilog": EXIT_CODES}
    cases = commands.add_parser("cases", help="list the manufactured cases with their certificates", **common)
    cases.set_defaults(run=_cases)
    claims = commands.add_parser(
        "claims", help="judge the paper's statements by the study's results", **common
    )
    claims.set_defaults(run=_claims)
    claims.add_argument("claim", metavar="ID", nargs="?", help="explain this one, such as 4.12")
    claims.add_argument("--results", metavar="FOLDER", default="results", help="default results")
    init = commands.add_parser("init", help="write a commented problem file to begin with", **common)
    init.set_defaults(run=_init)
    init.add_argument("problem", metavar="FILE", help="a new file, such as my_problem.yaml")
    check = commands.add_parser("check", help="show what is understood of a problem file", **common)
    check.set_defaults(run=_check)
    check.add_argument("problem", metavar="FILE", help="a YAML file that declares a problem")
    check.add_argument("--out", metavar="PICTURE", help="draw it, too: a .svg, .png or .pdf file")
    solve = commands.add_parser("solve", help="solve one problem, with its errors", **common)
    solve.set_defaults(run=_solve)
    solve.add = _add_solve
    export = commands.add_parser("export", help="write a case as files for another solver", **common)
    export.set_defaults(run=lambda options: load("unilateral.cli.exchange").export(options))
    export.add = _add_export
    score = commands.add_parser("score", help="judge another solver's solutions of such files", **common)
    score.set_defaults(run=lambda options: load("unilateral.cli.exchange").score(options))
    score.add = _add_score
    return parser


def _add_score(score: argparse.ArgumentParser) -> None:
    score.add_argument("folder", metavar="DIR", help="what `unilateral export` wrote")
    score.add_argument("solutions", metavar="SOLUTION", nargs="+", help="a file for each level")
    score.add_argument(
        "--multiplier",
        metavar="FILE",
        nargs="+",
        help="CSV files of start, end, multiplier, one per solution",
    )
    score.add_argument("--json", action="store_true", help="print one JSON object")


def _add_export(export: argparse.ArgumentParser) -> None:
    export.add_argument("case", metavar="CASE", help="a case's name, or a YAML file that declares a case")
    export.add_argument("--h", type=_positive, help="mesh size on the boundary, on the finest level")
    export.add_argument("--H", type=_positive, required=True, help="size of the cells, on the finest level")
    export.add_argument("--levels", type=_count, default=1, help="each halves h and H (default 1)")
    export.add_argument("--mesh", metavar="FILE", help="of your own, the coarsest level, in place of --h")
    export.add_argument("--out", metavar="DIR", required=True, help="a folder that is not there yet")


def _add_solve(solve: argparse.ArgumentParser) -> None:
    from unilateral.accuracy.level import MAX_SECONDS, NORMS
    from unilateral.geometry.polygon import names
    from unilateral.solvers.iterate import ALGORITHMS, Stop

    solve.description = (
        "Solve one problem, on given sizes --h and --H or up to an --accuracy that is then guaranteed."
    )
    solve.add_argument(
        "problem", metavar="PROBLEM", help="a case's name, or a YAML file that declares a case or a problem"
    )
    solve.add_argument("--json", action="store_true", help="print one JSON object")
    solve.add_argument(
        "-o",
        "--output",
        action="append",
        metavar="FILE",
        help="keep the solution: .vtu, .csv, .nc, .json, .svg, .png or .pdf; may be repeated",
    )
    solve.add_argument("--out", metavar="FOLDER", help="the same in a folder, with all that is useful")
    solve.add_argument(
        "--sharp",
        action="store_true",
        help="slower bounds, mostly nearer to the errors, above all of lambda",
    )
    sizes = solve.add_argument_group("on given sizes")
    sizes.add_argument("--h", type=_positive, help="mesh size on the boundary, such as 1/64")
    sizes.add_argument("--H", type=_positive, help="size of the multiplier's cells, such as 1/32")
    sizes.add_argument(
        "--tolerance", type=_positive, help="of the algebraic bound (default 1 %% of the errors)"
    )
    goal = solve.add_argument_group("up to an accuracy")
    goal.add_argument(
        "--accuracy",
        type=_positive,
        help="relative, such as 1e-2; chooses h, H and the stop; Ctrl-C keeps the best so far",
    )
    goal.add_argument(
        "--absolute",
        action="store_const",
        const=True,
        help="the accuracy is the largest error itself, not a part of the norm; may be 1 and more",
    )
    goal.add_argument(
        "--dry-run",
        action="store_const",
        const=True,
        help="only say what it will take: unknowns, seconds, MB, and what meshes",
    )
    goal.add_argument("--norm", choices=NORMS, help="of u in H1 (default) or of lambda in H^(-1/2)")
    goal.add_argument(
        "--max-unknowns",
        type=_count,
        metavar="N",
        help="on the finest mesh (default: what the memory allows)",
    )
    goal.add_argument(
        "--max-seconds",
        type=_positive,
        metavar="S",
        help=f"then the best so far is kept, with its bound (default {MAX_SECONDS:g})",
    )
    goal.add_argument(
        "--max-memory",
        type=_positive,
        metavar="MB",
        help="the same for the memory of this process (default: what is free)",
    )
    domain = solve.add_argument_group("domain and multipliers")
    domain.add_argument("--polygon", help=f"of a case: {' or '.join(names())} (default: the case's first)")
    domain.add_argument("--side", type=int, help="on which a case is put (default 0)")
    domain.add_argument(
        "--free-sides", type=_sides, metavar="I,J,...", help="of a case: sides without contact, as free ones"
    )
    domain.add_argument(
        "--leave-out-idle-sides",
        action="store_true",
        help="of a problem: no multipliers on sides that provably carry no contact",
    )
    domain.add_argument(
        "--mesh",
        metavar="KIND|FILE",
        help="structured, unstructured (default: structured where there is one, and with --accuracy refined "
        "where it pays), or a file with triangles",
    )
    method = solve.add_argument_group("iteration")
    method.add_argument(
        "--algorithm",
        choices=ALGORITHMS,
        default="auto",
        help="default auto: multigrid on large meshes, else uzawa",
    )
    method.add_argument("--rho", type=_positive, help="Uzawa's step (default 1.9 / lambda_max(S))")
    method.add_argument(
        "--max-steps",
        type=_count,
        default=Stop.max_steps,
        help=f"of uzawa and its faster kinds (default {Stop.max_steps})",
    )


def _positive(text: str) -> float:
    from unilateral.formulas.formula import real

    try:
        value = real(text, "")
    except InputError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' must be a positive number or a fraction such as 1/64")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' must be a whole number of at least 1")
    return int(text)


def _sides(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"'{text}' must be numbers of sides such as 1,2,3")
    return tuple(sorted({int(part) for part in parts}))


def _cases(_: argparse.Namespace) -> int:
    for line in load("unilateral.cli.cases").listing():
        print(line)
    return 0


def _claims(options: argparse.Namespace) -> int:
    claims = load("unilateral.study.judge.claims")
    results = claims.Results(options.results)
    if options.claim is None:
        found = claims.judge(results)
        print(claims.summary(found))
    else:
        found = claims.judge(results, [claims.find(options.claim)])
        print(claims.explanation(found[0]))
    return 0 if all(each.holds for each in found) else CLAIM_FAILS


def _init(options: argparse.Namespace) -> int:
    load("unilateral.cli.own").init(options.problem)
    say(f"{options.problem} is written; edit it, then: unilateral check {options.problem}")
    return 0


def _check(options: argparse.Namespace) -> int:
    say(load("unilateral.cli.own").check(options.problem, options.out))
    return 0


def _solve(options: argparse.Namespace) -> int:
    _check_alternatives(options)
    return int(load("unilateral.cli.solve").run(options))


def _check_alternatives(options: argparse.Namespace) -> None:
    """Raises InputError unless the options are those of given sizes, or those of an accuracy."""
    given = {name for name, value in vars(options).items() if value is not None}
    if options.accuracy is None:
        needed = ("h", "H") if options.mesh in (None, "structured", "unstructured") else ("H",)
        missing = [name for name in needed if name not in given]
        if missing:
            named = " and ".join(f"--{name}" for name in needed)
            raise InputError(f"solve needs {named}, or --accuracy; --{missing[0]} is missing")
        wrong, why = given & OF_ACCURACY, "is only for --accuracy"
    else:
        if options.accuracy >= 1 and not options.absolute:
            raise InputError(
                "argument --accuracy: it is relative and must be below 1, such as 1e-2, unless --absolute"
            )
        wrong, why = {"h", "H", "tolerance"} & given, "is chosen by --accuracy; leave one of the two out"
    for name in sorted(wrong):
        raise InputError(f"--{name.replace('_', '-')} {why}")
