"""The guaranteed bounds on the total errors of a scene's solutions, over the true errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from study import scenes, tables
from study.tables import ZERO_ERROR_SHARE, error_in_norm
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.discrete.condensed import build_condensed_problem
from unilateral.discrete.problem_data import case_load, obstacle_means, problem_form
from unilateral.fem.condense import condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.case import ExactSolution


def bound_totals(
    mesh: str,
    solutions: str,
    scene: Mapping[str, Any],
    name: str,
    levels: int,
    case_names: Sequence[str],
    ratio: object,
    totals: str,
) -> None:
    """Write the table of the wanted cases on a scene's coarser levels, at the judged h/H."""
    H_over_h = 1 / parse_real(ratio, "judged_ratio")
    solved = tables.load_table(solutions)
    partitions = scenes.scene_partitions(scene)
    cases = [case for case in scenes.load_cases(scene) if case.name in case_names]
    meshes = scenes.refine_to_levels(scenes.read_coarsest_mesh(mesh, scene), levels)
    indices = [
        tabulate_indices(level_mesh, partitions, cases, solved.isel(mesh=[level]), H_over_h)
        for level, level_mesh in enumerate(meshes)
    ]
    parameters = {f"scenes.{name}": scene, "totals.levels": levels, f"totals.scenes.{name}": case_names}
    tables.save_table(tables.join_levels(indices), totals, name, parameters | {"rates.judged_ratio": ratio})


def tabulate_indices(
    mesh: Mesh,
    partitions: Sequence[Partition],
    cases: Sequence[ExactSolution],
    solved: xr.Dataset,
    H_over_h: float,
) -> xr.Dataset:
    """Bounds over errors at one H/h, one level long in `mesh`, of the solutions in a scene's table.

    `total_index_u` and `total_index_lambda` belong to the sharp bounds, `local_index_...` to the cheap ones.
    Those of lambda are over the upper bound on the error, and NaN where lambda_H is exact. `total_index_v`
    takes the sharp bound on ||u - v||_1 for one on ||u - u_h||_1, which it is not.
    """
    k = scenes.find_partition_of_ratio(mesh, partitions, H_over_h)
    spaces = mixed_spaces(condense(mesh, problem_form(cases[0].problem, mesh)), partitions[k])
    runs = [solved.sel(case=case.name).isel(mesh=0, partition=k) for case in cases]
    indices = [_bound_indices(spaces, case, run) for case, run in zip(cases, runs, strict=True)]
    table: dict[str, Any] = {
        name: (("case", "mesh"), [[case_indices[name]] for case_indices in indices]) for name in indices[0]
    }
    table["H"] = ("mesh", [partitions[k].H])
    return xr.Dataset(table, coords={"case": [case.name for case in cases], "h": ("mesh", [mesh.h])})


def _bound_indices(spaces: MixedSpaces, case: ExactSolution, run: xr.Dataset) -> dict[str, float]:
    """Bounds over errors of one solution, of which `run` has the multiplier and the errors."""
    mesh = spaces.mesh
    partition = spaces.partition
    form = spaces.condensed.form
    data = enclose_data(case.problem, mesh, form)
    # u_h = u_D + u(lambda_H), from the stored multiplier; bounds hold for any u_h and any lambda_H >= 0
    mu = run["lambda_H"].values[: len(spaces.cells)]
    u_D = data.constraint.clamped_values
    g_means = obstacle_means(case.problem, partition)
    discrete = build_condensed_problem(spaces, case_load(case, mesh), None, g_means, u_D)
    u_h = u_D + spaces.response(discrete.homogeneous_data[0], mu)
    lambda_H = spaces.extend_by_zero(mu)
    sharp = sharp_bound(data, partition, u_h, lambda_H, form)
    cheap = local_bound(data, partition, u_h, lambda_H, form)
    u_error = float(error_in_norm(run, "h1"))
    lambda_error = float(error_in_norm(run, "hm12", "upper"))
    # Where lambda_H is exact its error is rounding, and no bound over it says anything
    lambda_error = lambda_error if lambda_error > ZERO_ERROR_SHARE * float(run["u_norm"]) else np.nan
    return {
        "total_index_u": sharp.u / u_error,
        "total_index_lambda": sharp.lambda_ / lambda_error,
        "total_index_v": sharp.eta / u_error,
        "local_index_u": cheap.u / u_error,
        "local_index_lambda": cheap.lambda_ / lambda_error,
    }
