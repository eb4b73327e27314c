"""The project's ways to solve a problem whose load and cell means of g are given.

`build_multigrid`: from nothing, then a further problem, on other cells, on the same hierarchy. `linear`: A u
= load by the same multigrid, without constraints, as a yardstick. `bound`: multigrid from nothing, then the
guaranteed bound on its error; f, which is enclosed for the load and for the bound, counts for neither.
`recursive`, `sparse`: the interior eliminated by macro-elements or by sparse factors, then the algorithms on
the boundary, each from 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.peers.driver import Clock, order, report
from benchmarks.plan import OTHER
from benchmarks.problem import grid, mesh_of, partition
from unilateral.arrays import Array
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.local_bounds import local_bound
from unilateral.discrete.condensed import build_condensed_problem
from unilateral.fem.condense import CondensedMatrix, condense, condense_factors, form_matrix
from unilateral.fem.form import H1, Form
from unilateral.fem.hierarchy import Hierarchy, build_hierarchy
from unilateral.fem.linear_systems import factorise_by_dissection
from unilateral.fem.macro_elements import MacroElementFactors
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.problems import problem_file
from unilateral.solvers.multigrid import MultigridResult, build_multigrid
from unilateral.solvers.uzawa import uzawa

ALGORITHMS = ("uzawa", "nesterov", "newton")
FIRST = ("mesh", "assembly", "operator")
Order = Mapping[str, Any]
DriverResult = tuple[Array, list[dict[str, Any]], list[Array]]
"""Nodes (n, 2), results, and the u (n,) of each."""


def solve_by_multigrid(clock: Clock, data: Mapping[str, Array], parameters: Order) -> DriverResult:
    """A problem from nothing, and a further one with other cells on the same hierarchy, by multigrid."""
    H = parameters["H_over_h"]
    tolerance = tolerance_of(data, parameters)
    load = data["load"]
    means = data[f"means_{OTHER[H]}"]
    mesh, levels, first = solve_from_nothing(clock, data, parameters)
    further = grid(mesh, levels, load, means, OTHER[H]).solve(tolerance)
    clock.lap("further")
    phases = clock.only(["mesh", "assembly", "solve"]), {"solve": clock.phases["further"]}
    results = [
        {"way": "multigrid", "H_over_h": H, "phases": phases[0], **counts(first)},
        {"way": "further", "H_over_h": OTHER[H], "phases": phases[1], **counts(further)},
    ]
    return mesh.points, results, [first.u, further.u]


def solve_from_nothing(
    clock: Clock, data: Mapping[str, Array], parameters: Order
) -> tuple[Mesh, Hierarchy, MultigridResult]:
    """Mesh, hierarchy and solution by multigrid, in the phases `mesh`, `assembly` and `solve`."""
    H = parameters["H_over_h"]
    tolerance = tolerance_of(data, parameters)
    load = data["load"]
    means = data[f"means_{H}"]
    clock.skip()
    mesh = mesh_of(parameters)
    clock.lap("mesh")
    levels = build_hierarchy(mesh)
    clock.lap("assembly")
    result = grid(mesh, levels, load, means, H).solve(tolerance)
    clock.lap("solve")
    return mesh, levels, result


def linear(clock: Clock, data: Mapping[str, Array], parameters: Order) -> DriverResult:
    """A linear problem, without cells, by multigrid."""
    load = data["load"]
    none = data["load"][:0]
    clock.skip()
    mesh = mesh_of(parameters)
    clock.lap("mesh")
    levels = build_hierarchy(mesh, form=Form(free=tuple(range(mesh.polygon.n_sides))))
    clock.lap("assembly")
    cells = nested_cells(levels, partition(mesh, parameters["H_over_h"]))
    assert cells is not None
    result = build_multigrid(levels, cells, load, none).solve(tolerance_of(data, parameters))
    clock.lap("solve")
    return mesh.points, [{"way": "linear", "phases": clock.only(clock.phases), **counts(result)}], []


def bound(clock: Clock, data: Mapping[str, Array], parameters: Order) -> DriverResult:
    """The solution of a problem file by multigrid, and the guaranteed bound on its error."""
    problem = problem_file.load_problem(parameters["case"])
    (mesh, _, solution) = solve_from_nothing(clock, data, parameters)
    enclosed = enclose_data(problem, mesh, H1)
    cells = partition(mesh, parameters["H_over_h"])
    clock.skip()
    local_bound(enclosed, cells, solution.u, solution.lambda_H, H1)
    clock.lap("bound")
    result = {"way": "bound", "H_over_h": parameters["H_over_h"], "phases": clock.phases, **counts(solution)}
    return mesh.points, [result], [solution.u]


def recursive(clock: Clock, data: Mapping[str, Array], parameters: Order) -> DriverResult:
    """All algorithms on the boundary, with the interior eliminated by macro-elements."""
    return run_boundary_algorithms(clock, data, parameters, condense)


def sparse(clock: Clock, data: Mapping[str, Array], parameters: Order) -> DriverResult:
    """All algorithms on the boundary, with the interior eliminated by sparse factors."""
    return run_boundary_algorithms(
        clock,
        data,
        parameters,
        lambda mesh: condense_factors(mesh, factorise_by_dissection(form_matrix(mesh), mesh.boundary)),
    )


def run_boundary_algorithms(
    clock: Clock, data: Mapping[str, Array], parameters: Order, condense: Callable[[Mesh], CondensedMatrix]
) -> DriverResult:
    """Results of all algorithms from nothing, and for a further load: its elimination, and the steps."""
    load = data["load"]
    means = data[f"means_{parameters['H_over_h']}"]
    clock.skip()
    mesh = mesh_of(parameters)
    clock.lap("mesh")
    condensed = condense(mesh)
    clock.lap("assembly")
    spaces = mixed_spaces(condensed, partition(mesh, parameters["H_over_h"]))
    assert spaces.operator.lambda_min > 0
    clock.lap("operator")
    results = []
    us = []
    for algorithm in ALGORITHMS:
        clock.skip()
        # The load is eliminated anew for each algorithm, as for a further problem
        discrete = build_condensed_problem(spaces, load, condensed.solve(load)[mesh.boundary], means)
        solution = uzawa(spaces.operator, discrete.offset, tolerance_of(data, parameters), method=algorithm)
        us.append(spaces.response(load, solution.lambda_H))
        clock.lap("solve")
        step_counts = {
            "H_over_h": parameters["H_over_h"],
            "iterations": solution.iterations,
            "sets": solution.iterations,
        }
        for way, phases in ((algorithm, [*FIRST, "solve"]), (f"further {algorithm}", ["solve"])):
            results.append({"way": f"{parameters['way']} {way}", "phases": clock.only(phases), **step_counts})
    if isinstance(condensed.factors, MacroElementFactors):
        results[0]["operations"] = operations(condensed.factors)
    return mesh.points, results, [u for u in us for _ in range(2)]


def operations(factors: MacroElementFactors) -> float:
    """Operations to eliminate i nodes with o beside them, i^3 / 3 + 2 i^2 o + 2 i o^2, and the last nodes."""
    shapes, i, o = np.array([stage.W.shape for stage in factors.stages], dtype=float).T
    return float(shapes @ (i**3 / 3 + 2 * i**2 * o + 2 * i * o**2) + len(factors.A_3) ** 3 / 3)


def tolerance_of(data: Mapping[str, Array], parameters: Order) -> float:
    """The tolerance of the guaranteed algebraic error, a share of the discrete solution's error."""
    return float(parameters["stop"] * data["error"])


def counts(result: MultigridResult) -> dict[str, int]:
    """Iterations on the finest level, and the sets that were tried there."""
    finest = [count for level, count in result.iteration_counts if level == result.iteration_counts[-1][0]]
    return {"iterations": sum(finest), "sets": len(finest)}


WAYS = {
    "multigrid": solve_by_multigrid,
    "bound": bound,
    "linear": linear,
    "recursive": recursive,
    "sparse": sparse,
}


def main() -> None:
    """A run."""
    data, parameters, path = order()
    clock = Clock()
    report(clock, path, *WAYS[parameters["way"]](clock, data, parameters))


if __name__ == "__main__":
    main()
