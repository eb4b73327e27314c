"""A problem's data, made once and the same for all solvers; and the judge of what they find.

For the discrete solution w on cells of two edges, r_i = (u - w, phi_i)_1 and any v in V_h,

    ||u - v||_1^2 = ||u - w||_1^2 + 2 r . (w - v) + ||w - v||_1^2.

The first term comes from `h1_distance`, by quadrature; the others are sums.

The solution of a problem file is not known. There ||u - w||_1 has a guaranteed bound, and ||u - v||_1 at most
that and ||w - v||_1.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.driver import match_nodes
from benchmarks.plan import CELLS, OTHER
from unilateral.arrays import Array
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.local_bounds import local_bound
from unilateral.discrete.problem_data import obstacle_means
from unilateral.errors import InputError
from unilateral.fem.edge_matrix import assemble_by_edges
from unilateral.fem.form import H1
from unilateral.fem.hierarchy import Hierarchy, build_hierarchy
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import assemble_load_by_blocks, case_moments
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry.mesh import Mesh, build_conforming_mesh, refine_triangles, refine_uniformly
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.ritz import h1_distance, multiplier_load
from unilateral.problems import case as cases
from unilateral.problems import problem_file
from unilateral.problems.case import ExactSolution
from unilateral.problems.problem import Problem, as_formula
from unilateral.solvers.multigrid import Multigrid, build_multigrid
from unilateral.system.files import replacing

MIN_COARSE_NODES = 1000
"""Other solvers begin with a mesh of at least so many nodes: its matrices are factorised in milliseconds."""
CONVERGED = 1e-7
"""The algebraic error of w: below all errors in H1 here by four orders of magnitude."""
Order = Mapping[str, Any]


def mesh_of(order: Order) -> Mesh:
    """The structured mesh of n squares in a unit, made by refinement."""
    mesh = make_structured_mesh(find_polygon(order["polygon"]), 1 / order["n"])
    return (
        mesh
        if order["flat"] == 1
        else refine_uniformly(flatten_mesh(mesh.coarse or mesh, order["flat"]), mesh.halvings)
    )


def flatten_mesh(mesh: Mesh, flat: float) -> Mesh:
    """Every second inner node moved to the right, until a share `flat` of the distance h is left."""
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), mesh.boundary)
    shifted = inner[np.round(points[inner].sum(axis=1) / mesh.h) % 2 == 0]
    points[shifted, 0] += (1 - flat) * mesh.h
    return build_conforming_mesh(mesh.polygon, points, mesh.triangles)


def prepare(order: Order, path: Path) -> None:
    """The data of a problem in a file, see below.

    `load` (n,), and the cell `means_K` of g on cells of K edges; the `error` in H1 of the discrete solution
    w. Up to the size `judged` also the meshes, g at boundary nodes, w and `residual` (n,), r above; beyond
    it the error is that of the size `judged`, smaller by the ratio of the sizes.
    """
    if problem_file.is_problem_file(order["case"]):
        _save(path, _solve_unknown_problem(problem_file.load_problem(order["case"]), order))
        return
    case = cases.load_solution(order["case"], find_polygon(order["polygon"]))
    mesh = mesh_of(order)
    load = assemble_load_by_blocks(mesh, partial(case_moments, case))
    data: dict[str, Any] = {"load": load} | {
        f"means_{k}": cell_means(case, partition(mesh, k)).g_means for k in OTHER
    }
    if order["n"] <= order["judged"]:
        data |= _solve_known_problem(case, mesh, load, data[f"means_{CELLS}"])
    else:
        judged_data = np.load(path.with_name(f"{order['problem']}-{order['judged']}.npz"))
        data["error"] = judged_data["error"] * order["judged"] / order["n"]
    _save(path, data)


def _save(path: Path, data: dict[str, Any]) -> None:
    with replacing(path) as temporary:
        np.savez(temporary, **data)


def partition(mesh: Mesh, edges: int) -> Partition:
    """Cells of that many edges."""
    return Partition(mesh.polygon, mesh.s[::edges].copy())


def _solve_known_problem(case: ExactSolution, mesh: Mesh, load: Array, means: Array) -> dict[str, Any]:
    levels = build_hierarchy(mesh)
    w = grid(mesh, levels, load, means, CELLS).solve(CONVERGED).u
    # r_i = (u - w, phi_i)_1 = (f, phi_i) + <lambda, phi_i> - (w, phi_i)_1
    residual = load - levels.A @ w
    residual[mesh.boundary] += multiplier_load(case, mesh)
    u, _, gap = case.trace_flux_and_gap(mesh.side, mesh.s[:-1] - mesh.polygon.starts[mesh.side])
    errors = {"w": w, "residual": residual, "error": h1_distance(case, mesh, w)}
    return {**_arrays(mesh), "obstacle": u - gap, **errors}


def _arrays(mesh: Mesh) -> dict[str, Any]:
    """The mesh, and the meshes of which it is a refinement, from the first that is fine enough.

    Nodes keep their numbers when a mesh is refined. So the nodes of level k are the first ones, and the
    further nodes of the next level are the middles of edges, whose `ends_k` are nodes of level k.
    """
    levels = [mesh.coarse or mesh]
    while len(levels) <= mesh.halvings:
        levels.append(refine_triangles(levels[-1]))
    levels = [level for level in levels if level.n_nodes >= MIN_COARSE_NODES] or [mesh]
    arrays: dict[str, Any] = {"points": mesh.points, "n_levels": len(levels)}
    for k, level in enumerate(levels):
        arrays |= {f"triangles_{k}": level.triangles.astype(np.int32)}
        arrays |= {f"boundary_{k}": level.boundary, f"s_{k}": level.s}
    for k, finer in enumerate(levels[1:]):
        arrays[f"ends_{k}"] = finer.steps[-1].ends.astype(np.int32)
    return arrays


def _solve_unknown_problem(problem: Problem, order: Order) -> dict[str, Any]:
    """The data of a problem file, as `prepare` has them; `error` is the guaranteed bound on that of w."""
    mesh = mesh_of(order)
    data = enclose_data(problem, mesh, H1)
    cells = {k: partition(mesh, k) for k in OTHER}
    means = {k: obstacle_means(problem, cells[k]) for k in OTHER}
    w = grid(mesh, build_hierarchy(mesh), data.load, means[CELLS], CELLS).solve(CONVERGED)
    bound = local_bound(data, cells[CELLS], w.u, w.lambda_H, H1)
    obstacles = [as_formula(g) for g in problem.g]
    on_sides = np.stack(compile_numpy(obstacles, "xy")(*mesh.points[mesh.boundary].T))
    g = on_sides[mesh.side, np.arange(len(mesh.boundary))]
    stored = {"load": data.load, "obstacle": g, "w": w.u, "error": bound.u}
    return {**_arrays(mesh), **stored, **{f"means_{k}": means[k] for k in OTHER}}


def grid(mesh: Mesh, levels: Hierarchy, load: Array, means: Array, edges: int) -> Multigrid:
    """The problem on cells of that many edges, with the cell means (m,) of g."""
    cells_of_H = partition(mesh, edges)
    cells = nested_cells(levels, cells_of_H)
    if cells is None:
        raise InputError(f"cells of {edges} edges do not fit the mesh; take a size that is a multiple of 4")
    return build_multigrid(levels, cells, load, cells_of_H.lengths * means)


def judge(order: Order, data: Path, solutions: Path) -> dict[str, Any]:
    """||u - v||_1 of each v that a driver has found, and of w; bounds on them where u is not known."""
    stored = np.load(data)
    candidates = np.load(solutions)
    mesh = mesh_of(order)
    A, *_ = assemble_by_edges(mesh.triangulation, mesh.points)
    numbers = match_nodes(stored["points"], candidates["points"])
    squares = []
    for k in range(len(candidates.files) - 1):
        difference = stored["w"] - candidates[f"u_{k}"][numbers]
        if "residual" not in stored:
            # ||u - v||_1 <= bound on ||u - w||_1 + ||w - v||_1
            squares.append((float(stored["error"]) + math.sqrt(difference @ (A @ difference))) ** 2)
            continue
        squares.append(
            float(stored["error"] ** 2 + 2 * stored["residual"] @ difference + difference @ (A @ difference))
        )
    return {"reference": float(stored["error"]), "errors": [math.sqrt(max(square, 0)) for square in squares]}


def main(task: str, order: str, *paths: str) -> None:
    """Prepare a problem's data, or judge a solution, as the runner asks in a process of its own."""
    if task == "prepare":
        prepare(json.loads(order), Path(paths[0]))
    else:
        print(json.dumps(judge(json.loads(order), Path(paths[0]), Path(paths[1]))))


if __name__ == "__main__":
    main(*sys.argv[1:])
