"""All solves of a scene on one mesh: every case on every partition, from one factorisation."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from study import scenes, tables
from study.stability_constants import bound_multiplier_error, lemma_quotients
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.discrete.problem_data import problem_form
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.norms.infsup import InfSup, infsup_constants
from unilateral.norms.ritz import RitzProjection, ritz_projections
from unilateral.problems.case import ExactSolution
from unilateral.solvers.stop import Stop
from unilateral.system.memory import forget_peak, peak_mb

RUN_VARIABLES = (
    *("h1_error", "hm12_error_lower", "hm12_error_upper", "discrete_error", "hm12_best", "l2_error"),
    *("iterations", "operator_applications", "algebraic_bound", "tolerance", "converged", "balance"),
    *("quadrature_share", "ritz_means"),
)
PAIR_VARIABLES = ("lambda_min", "lambda_max", "beta_lower", "beta_upper", "beta_0")
PARTITION_VARIABLES = ("projection_error", "consistency", "consistency_elsewhere")
CASE_VARIABLES = ("u_norm", "interpolation_error", "ritz_error", "ritz_boundary_error")


def solve_scene(
    norm: str | None,
    scene: Mapping[str, Any],
    name: str,
    stop: Mapping[str, Any],
    mesh: str,
    solutions: str,
    errors: str,
    infsup: str,
    timings: str,
) -> None:
    """Write the tables of every case on every partition, on the coarsest mesh and on its refinements.

    `norm` is the file of the dual norm's forms, if errors are measured in it anywhere.
    """
    gram = Gram.from_table(tables.load_table(norm)) if norm else None
    cases = scenes.load_cases(scene)
    partitions = scenes.scene_partitions(scene)
    solved_levels = []
    timed_levels = []
    coarsest = scenes.coarsest_mesh(scene)
    write_mesh(coarsest, mesh)
    for refined in scenes.refine_to_levels(coarsest, scene["mesh"]["levels"]):
        solved, timed = solve_on_partitions(
            refined, cases, partitions, gram, scenes.H_over_h_limits(scene), Stop(**stop)
        )
        solved_levels.append(solved)
        timed_levels.append(timed)
        print(f"h = {refined.h:.4g} solved")
    solved = tables.join_levels(solved_levels)
    timed = tables.join_levels(timed_levels)
    parameters = {f"scenes.{name}": scene, "stop": stop}
    tables.save_table(solved, solutions, name, parameters)
    tables.save_table(solved.drop_vars("lambda_H"), errors, name, parameters)
    tables.save_table(lemma_quotients(solved), infsup, name, parameters)
    tables.save_table(timed, timings, name, parameters)


def solve_on_partitions(
    mesh: Mesh,
    cases: Sequence[ExactSolution],
    partitions: Sequence[Partition],
    gram: Gram | None,
    H_over_h: tuple[float, float] = (0.0, np.inf),
    stop: Stop = Stop(),  # noqa: B008
) -> tuple[xr.Dataset, xr.Dataset]:
    """The table of results, one level long in `mesh`, and that of times and memory.

    All cases have one form. Only pairs with H/h within the two limits are solved; the rest is NaN. `gram`
    holds the dual norm's forms for these cases, on a partition that refines those given; it is needed where
    beta > 0.
    """
    forget_peak()
    begin = time.perf_counter()
    condensed = condense(mesh, problem_form(cases[0].problem, mesh))
    sigma_1 = condensed.sigma_1  # computed at its first use, and its time counts
    condense_seconds = time.perf_counter() - begin
    table = _empty_table(mesh, cases, partitions)
    table["sigma_1"][:] = sigma_1
    # z_h does not depend on the partition: one projection of each case serves all its runs
    projections = ritz_projections(cases, condensed)
    for name in CASE_VARIABLES:
        table[name].values[:, 0] = [getattr(projection, name) for projection in projections]
    seconds = np.full((len(cases), 1, len(partitions)), np.nan)
    for k, partition in enumerate(partitions):
        # The limits count as reached in spite of rounding
        if H_over_h[0] <= partition.H / mesh.h * (1 + 1e-12) <= H_over_h[1] * (1 + 2e-12):
            pair = _join_spaces(condensed, partition, gram)
            seconds[:, 0, k] = _record_partition(table, k, pair, projections, stop)
    timings = xr.Dataset(
        {
            "seconds": (("case", "mesh", "partition"), seconds),
            "condense_seconds": ("mesh", [condense_seconds]),
            "peak_mb": ("mesh", [peak_mb()]),
        },
        coords={name: table[name] for name in ("case", "h", "H")},
    )
    return table, timings


class _Pair(NamedTuple):
    """V_h x Lambda_H of a mesh and a partition, the constants of (3.4), and the dual norm's forms there.

    `gram` is None where S is singular: beta is 0 there, and no error is measured in the dual norm.
    """

    spaces: MixedSpaces
    stability: InfSup
    gram: Gram | None


def _join_spaces(condensed: CondensedMatrix, partition: Partition, gram: Gram | None) -> _Pair:
    """The pair of a mesh and a partition; the dual norm's forms from those on a refined partition."""
    spaces = mixed_spaces(condensed, partition)
    if spaces.operator.is_singular:
        return _Pair(spaces, InfSup(0.0, 0.0, 0.0), None)
    if gram is None:
        raise ValueError("a pair with beta > 0 needs the dual norm's forms")
    coarse_gram = gram.coarsen(partition)
    return _Pair(spaces, infsup_constants(spaces.operator, coarse_gram.p0), coarse_gram)


