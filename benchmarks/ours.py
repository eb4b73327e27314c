"""This project's ways to solve a problem whose load and cell means of g are given.

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
Told = tuple[Array, list[dict[str, Any]], list[Array]]
"""Nodes (n, 2), results, and the u (n,) of each."""


def by_multigrid(clock: Clock, data: Mapping[str, Array], of: Order) -> Told:
    """From nothing, and further."""
    H = of["H_over_h"]
    tolerance = tolerance_of(data, of)
    load = data["load"]
    means = data[f"means_{OTHER[H]}"]
    mesh, levels, first = from_nothing(clock, data, of)
    further = grid(mesh, levels, load, means, OTHER[H]).solve(tolerance)
    clock.lap("further")
    phases = clock.only(["mesh", "assembly", "solve"]), {"solve": clock.phases["further"]}
    results = [
        {"way": "multigrid", "H_over_h": H, "phases": phases[0], **counts(first)},
        {"way": "further", "H_over_h": OTHER[H], "phases": phases[1], **counts(further)},
    ]
    return mesh.points, results, [first.u, further.u]


def from_nothing(
    clock: Clock, data: Mapping[str, Array], of: Order
) -> tuple[Mesh, Hierarchy, MultigridResult]:
    """By multigrid, in the phases `mesh`, `assembly` and `solve`."""
    H = of["H_over_h"]
    tolerance = tolerance_of(data, of)
    load = data["load"]
    means = data[f"means_{H}"]
    clock.skip()
    mesh = mesh_of(of)
    clock.lap("mesh")
    levels = build_hierarchy(mesh)
    clock.lap("assembly")
    found = grid(mesh, levels, load, means, H).solve(tolerance)
    clock.lap("solve")
    return mesh, levels, found


def linear(clock: Clock, data: Mapping[str, Array], of: Order) -> Told:
    """Without cells."""
    load = data["load"]
    none = data["load"][:0]
    clock.skip()
    mesh = mesh_of(of)
    clock.lap("mesh")
    levels = build_hierarchy(mesh, form=Form(free=tuple(range(mesh.polygon.n_sides))))
    clock.lap("assembly")
    cells = nested_cells(levels, partition(mesh, of["H_over_h"]))
    assert cells is not None
    found = build_multigrid(levels, cells, load, none).solve(tolerance_of(data, of))
    clock.lap("solve")
    return mesh.points, [{"way": "linear", "phases": clock.only(clock.phases), **counts(found)}], []


def bound(clock: Clock, data: Mapping[str, Array], of: Order) -> Told:
    """From nothing, and the bound, of a problem file."""
    problem = problem_file.load_problem(of["case"])
    (mesh, _, found) = from_nothing(clock, data, of)
    enclosed = enclose_data(problem, mesh, H1)
    cells = partition(mesh, of["H_over_h"])
    clock.skip()
    local_bound(enclosed, cells, found.u, found.lambda_H, H1)
    clock.lap("bound")
    result = {"way": "bound", "H_over_h": of["H_over_h"], "phases": clock.phases, **counts(found)}
    return mesh.points, [result], [found.u]


def recursive(clock: Clock, data: Mapping[str, Array], of: Order) -> Told:
    """By macro-elements."""
    return eliminated(clock, data, of, condense)


def sparse(clock: Clock, data: Mapping[str, Array], of: Order) -> Told:
    """By sparse factors."""
    return eliminated(
        clock,
        data,
        of,
        lambda mesh: condense_factors(mesh, factorise_by_dissection(form_matrix(mesh), mesh.boundary)),
    )


def eliminated(
    clock: Clock, data: Mapping[str, Array], of: Order, condense: Callable[[Mesh], CondensedMatrix]
) -> Told:
    """All algorithms, each from nothing, and further: the load eliminated, and the steps."""
    load = data["load"]
    means = data[f"means_{of['H_over_h']}"]
    clock.skip()
    mesh = mesh_of(of)
    clock.lap("mesh")
    condensed = condense(mesh)
    clock.lap("assembly")
    spaces = mixed_spaces(condensed, partition(mesh, of["H_over_h"]))
    assert spaces.operator.lambda_min > 0
    clock.lap("operator")
    results = []
    us = []
    for algorithm in ALGORITHMS:
        clock.skip()
        discrete = build_condensed_problem(spaces, load, condensed.solve(load)[mesh.boundary], means)
        found = uzawa(spaces.operator, discrete.offset, tolerance_of(data, of), method=algorithm)
        us.append(spaces.response(load, found.lambda_H))
        clock.lap("solve")
        told = {"H_over_h": of["H_over_h"], "iterations": found.iterations, "sets": found.iterations}
        for way, phases in ((algorithm, [*FIRST, "solve"]), (f"further {algorithm}", ["solve"])):
            results.append({"way": f"{of['way']} {way}", "phases": clock.only(phases), **told})
    if isinstance(condensed.factors, MacroElementFactors):
        results[0]["operations"] = operations(condensed.factors)
    return mesh.points, results, [u for u in us for _ in range(2)]


def operations(factors: MacroElementFactors) -> float:
    """Of eliminating i nodes with o beside them, i^3 / 3 + 2 i^2 o + 2 i o^2 each, and the last ones."""
    shapes, i, o = np.array([stage.W.shape for stage in factors.stages], dtype=float).T
    return float(shapes @ (i**3 / 3 + 2 * i**2 * o + 2 * i * o**2) + len(factors.A_3) ** 3 / 3)


def tolerance_of(data: Mapping[str, Array], of: Order) -> float:
    """Of the guaranteed algebraic error."""
    return float(of["stop"] * data["error"])


def counts(found: MultigridResult) -> dict[str, int]:
    """Iterations on the finest level, and the sets that were tried there."""
    finest = [count for level, count in found.iteration_counts if level == found.iteration_counts[-1][0]]
    return {"iterations": sum(finest), "sets": len(finest)}


WAYS = {"multigrid": by_multigrid, "bound": bound, "linear": linear, "recursive": recursive, "sparse": sparse}


def main() -> None:
    """A run."""
    data, of, path = order()
    clock = Clock()
    report(clock, path, *WAYS[of["way"]](clock, data, of))


if __name__ == "__main__":
    main()
