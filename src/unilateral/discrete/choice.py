"""Chooses how a discrete problem is solved, by multigrid or condensed to the boundary, and in what memory."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING

from unilateral.bounds.source import Source
from unilateral.discrete.base import DiscreteProblem
from unilateral.discrete.condensed import discretise_on_condensed_spaces
from unilateral.discrete.problem_data import problem_form
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError, IterationWarning
from unilateral.fem.condense import MIN_MACRO_HALVINGS, condense
from unilateral.fem.form import Form
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop
from unilateral.system.memory import available_mb

if TYPE_CHECKING:
    from unilateral.discrete.multilevel import NestedSpaces

    Spaces = MixedSpaces | NestedSpaces

MIN_MULTIGRID_UNKNOWNS = 20_000
"""With this many unknowns multigrid takes up to a third less than condensing to A_3, and with 9500 as much.

In between its few steps, 4 or 6, change its work by half from one size to the next.
"""
COARSE_MESH_UNKNOWNS = 5000
"""The coarse mesh that a large one is refined from has about this many unknowns."""
MAX_CELL_RATIO = 1.5
"""A mesh made by halving has at most this many times the boundary cells of a uniform one that is not."""
MULTIGRID_BYTES = 400
MACRO_ELEMENT_BYTES = 1000
SPARSE_BYTES = 5000
"""Bytes per unknown, as measured with 1e6: by multigrid, and condensed by either way of `fem.condense`."""
CHEAP_BOUND_BYTES = 300
SHARP_BOUND_BYTES = 1400
"""Bytes per unknown for a guaranteed bound, measured likewise: the cheap one, and the sharp one."""
DENSE_ENTRY_BYTES = 64
"""Bytes per entry of A_3 or of S, the scaled dual operator: about eight such matrices are in memory."""


def choose_spaces(problem: Problem, mesh: Mesh, partition: Partition, stop: Stop) -> Spaces:
    """The spaces of a problem, on nested levels where these pay and can follow the partition.

    If levels do not pay, the spaces are condensed ones. An algorithm or a rho that is asked for decides.
    Raises InputError where multigrid is asked for but not possible.
    """
    form = problem_form(problem, mesh)
    if wants_multigrid(stop, mesh.n_nodes):
        from unilateral.discrete.multilevel import nested_spaces  # and with it PyAMG

        nested = nested_spaces(mesh, partition, form=form)
        if nested:
            return nested
        if stop.algorithm == "multigrid":
            raise InputError(
                f"multigrid needs a mesh of '{mesh.polygon.name}' made by refinement, with nodes at the "
                "ends of all cells and two edges or more in each; take H = 2h or 4h, or another algorithm"
            )
    return condensed_spaces(mesh, partition, form)


def discretise_on_spaces(problem: Problem, spaces: Spaces, source: Source | None = None) -> DiscreteProblem:
    """The problem on its spaces, with f as the `source` has it, if that is known."""
    if isinstance(spaces, MixedSpaces):
        return discretise_on_condensed_spaces(problem, spaces, source)
    from unilateral.discrete.multilevel import discretise_on_nested_spaces

    return discretise_on_nested_spaces(problem, spaces, source)


def solve_on_mesh(problem: Problem, mesh: Mesh, partition: Partition, stop: Stop) -> DiscreteSolution:
    """The solution (u_h, lambda_H) of a problem on a mesh and a partition."""
    discrete = discretise_on_spaces(problem, choose_spaces(problem, mesh, partition, stop))
    with warnings.catch_warnings(action="ignore", category=IterationWarning):
        return discrete.solve(stop)


def condensed_spaces(mesh: Mesh, partition: Partition, form: Form) -> MixedSpaces:
    """The spaces condensed to the boundary. Raises InputError where more memory is needed than is free."""
    check_condensing_memory(mesh, partition)
    return mixed_spaces(condense(mesh, form), partition)


def check_condensing_memory(mesh: Mesh, partition: Partition) -> None:
    """Raises InputError where condensing to the boundary takes more memory than is free."""
    bytes_per_unknown = SPARSE_BYTES if mesh.halvings < MIN_MACRO_HALVINGS else MACRO_ELEMENT_BYTES
    dense = DENSE_ENTRY_BYTES * (len(mesh.boundary) + partition.n_cells) ** 2
    needed = (bytes_per_unknown * mesh.n_nodes + dense) / 2**20
    free = available_mb()
    if needed > free:
        raise InputError(
            f"{mesh.n_nodes} unknowns, {len(mesh.boundary)} of them on the boundary, take about "
            f"{needed:.0f} MB without multigrid, and {free:.0f} MB are free; take larger h and H, or for "
            "multigrid H = 2h or 4h"
        )


def choose_halvings(polygon: Polygon, H: float, edges: int, stop: Stop) -> int:
    """How often a coarse mesh is halved to get so many `edges` in each cell of the size H.

    0 where condensing to the boundary is cheaper. It is not halved so often that short sides, which have a
    cell from the beginning, get many cells.
    """
    unknowns = polygon.area * (edges / H) ** 2
    if not wants_multigrid(stop, unknowns):
        return 0
    # the coarse mesh gets about COARSE_MESH_UNKNOWNS, each halving makes four times as many
    max_halvings = max(math.ceil(math.log(unknowns / COARSE_MESH_UNKNOWNS, 4)), 1)
    cells = polygon.counts(H).sum()
    if stop.algorithm == "multigrid":
        return max_halvings
    # 2^k cells for each coarse one, against those of a uniform partition
    candidates = (
        k
        for k in range(max_halvings, 0, -1)
        if 2**k * polygon.counts(2**k * H).sum() <= MAX_CELL_RATIO * cells
    )
    return next(candidates, 0)


def wants_multigrid(stop: Stop, unknowns: float) -> bool:
    """Whether to try multigrid first."""
    pays = stop.algorithm == "auto" and stop.rho is None and unknowns >= MIN_MULTIGRID_UNKNOWNS
    return pays or stop.algorithm == "multigrid"


def bound_memory_mb(mesh: Mesh, sharp: bool) -> float:
    """The MB that a guaranteed bound takes."""
    return (SHARP_BOUND_BYTES if sharp else CHEAP_BOUND_BYTES) * mesh.n_nodes / 2**20


def check_mesh_memory(polygon: Polygon, h: float) -> None:
    """Raises InputError if a mesh of size h is too large for the memory, whichever way it is solved."""
    unknowns = polygon.area / h**2
    needed = MULTIGRID_BYTES * unknowns / 2**20
    free = available_mb()
    if needed > free:
        raise InputError(
            f"h = {h:.4g} makes {unknowns:.2g} unknowns on '{polygon.name}', which take at least "
            f"{needed:.0f} MB, and {free:.0f} MB are free; take h >= {h * (needed / free) ** 0.5:.2g}"
        )
