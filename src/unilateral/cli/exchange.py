"""The commands `unilateral export` and `unilateral score`."""

from __future__ import annotations

import argparse
from pathlib import Path

from unilateral import api
from unilateral.choice import check_size
from unilateral.cli.streams import say
from unilateral.errors import InputError
from unilateral.exchange import export as exports
from unilateral.geometry.structured import natural_kind
from unilateral.problems import problem_file

MOST_LEVELS = 12


def export(options: argparse.Namespace) -> int:
    """Write a case as files; the exit code."""
    if problem_file.is_declared_in(options.case):
        raise InputError(f"{options.case} declares a problem; only a case has the solution to score by")
    if (options.h is None) == (options.mesh is None):
        raise InputError("export needs either --h or --mesh")
    if options.levels > MOST_LEVELS:
        raise InputError(f"argument --levels: {options.levels} is more than {MOST_LEVELS}")
    case = api.case(options.case)
    if options.mesh is None:
        check_size(case.polygon, options.h)
        coarsest = options.h * 2 ** (options.levels - 1)
        mesh = api.KINDS[natural_kind(case.polygon)](case.polygon, coarsest)
    elif not Path(options.mesh).is_file():
        raise InputError(f"argument --mesh: there is no file '{options.mesh}'")
    else:
        mesh = api.mesh(options.mesh, case.polygon)
    exports.export(case, mesh, options.H, options.levels, options.out)
    say(f"{case.name}: {options.levels} levels in {options.out}")
    return 0
