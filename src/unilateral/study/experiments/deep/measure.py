"""Large meshes by multigrid: errors of all cases on one level, and the table of all levels.

Neither beta nor lambda_min(S) is known there, so that errors of lambda have no guaranteed algebraic share and
are not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from unilateral.arrays import Array
from unilateral.discrete.choice import cheapest
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.structured import structured
from unilateral.norms.dual import errors
from unilateral.norms.exact import cell_means
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case import Case
from unilateral.solvers.stop import Stop

BLOCK = 1 << 16
"""u is evaluated at no more than so many nodes at a time."""
RUN, GRID = ("case", "mesh", "partition"), ("mesh", "partition")
OF_RUN = ("h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error")


def level(cases: Sequence[Case], h: float, H_over_h: float, stop: Stop) -> xr.Dataset:
    """The errors of all cases on the structured mesh of the size h, one level long in mesh and partition.

    Raises InputError where multigrid cannot follow the partition.
    """
    mesh = structured(cases[0].polygon, h)
    cells = uniform(mesh.polygon, H_over_h * h)
    rows = [_measured(case, mesh, cells, stop) for case in cases]
    found = {name: np.array([row[name] for row in rows])[:, None] for name in rows[0]}
    dims = {"interpolation_error": ("case", "mesh"), "projection_error": ("case", "partition")}
    of_cases = {
        name: (dims[name], values) if name in dims else (RUN, values[..., None])
        for name, values in found.items()
    }
    unknown = {name: (GRID, [[math.nan]]) for name in ("beta_lower", "lambda_min")}
    sizes = {"h": mesh.h, "diameter": mesh.diameter, "unknowns": mesh.n_nodes}
    of_cells = {"H": cells.H, "multipliers": cells.n_cells}
    return xr.Dataset(
        {
            **of_cases,
            **unknown,
            "h_over_H": (GRID, [[mesh.h / cells.H]]),
            **{name: ("mesh", [value]) for name, value in sizes.items()},
            **{name: ("partition", [value]) for name, value in of_cells.items()},
        },
        coords={"case": [case.name for case in cases]},
    )


def _measured(case: Case, mesh: Mesh, cells: Partition, stop: Stop) -> dict[str, float]:
    solution = cheapest(case, mesh, cells, replace(stop, algorithm="multigrid")).solved(stop)
    found = errors(case, mesh, solution.u_h, cells, solution.lambda_H, unique=True, dual=True)
    result = solution.result
    return {
        **dict(zip(OF_RUN, found, strict=True)),
        "iterations": result.iterations,
        "algebraic_bound": result.bound,
        "converged": float(result.converged),
        "interpolation_error": h1_distance(case, mesh, _nodal(case, mesh.points)),
        "projection_error": cell_means(case, cells).projection_error,
    }


def _nodal(case: Case, points: Array) -> Array:
    """u (n,) at the points (n, 2)."""
    blocks = np.array_split(points, math.ceil(len(points) / BLOCK))
    return np.concatenate([case.value_and_gradient(block)[0] for block in blocks])


def diagonal(levels: Iterable[xr.Dataset]) -> xr.Dataset:
    """One table of all levels, NaN for the mesh of one level with the partition of another."""
    numbered = [of.assign_coords(mesh=[k], partition=[k]) for k, of in enumerate(levels)]
    table = xr.merge(numbered, join="outer", compat="no_conflicts").drop_vars(["mesh", "partition"])
    return table.set_coords(["h", "diameter", "unknowns", "H", "multipliers", "h_over_H"])
