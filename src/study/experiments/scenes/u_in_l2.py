"""Errors of u in L2, of solutions whose algebraic error is small against them, too.

The iteration of `measure` stops by errors of lower order. Here it is that of active sets, and its tolerance
has the square of the fraction; `checks.l2_order` asks whether that was enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from study import scenes, tables
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.discrete.problem_data import problem_form
from unilateral.fem.condense import condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.norms.ritz import RitzProjection, l2_distance, ritz_projections
from unilateral.problems.case import ExactSolution
from unilateral.solvers.stop import Stop


def measure_u_in_l2(
    mesh: str, scene: Mapping[str, Any], name: str, stop: Mapping[str, Any], ratio: object, u_in_l2: str
) -> None:
    """Write the table of all cases on all levels of a scene, at the judged h/H."""
    H_over_h = 1 / parse_real(ratio, "judged_ratio")
    fine = Stop(**{**stop, "fraction": stop["fraction"] ** 2}, algorithm="newton")
    partitions = scenes.scene_partitions(scene)
    cases = scenes.load_cases(scene)
    meshes = scenes.refine_to_levels(scenes.read_coarsest_mesh(mesh, scene), scene["mesh"]["levels"])
    levels = []
    for level_mesh in meshes:
        partition = partitions[scenes.find_partition_of_ratio(level_mesh, partitions, H_over_h)]
        levels.append(tabulate_l2_errors(level_mesh, partition, cases, fine))
        print(f"h = {level_mesh.h:.4g} measured")
    parameters = {f"scenes.{name}": scene, "stop": stop, "rates.judged_ratio": ratio}
    tables.save_table(tables.join_levels(levels), u_in_l2, name, parameters)


def tabulate_l2_errors(
    mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution], stop: Stop
) -> xr.Dataset:
    """||u - u_h||_0, D and the least value of lambda_H of all cases on one pair, one level long in `mesh`."""
    condensed = condense(mesh, problem_form(cases[0].problem, mesh))
    spaces = mixed_spaces(condensed, partition)
    runs = [_measure_run(spaces, projection, stop) for projection in ritz_projections(cases, condensed)]
    table: dict[str, Any] = {name: (("case", "mesh"), [[run[name]] for run in runs]) for name in runs[0]}
    coords: dict[str, Any] = {"case": [case.name for case in cases], "h": ("mesh", [mesh.h])}
    return xr.Dataset(table | {"H": ("mesh", [partition.H])}, coords)


def _measure_run(spaces: MixedSpaces, projection: RitzProjection, stop: Stop) -> dict[str, float]:
    exact = CaseProjections(projection, cell_means(projection.case, spaces.partition))
    solution = solve_condensed_problem(discretise_case(spaces, exact), stop)
    result = solution.result
    return {
        "u_l2_error": l2_distance(projection.case, spaces.mesh, solution.u_h),
        "discrete_error": exact.errors(spaces, result.lambda_H).hm12_discrete,
        "least_multiplier": float(np.min(result.lambda_H)),
        "algebraic_bound": result.bound,
        "converged": float(result.converged),
    }