def _record_partition(
    table: xr.Dataset, k: int, pair: _Pair, projections: Sequence[RitzProjection], stop: Stop
) -> list[float]:
    """Write all numbers of partition `k` into the table; the seconds of each case's solve and errors."""
    case_means = [cell_means(projection.case, pair.spaces.partition) for projection in projections]
    for name in PARTITION_VARIABLES:
        table[name].values[:, k] = [getattr(means, name) for means in case_means]
    constants = (pair.spaces.operator.lambda_min, pair.spaces.operator.lambda_max, *pair.stability)
    for name, value in zip(PAIR_VARIABLES, constants, strict=True):
        table[name][0, k] = value
    seconds = []
    for case_index, projection in enumerate(projections):
        begin = time.perf_counter()
        exact = CaseProjections(projection, case_means[case_index])
        values, solution = _solve_run(pair, exact, stop)
        seconds.append(time.perf_counter() - begin)
        if pair.gram:
            mean_errors = exact.cell_means.lambda_means - solution.lambda_H
            bounds = bound_multiplier_error(pair.gram, case_index, mean_errors, values["discrete_error"])
            values["hm12_error_lower"], values["hm12_error_upper"] = bounds
            values["hm12_best"] = pair.gram.best_approximations[case_index]
        for name, value in values.items():
            table[name].values[case_index, 0, k] = value
        result = solution.result
        table["algorithm"].values[case_index, 0, k] = result.algorithm
        table["lambda_H"].values[case_index, 0, k, : len(result.lambda_H)] = result.lambda_H
    return seconds


def _solve_run(pair: _Pair, exact: CaseProjections, stop: Stop) -> tuple[dict[str, float], DiscreteSolution]:
    """The RUN_VARIABLES of a case on a pair, without those of the dual norm; and its solution."""
    discrete = discretise_case(pair.spaces, exact)
    solution = solve_condensed_problem(discrete, stop, pair.stability.beta_lower)
    result = solution.result
    errors = exact.errors(pair.spaces, result.lambda_H)
    values = {
        "h1_error": errors.h1,
        "discrete_error": errors.hm12_discrete,
        "l2_error": errors.l2,
        "quadrature_share": errors.quadrature_share,
        "iterations": result.iterations,
        "operator_applications": result.operator_applications,
        "algebraic_bound": result.bound,
        "tolerance": solution.tolerance,
        "converged": float(result.converged),
        "balance": discrete.balance(solution),
        "ritz_means": exact.ritz_means_norm(pair.spaces),
    }
    return values, solution


def _empty_table(mesh: Mesh, cases: Sequence[ExactSolution], partitions: Sequence[Partition]) -> xr.Dataset:
    n = len(cases)
    p = len(partitions)
    H = np.array([partition.H for partition in partitions])
    largest = max(partition.n_cells for partition in partitions)
    clamped = cases[0].clamped_sides
    run = ("case", "mesh", "partition")
    grid = ("mesh", "partition")

    def nan_array(*shape: int) -> np.ndarray:
        """An array for what is not known yet."""
        return np.full(shape, np.nan)

    variables: dict[str, tuple] = {name: (run, nan_array(n, 1, p)) for name in RUN_VARIABLES}
    variables |= {name: (("case", "mesh"), nan_array(n, 1)) for name in CASE_VARIABLES}
    variables |= {name: (grid, nan_array(1, p)) for name in PAIR_VARIABLES}
    variables |= {name: (("case", "partition"), nan_array(n, p)) for name in PARTITION_VARIABLES}
    variables["sigma_1"] = ("mesh", nan_array(1))
    variables["algorithm"] = (run, np.full((n, 1, p), "", dtype=object))
    variables["lambda_H"] = ((*run, "cell"), nan_array(n, 1, p, largest))
    return xr.Dataset(
        variables,
        coords={
            "case": [case.name for case in cases],
            "h": ("mesh", [mesh.h]),
            "diameter": ("mesh", [mesh.diameter]),
            "unknowns": ("mesh", [mesh.n_nodes]),
            "boundary_unknowns": ("mesh", [len(mesh.boundary)]),
            "H": ("partition", H),
            "H_over_Hi_max": ("partition", [partition.H_over_Hi_max for partition in partitions]),
            "multipliers": ("partition", [np.count_nonzero(~np.isin(p.side, clamped)) for p in partitions]),
            "h_over_H": (grid, mesh.h / H[None]),
        },
    )
