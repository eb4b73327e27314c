"""How far refinement by the guaranteed bound on u's error grades meshes to a vertex, and D on these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from study import scenes
from study.experiments.graded.levels import Row, along_levels
from unilateral.arrays import Index
from unilateral.discrete.multilevel import refinements
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.adapted import marked
from unilateral.norms.exact_errors import exact
from unilateral.problems.case import ExactSolution
from unilateral.solvers.stop import Stop


def measure_adapted(study: Mapping[str, Any], stop: Mapping[str, Any]) -> xr.Dataset:
    """Errors over (case, level), NaN beyond a case's last level.

    The algebraic error is a fraction of D, too, not only of ||u - u_h||_1, and so its fraction is squared.
    """
    fine = Stop(**{**stop, "fraction": stop["fraction"] ** 2})
    measured = {
        case.name: along_levels(list(on_adapted(scene, case, study["adapted"], fine)))
        for scene in study["scenes"]
        for case in scenes.cases(scene)
    }
    return xr.concat(measured.values(), "case", join="outer").assign_coords(case=list(measured))


def where_needed(solution: DiscreteSolution) -> Index:
    """The triangles that half of the squared bound comes from."""
    return marked(solution.mesh, solution.shares)


def on_adapted(scene: Mapping[str, Any], case: ExactSolution, unknowns: int, stop: Stop) -> Iterator[Row]:
    """What is measured on each level, from the scene's coarsest mesh on."""
    first = scenes.coarsest_mesh(scene)
    for solution in refinements(case.problem, first, stop, where_needed, unknowns):
        solution.bound()
        yield errors_of(case, solution)


def errors_of(case: ExactSolution, solution: DiscreteSolution) -> Row:
    """||u - u_h||_1 and D of a solution, by the case's exact one."""
    mesh = solution.mesh
    spaces = mixed_spaces(condense(mesh), solution.partition)
    errors = exact(case, spaces).errors(spaces, solution.lambda_H)
    return {
        "unknowns": float(mesh.n_nodes),
        "h1_error": errors.h1,
        "discrete_error": errors.hm12_discrete,
        "shortest_edge": float(np.diff(mesh.s).min()),
        "algebraic_bound": solution.result.bound,
    }
