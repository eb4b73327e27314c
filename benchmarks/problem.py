"""A problem's data, made once and the same for all solvers; and the judge of what they find.

For the discrete solution w on cells of two edges, r_i = (u - w, phi_i)_1 and any v in V_h,

    ||u - v||_1^2 = ||u - w||_1^2 + 2 r . (w - v) + ||w - v||_1^2.

The first term comes from `h1_distance`, by quadrature; the others are sums.
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

from benchmarks.peers.driver import matched
from benchmarks.plan import CELLS, OTHER
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.hierarchy import FEWEST, Hierarchy, hierarchy
from unilateral.fem.loads import case_moments
from unilateral.fem.nested_cells import nested_cells
from unilateral.files import replacing
from unilateral.geometry.mesh import Mesh, conforming
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.norms.exact import cell_means
from unilateral.norms.ritz import flux_load, h1_distance
from unilateral.problems import case as cases
from unilateral.problems.case import Case
from unilateral.solvers.multigrid import Multigrid, multigrid

CONVERGED = 1e-7
"""The algebraic error of w: below all errors in H1 here by four orders of magnitude."""
Order = Mapping[str, Any]


def coarsest(order: Order) -> tuple[Mesh, int]:
    """The structured mesh to begin with, and how often to refine it until a unit has n squares."""
    n, refinements = order["n"], 0
    while n % 2 == 0 and n > FEWEST:
        n, refinements = n // 2, refinements + 1
    return flattened(structured(named(order["polygon"]), 1 / n), order["flat"]), refinements


def nested(order: Order) -> Hierarchy:
    """All levels."""
    return hierarchy(*coarsest(order))


def flattened(mesh: Mesh, flat: float) -> Mesh:
    """Every second inner node moved to the right, until a share `flat` of the distance h is left."""
    if flat == 1:
        return mesh
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), mesh.boundary)
    moved = inner[np.round(points[inner].sum(axis=1) / mesh.h) % 2 == 0]
    points[moved, 0] += (1 - flat) * mesh.h
    return conforming(mesh.polygon, points, mesh.triangles)


def prepare(order: Order, path: Path) -> None:
    """The data of a problem in a file, see below.

    `load` (n,), and the cell `means_K` of g on cells of K edges; the `error` in H1 of the discrete solution
    w. Up to the size `judged` also the mesh, g at its boundary nodes, w and `residual` (n,), r above; beyond
    it the error is that of the size `judged`, smaller by the ratio of the sizes.
    """
    case, levels = cases.load(order["case"], named(order["polygon"])), nested(order)
    load = levels.load(partial(case_moments, case))
    found: dict[str, Any] = {"load": load} | {
        f"means_{k}": cell_means(case, partition(levels, k)).g_means for k in OTHER
    }
    if order["n"] <= order["judged"]:
        found |= _judged(case, levels, load, found[f"means_{CELLS}"])
    else:
        of_judged = np.load(path.with_name(f"{order['problem']}-{order['judged']}.npz"))
        found["error"] = of_judged["error"] * order["judged"] / order["n"]
    with replacing(path) as temporary:
        np.savez(temporary, **found)


def partition(levels: Hierarchy, edges: int) -> Partition:
    """Cells of that many edges."""
    return Partition(levels.coarse.polygon, levels.levels[-1].s[::edges].copy())


def _judged(case: Case, levels: Hierarchy, load: Array, means: Array) -> dict[str, Any]:
    mesh, A = levels.mesh, levels.levels[-1].A
    w = grid(levels, load, means, CELLS).solve(CONVERGED).u
    error = h1_distance(case, mesh, w)
    residual = load - A @ w
    residual[mesh.boundary] += flux_load(case, mesh)
    at = mesh.s[:-1] - mesh.polygon.starts[mesh.side]
    u, _, gap = case.boundary(mesh.side, at)
    found = {"points": mesh.points, "triangles": mesh.triangles.astype(np.int32), "boundary": mesh.boundary}
    return {**found, "s": mesh.s, "obstacle": u - gap, "w": w, "residual": residual, "error": error}


def grid(levels: Hierarchy, load: Array, means: Array, edges: int) -> Multigrid:
    """The problem on cells of that many edges, with the cell means (m,) of g."""
    cells_of_H = partition(levels, edges)
    cells = nested_cells(levels.levels, cells_of_H)
    if cells is None:
        raise InputError(f"cells of {edges} edges do not fit the mesh; take a size that is a multiple of 4")
    return multigrid(levels.levels, cells, load, cells_of_H.lengths * means)


def judge(order: Order, data: Path, found: Path) -> dict[str, Any]:
    """||u - v||_1 of each v that a driver has found, and of w."""
    known, given, A = np.load(data), np.load(found), nested(order).levels[-1].A
    numbers, squares = matched(known["points"], given["points"]), []
    for k in range(len(given.files) - 1):
        apart = known["w"] - given[f"u_{k}"][numbers]
        squares.append(float(known["error"] ** 2 + 2 * known["residual"] @ apart + apart @ (A @ apart)))
    return {"reference": float(known["error"]), "errors": [math.sqrt(max(square, 0)) for square in squares]}


def main(what: str, order: str, *paths: str) -> None:
    """What the runner asks for, in a process of its own."""
    if what == "prepare":
        prepare(json.loads(order), Path(paths[0]))
    else:
        print(json.dumps(judge(json.loads(order), Path(paths[0]), Path(paths[1]))))


if __name__ == "__main__":
    main(*sys.argv[1:])
