"""Guaranteed bounds and true errors of solutions of other methods."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

import xarray as xr

from study import scenes, tables
from study.experiments.certify.methods import others
from unilateral.formulas.formula import real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.structured import structured
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case import ExactSolution
from unilateral.solution.certification import certify
from unilateral.solution.solver import Solver


def measure_certify(study: Mapping[str, Any], solutions: str) -> None:
    """Write the table of all cases, sizes and methods."""
    sizes, of_cases = [real(h, "certify.h") for h in study["h"]], []
    for case in chain.from_iterable(map(scenes.cases, study["scenes"])):
        levels = [measure(case, structured(case.polygon, h), study) for h in sizes]
        of_cases.append(xr.concat(levels, "mesh").assign_coords(case=case.name))
        print(f"{case.name} measured")
    table = xr.concat(of_cases, "case").assign_coords(h=("mesh", sizes))
    tables.save(table, solutions, "certify", {"certify": study})


def measure(case: ExactSolution, mesh: Mesh, study: Mapping[str, Any]) -> xr.Dataset:
    """The error and its bound over `scheme`, on one mesh."""
    mixed = Solver(case.problem, mesh=mesh, H=2 * mesh.h)().u
    solutions = {"mixed method": mixed, **others(case, mesh, study["penalties"], study["sweeps"])}
    errors = [h1_distance(case, mesh, v) for v in solutions.values()]
    bounds = [certify(case.problem, mesh, v, None).solved.total("h1") for v in solutions.values()]
    values = {"certified_error": ("scheme", errors), "certified_bound": ("scheme", bounds)}
    return xr.Dataset(values, coords={"scheme": list(solutions)})
