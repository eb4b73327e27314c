"""The command line: `unilateral cases`, `unilateral solve` and `unilateral claims`.

Exit codes: 0 done, 1 a claim fails, 2 bad input, 3 not converged. Results go to
standard output, messages to standard error.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

from unilateral import __version__
from unilateral.errors import InputError
from unilateral.expression import real
from unilateral.solve import ALGORITHMS, Stop

LARGEST_BOUNDARY = 4096
CLAIM_FAILS, BAD_INPUT, NOT_CONVERGED = 1, 2, 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _tell(message)
        try:
            options = _parser().parse_args(arguments)
            code = int(options.run(options))
            sys.stdout.flush()
            return code
        except InputError as error:
            _tell(error)
            return BAD_INPUT
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0


def _tell(message: object) -> None:
    """One line on standard error."""
    print("unilateral:", *str(message).split(), file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see '{self.prog} --help'")


def _parser() -> _Parser:
    parser = _Parser(
        prog="unilateral",
        allow_abbrev=False,
        description="Mixed finite elements for unilateral problems, verified.",
    )
    parser.add_argument("--version", action="version", version=f"unilateral {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    cases = commands.add_parser(
        "cases", allow_abbrev=False, help="list the manufactured cases with their certificates"
    )
    cases.set_defaults(run=_cases)
    claims = commands.add_parser(
        "claims", allow_abbrev=False, help="judge the paper's statements by the study's results"
    )
    claims.set_defaults(run=_claims)
    claims.add_argument("claim", metavar="ID", nargs="?", help="explain this one, such as 4.12")
    claims.add_argument("--results", metavar="FOLDER", default="results", help="default results")
    solve = commands.add_parser("solve", allow_abbrev=False, help="solve one case and measure its errors")
    solve.set_defaults(run=_solve)
    solve.add_argument("problem", metavar="PROBLEM", help="a case's name, or the YAML file that declares one")
    solve.add_argument("--h", required=True, type=_positive, help="mesh size on the boundary, such as 1/64")
    solve.add_argument(
        "--H", required=True, type=_positive, help="size of the multiplier's cells, such as 1/32"
    )
    solve.add_argument("--polygon", help="the domain: square or lshape (default: the case's first)")
    solve.add_argument("--side", default=0, type=int, help="the side the case is put on (default 0)")
    solve.add_argument("--mesh", choices=("structured", "unstructured"), default="structured")
    solve.add_argument(
        "--algorithm", choices=ALGORITHMS, default="auto", help="default auto: uzawa where it can"
    )
    solve.add_argument("--rho", type=_positive, help="Uzawa's step (default 1.9 / lambda_max(S))")
    solve.add_argument(
        "--tolerance", type=_positive, help="of the algebraic bound (default 1 %% of the errors)"
    )
    solve.add_argument("--max-steps", type=_count, default=Stop.max_steps, help=f"default {Stop.max_steps}")
    solve.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _positive(text: str) -> float:
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


def _cases(_: argparse.Namespace) -> int:
    from unilateral.catalogue import listing

    for line in listing():
        print(line)
    return 0


def _claims(options: argparse.Namespace) -> int:
    from unilateral import claims

    results = claims.Results(options.results)
    if options.claim is None:
        found = claims.judge(results)
        print(claims.summary(found))
    else:
        found = claims.judge(results, [claims.find(options.claim)])
        print(claims.explanation(found[0]))
    return 0 if all(each.holds for each in found) else CLAIM_FAILS


def _solve(options: argparse.Namespace) -> int:
    found, algorithm = _run(options)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # as Python sets it; gmsh resets it
    if options.json:
        print(json.dumps({key: None if _unknown(value) else value for key, value in found.items()}))
    else:
        print(_text(found, algorithm))
    return 0 if found["converged"] else NOT_CONVERGED


def _unknown(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def _run(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """What --json prints, and the algorithm that ran."""
    from unilateral import case, dual_norm, mesh, norms, partition, polygon
    from unilateral.certificate import certify
    from unilateral.condense import condense
    from unilateral.solve import guarded_beta, pair, solve

    begin = time.perf_counter()
    polygons = case.declared(options.problem)[0]["polygons"]
    domain = polygon.named(options.polygon or ("square" if polygons == "any" else polygons[0]))
    problem = case.load(options.problem, domain, options.side)
    certify(problem)
    for name, size in (("--h", options.h), ("--H", options.H)):
        if domain.perimeter / size > LARGEST_BOUNDARY * (1 + 1e-9):
            least = f"{domain.perimeter / LARGEST_BOUNDARY:.4g}"
            raise InputError(
                f"{name} {size:.4g} is too fine for '{domain.name}'; it must be at least {least}"
            )
    triangulation = getattr(mesh, options.mesh)(domain, options.h)
    cells = partition.uniform(domain, options.H)
    condensed = condense(triangulation)
    both = pair(condensed, cells)
    stop = Stop(
        tolerance=options.tolerance,
        max_steps=options.max_steps,
        algorithm=options.algorithm,
        rho=options.rho,
    )
    solution = solve(
        norms.on_mesh(problem, condensed),
        norms.on_cells(problem, cells),
        both,
        guarded_beta(both, norms.first_steklov(condensed)),
        stop,
    )
    lower = upper = math.nan
    if not both.operator.singular:
        bounds = dual_norm.dual_norm(cells, [problem]).of_error(problem, solution.lambda_H[None])
        lower, upper = max(solution.hm12_discrete, float(bounds.lower[0])), float(bounds.upper[0])
    found = {
        "problem": problem.name,
        "h": triangulation.h,
        "diameter": triangulation.diameter,
        "H": cells.H,
        "unknowns": triangulation.n_nodes,
        "multipliers": cells.n_cells,
        "iterations": solution.result.iterations,
        "converged": bool(solution.result.converged),
        "algebraic_bound": solution.result.bound,
        "h1_error": solution.h1_error,
        "hm12_error_lower": lower,
        "hm12_error_upper": upper,
        "l2_error": solution.l2_error,
        "total_bound": math.nan,
        "seconds": time.perf_counter() - begin,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    return found, solution.result.algorithm


def _text(found: dict[str, Any], algorithm: str) -> str:
    def number(key: str) -> str:
        return why if _unknown(found[key]) else f"{found[key]:.4e}"

    beta_is_0 = _unknown(found["hm12_error_lower"])
    why = "not judged, for beta = 0" if beta_is_0 else "none, for lambda is not in L2"

    steps = "" if _unknown(found["iterations"]) else f" after {found['iterations']} steps"
    dual = f" = {why}"
    if not beta_is_0:
        dual = f">= {number('hm12_error_lower')}"
    if not _unknown(found["hm12_error_upper"]):
        dual += f", <= {number('hm12_error_upper')}"
    outcome = "converged" if found["converged"] else "NOT converged"
    rows = {
        "unknowns": f"{found['unknowns']} and {found['multipliers']} multipliers",
        f"{algorithm} {outcome}": f"algebraic error <= {found['algebraic_bound']:.4e}, guaranteed{steps}",
        "||u - u_h||_1": f" = {number('h1_error')}",
        "||lambda - lambda_H||_-1/2": dual,
        "||lambda - lambda_H||_0": f" = {number('l2_error')}",
        "time and memory": f"{found['seconds']:.2f} s, {found['peak_mb']:.0f} MB",
    }
    ratio = found["h"] / found["H"]
    head = f"{found['problem']}: h = {found['h']:.6g}, H = {found['H']:.6g}, h/H = {ratio:.4g}"
    return "\n".join([head, *(f"  {name:27} {value}" for name, value in rows.items())])
