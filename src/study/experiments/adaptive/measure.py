"""Errors and bounds on uniform meshes and on adapted ones, their rates, and beta on the adapted ones.

Both kinds start from one mesh, with two boundary edges in each cell, and are solved in one way; they differ
in which triangles are refined. From one level to the next u_h, the active cells and what is known of f are
carried over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from study import scenes, tables
from study.stability_constants import pair_constants
from unilateral.arrays import Index
from unilateral.discrete.multilevel import mark_by_bound, solve_refinements
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import from_points, make_uniform_partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import default_mesh_kind, make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.ritz import h1_distance
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.solution.solution import Solution
from unilateral.solvers.stop import Stop

AdaptiveRow = dict[str, float]


class MaxUnknowns(NamedTuple):
    """The most unknowns of a mesh, and of one on which beta is measured."""

    unknowns: int
    of_beta: int


def measure_adaptive(
    examples: Sequence[str],
    study: Mapping[str, Any],
    stop: Mapping[str, Any],
    errors: str,
    infsup: str,
    timings: str,
    rates: str,
) -> None:
    """Write the tables of all cases, and of the problems in the files `examples`."""
    problems: list[Problem] = [
        *(case.problem for scene in study["scenes"] for case in scenes.load_cases(scene))
    ]
    problems += map(problem_file.load_problem, examples)
    h = parse_real(study["h"], "adaptive.h")
    limits = MaxUnknowns(**study["most"])
    measured = []
    for problem in problems:
        measured.append(measure(problem, h, limits, Stop(**stop)))
        print(f"{problem.name} measured")
    names = [problem.name for problem in problems]
    parameters = {"adaptive": study, "stop": stop}
    for case_tables, path in zip(zip(*measured, strict=True), (errors, infsup, timings), strict=True):
        tables.save_table(join_tables(case_tables, "case", names), path, "adaptive", parameters)
    tables.save_table(
        rates_in_unknowns(tables.load_table(errors), study["factor"]), rates, "adaptive", parameters
    )


def mark_all(solution: DiscreteSolution) -> Index:
    """All triangles."""
    return np.arange(len(solution.mesh.triangles))


MARKING_BY_KIND: dict[str, Callable[[DiscreteSolution], Index]] = {
    "uniform": mark_all,
    "adapted": mark_by_bound,
}


def measure(
    problem: Problem, h: float, limits: MaxUnknowns, stop: Stop
) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
    """Errors, constants of (3.4), and timings over (kind, level), NaN beyond a kind's last level.

    Where no solution is known the error is NaN, and so is the number of unknowns from which it is asymptotic.
    """
    first = first_adaptive_mesh(problem.polygon, h)
    errors, constants, timings = [], [], []
    for kind in MARKING_BY_KIND:
        error_rows, constant_rows, timing_rows = zip(
            *_measure_levels(problem, first, kind, limits, stop), strict=True
        )
        errors.append(tables.tabulate_levels(error_rows))
        constants.append(tables.tabulate_levels(constant_rows))
        timings.append(tables.tabulate_levels(timing_rows))
    kinds = list(MARKING_BY_KIND)
    return (
        join_tables(errors, "kind", kinds).assign(asymptotic_from=asymptotic_unknowns(problem)),
        join_tables(constants, "kind", kinds),
        join_tables(timings, "kind", kinds),
    )


def first_adaptive_mesh(polygon: Polygon, h: float) -> Mesh:
    """The mesh with edges of the size h on the boundary, two in each cell of the size 2h."""
    if default_mesh_kind(polygon) == "structured":
        return make_structured_mesh(polygon, h)
    return meshes.triangulate_from_cells(make_uniform_partition(polygon, 2 * h), 2)[0]


def asymptotic_unknowns(problem: Problem) -> float:
    """The unknowns of the uniform mesh from which on a case declares its error in H1 to be asymptotic."""
    if problem.exact is None:
        return np.nan
    declared = problem.exact.declaration["asymptotic"]["h1"]
    # Squares of the side h, n of them: n h^2 = |Omega|
    return problem.polygon.area / parse_real(declared["from"], "asymptotic.h1") ** 2


def _measure_levels(
    problem: Problem, first: Mesh, kind: str, limits: MaxUnknowns, stop: Stop
) -> Iterator[tuple[AdaptiveRow, AdaptiveRow, AdaptiveRow]]:
    """Errors, constants and seconds of each level; seconds include the bound and all levels before."""
    spent = 0.0
    begin = process_time()
    for solution in solve_refinements(problem, first, stop, MARKING_BY_KIND[kind], limits.unknowns):
        solution.bound()
        spent += process_time() - begin
        measured = kind == "adapted" and solution.mesh.n_nodes <= limits.of_beta
        constants = beta_constants(solution) if measured else {}
        half_width = np.nan
        # its rate is judged where a case declares levels asymptotic
        if kind == "adapted" and problem.exact:
            force = Solution(problem, solution).force(sharp=True)
            half_width = 0.5 * (force.upper - force.lower)
        errors = _level_errors(problem, solution) | {"force_half_width": half_width}
        yield errors, constants, {"spent_seconds": spent}
        begin = process_time()


def _level_errors(problem: Problem, solution: DiscreteSolution) -> AdaptiveRow:
    mesh = solution.mesh
    return {
        "unknowns": mesh.n_nodes,
        "multipliers": len(solution.cells),
        "diameter": mesh.longest_edges.max(),
        "shortest_edge": np.diff(mesh.s).min(),
        "h1_error": h1_distance(problem.exact, mesh, solution.u_h) if problem.exact else np.nan,
        "h1_bound": solution.total_bound("h1"),
        "algebraic_bound": solution.result.bound,
        "converged": float(solution.result.converged),
    }


def beta_constants(solution: DiscreteSolution) -> AdaptiveRow:
    """The `pair_constants` of its mesh and cells, also on free sides, and beta with an edge in each cell.

    P0 of the cells lies in that of the edges, and so one Gram matrix serves both. Besides these, what the
    contraction of Uzawa's algorithm depends on: the spectrum of S, and the shortest cell with a multiplier.
    """
    mesh = solution.mesh
    form = solution.form._replace(free=())  # so that free sides carry a multiplier, too
    edges = from_points(mesh.polygon, mesh.s)
    condensed = condense(mesh, form)
    gram = build_dual_norm(edges, form=form).gram()
    spaces = mixed_spaces(condensed, solution.partition)
    cell_constants = pair_constants(spaces, gram.coarsen(solution.partition).p0)
    edge_constants = pair_constants(mixed_spaces(condensed, edges), gram.coarsen(edges).p0)
    return cell_constants | {
        "beta_of_edges": edge_constants["beta_upper"],
        "lambda_min": spaces.operator.lambda_min,
        "lambda_max": spaces.operator.lambda_max,
        "shortest_cell": float(spaces.operator.H_i.min()),
    }


def join_tables(tables: Sequence[xr.Dataset], dim: str, names: Sequence[str]) -> xr.Dataset:
    """The tables as one, along a dimension with these names; NaN where one has fewer levels."""
    return xr.concat(tables, dim, join="outer").assign_coords({dim: list(names)})


def rates_in_unknowns(errors: xr.Dataset, factor: float) -> xr.Dataset:
    """Rates from each level to the first with at least `factor` times its unknowns; NaN where there is none.

    `asymptotic` is 1 where the case declares errors on meshes of that size asymptotic; rates of errors are
    given from there on. `index` is the bound over the error, and `share` the algebraic bound over the error.
    """
    errors = errors.transpose("case", "kind", "level")
    N = errors["unknowns"].values
    order = ("case", "kind", "level")
    later = np.argmax(N[..., None, :] >= factor * N[..., None], axis=-1)
    # log(e_j / e_i) / log(N_j / N_i), j the first level with N_j >= factor N_i; NaN where there is none
    growth = np.where(later > 0, np.log(np.take_along_axis(N, later, axis=-1) / N), 1.0)
    observed = xr.Dataset(coords=errors.coords)
    for name in ("h1_error", "h1_bound"):
        values = errors[name].values
        fall = np.log(np.take_along_axis(values, later, axis=-1) / values)
        observed[name] = (order, np.where(later > 0, -fall / growth, np.nan))
    asymptotic = errors["unknowns"] >= errors["asymptotic_from"]
    return xr.Dataset(
        {
            "error_rate": observed["h1_error"].where(asymptotic),
            "bound_rate": observed["h1_bound"],
            "asymptotic": asymptotic.astype(float),
            "index": errors["h1_bound"] / errors["h1_error"],
            "share": errors["algebraic_bound"] / errors["h1_error"],
        }
    )
