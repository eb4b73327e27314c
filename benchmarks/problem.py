"""A problem's data, made once and the same for all solvers; and the judge of what they find.

For the discrete solution w on cells of two edges, r_i = (u - w, phi_i)_1 and any v in V_h,

    ||u - v||_1^2 = ||u - w||_1^2 + 2 r . (w - v) + ||w - v||_1^2.

The first term comes from `h1_distance`, by quadrature; the others are sums.

The solution of a problem file is not known. There `ul.certify` bounds ||u - v||_1, as it does where a problem
has the field `certify`.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import unilateral as ul
from benchmarks.peers.driver import match_nodes
from benchmarks.plan import CELLS, OTHER
from unilateral.arrays import Array
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.local_bounds import local_bound
from unilateral.discrete.problem_data import obstacle_means, problem_form
from unilateral.errors import InputError
from unilateral.fem.edge_matrix import assemble_by_edges
from unilateral.fem.form import H1
from unilateral.fem.hierarchy import Hierarchy, build_hierarchy
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import assemble_load_by_blocks, case_moments
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry.mesh import Mesh, build_conforming_mesh, refine_triangles, refine_uniformly
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, find_polygon
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
    mesh = make_structured_mesh(read_polygon(order), 1 / order["n"])
    return (
        mesh
        if order["flat"] == 1
        else refine_uniformly(flatten_mesh(mesh.coarse or mesh, order["flat"]), mesh.halvings)
    )


def read_polygon(order: Order) -> Polygon:
    """The polygon of that name, or with those vertices."""
    name_or_vertices = order["polygon"]
    if isinstance(name_or_vertices, str):
        return find_polygon(name_or_vertices)
    return Polygon(np.array(name_or_vertices, dtype=float), order["problem"])


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
    case = cases.load_solution(order["case"], read_polygon(order))
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
    """The data of a problem file, as `prepare` has them; `error` is the guaranteed bound on that of w.

    Raises InputError for a problem that the drivers do not solve.
    """
    mesh = mesh_of(order)
    if problem_form(problem, mesh) != H1:
        raise InputError(f"{order['case']}: the drivers know k = c = 1 and contact on all sides only")
    data = enclose_data(problem, mesh, H1)
    cells = {k: partition(mesh, k) for k in OTHER}
    means = {k: obstacle_means(problem, cells[k]) for k in OTHER}
    w = grid(mesh, build_hierarchy(mesh), data.load, means[CELLS], CELLS).solve(CONVERGED)
    bound = local_bound(data, cells[CELLS], w.u, w.lambda_H, H1)
    obstacles = [as_formula(g) for g in problem.g]
    on_sides = np.stack(compile_numpy(obstacles, "xy")(*mesh.points[mesh.boundary].T))
    g = on_sides[mesh.side, np.arange(len(mesh.boundary))]
    stored = {"load": data.load, "obstacle": g, "error": bound.u}
    return {**_arrays(mesh), **stored, **{f"means_{k}": means[k] for k in OTHER}}


def grid(mesh: Mesh, levels: Hierarchy, load: Array, means: Array, edges: int) -> Multigrid:
    """The problem on cells of that many edges, with the cell means (m,) of g."""
    cells_of_H = partition(mesh, edges)
    cells = nested_cells(levels, cells_of_H)
    if cells is None:
        raise InputError(f"cells of {edges} edges do not fit the mesh; take a size that is a multiple of 4")
    return build_multigrid(levels, cells, load, cells_of_H.lengths * means)


def judge(order: Order, data: Path, solutions: Path) -> dict[str, Any]:
    """`errors`, ||u - v||_1 of each v that a driver has found, and `certified`, the guaranteed ones.

    The former are there if u is known, the latter if it is not, or if the order says `certify`. The
    `reference` is the error of w, and `unknowns` are nodes.
    """
    stored = np.load(data)
    candidates = np.load(solutions)
    mesh = mesh_of(order)
    numbers = match_nodes(stored["points"], candidates["points"])
    vs = [candidates[f"u_{k}"][numbers] for k in range(len(candidates.files) - 1)]
    judged: dict[str, Any] = {"unknowns": mesh.n_nodes, "reference": float(stored["error"])}
    if "residual" in stored:
        judged["errors"] = measure_errors(stored, mesh, vs)
    if "residual" not in stored or order["certify"]:
        problem = find_problem(order)
        judged["certified"] = [certify(problem, mesh, v) for v in vs]
    return judged


def measure_errors(stored: Mapping[str, Any], mesh: Mesh, vs: list[Array]) -> list[float]:
    """||u - v||_1 of each v (n,), by the formula above."""
    A, *_ = assemble_by_edges(mesh.triangulation, mesh.points)
    errors = []
    for v in vs:
        difference = stored["w"] - v
        square = stored["error"] ** 2 + 2 * stored["residual"] @ difference + difference @ (A @ difference)
        errors.append(math.sqrt(max(float(square), 0)))
    return errors


def find_problem(order: Order) -> Problem:
    """The problem of a problem file or of a case, as a user has it."""
    if problem_file.is_problem_file(order["case"]):
        return problem_file.load_problem(order["case"])
    return ul.case(order["case"], polygon=read_polygon(order))


def certify(problem: Problem, mesh: Mesh, v: Array) -> dict[str, float]:
    """The guaranteed bound on ||u - v||_1, also relative to u, and the processor seconds of `ul.certify`.

    Both are infinite where it gives none.
    """
    start = time.process_time()
    bounds = ul.certify(problem, mesh, v).bounds
    seconds = time.process_time() - start
    if bounds is None:
        return {"bound": math.inf, "relative_bound": math.inf, "certify_cpu": seconds}
    return {"bound": bounds.u, "relative_bound": bounds.relative_u, "certify_cpu": seconds}


def main(task: str, order: str, *paths: str) -> None:
    """Prepare a problem's data, or judge a solution, as the runner asks in a process of its own."""
    if task == "prepare":
        prepare(json.loads(order), Path(paths[0]))
    else:
        print(json.dumps(judge(json.loads(order), Path(paths[0]), Path(paths[1]))))


if __name__ == "__main__":
    main(*sys.argv[1:])
