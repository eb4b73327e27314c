"""What the size of the cells alone does: cases on one mesh, on cells of the size H and a period below.

A Cantor set looks the same on scales a factor of `period` apart, and errors on its transitions follow that:
rates are formed over one period. The cases have one u and differ in g, so that what depends on u
alone is found once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from unilateral.arrays import Array
from unilateral.discrete.condensed import solve, with_solution
from unilateral.errors import InputError
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, uniform
from unilateral.norms.exact_errors import Exact, cell_means_of_gaps
from unilateral.norms.ritz import RitzProjection, ritz_projection
from unilateral.problems.cantor import Cantor
from unilateral.problems.case import Case
from unilateral.solvers.stop import Stop

MEASURED = ("discrete_error", "consistency", "algebraic_bound", "quadrature_share", "converged")


def measure(mesh: Mesh, cases: Sequence[Case], sizes: Sequence[float], period: int, stop: Stop) -> xr.Dataset:
    """Errors over (case, start, level): on cells of each of the sizes, and of that size over the period.

    Raises InputError where the cases do not have one u, which is a Cantor atom.
    """
    orders = np.array([(_flux_order(case, cases[0]), case.gap_order) for case in cases])
    condensed = condense(mesh)
    ritz = ritz_projection(cases[0], condensed)
    H = np.array(sizes)[:, None] / [1.0, period]
    found = np.array(
        [
            [on_partition(condensed, cases, ritz, uniform(mesh.polygon, size), stop) for size in row]
            for row in H
        ]
    )
    table = {
        name: (("case", "start", "level"), found[..., k].T.swapaxes(1, 2)) for k, name in enumerate(MEASURED)
    }
    return xr.Dataset(
        table
        | {
            "flux_order": ("case", orders[:, 0]),
            "gap_order": ("case", orders[:, 1]),
            "ritz_error": ((), ritz.ritz_error),
        },
        coords={"case": [case.name for case in cases], "h": mesh.h, "H": (("start", "level"), H)},
    )


def _flux_order(case: Case, first: Case) -> float:
    (atom,) = case.atoms
    if not isinstance(atom, Cantor) or case.declaration["u"] != first.declaration["u"]:
        raise InputError(f"cells, cases: '{case.name}' needs the u of '{first.name}', one cantor atom")
    return atom.flux_order


def on_partition(
    condensed: Condensed, cases: Sequence[Case], ritz: RitzProjection, partition: Partition, stop: Stop
) -> Array:
    """(case, MEASURED) on one partition."""
    spaces, found = mixed_spaces(condensed, partition), []
    for case, cells in zip(cases, cell_means_of_gaps(cases, partition), strict=True):
        exact = Exact(replace(ritz, case=case), cells)
        result = solve(with_solution(spaces, exact), stop).result
        errors = exact.errors(spaces, result.lambda_H)
        solved = (result.bound, errors.quadrature_share, float(result.converged))
        found.append((errors.hm12_discrete, cells.consistency, *solved))
    return np.array(found)
