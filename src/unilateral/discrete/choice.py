"""Which of two ways solves a discrete problem, by multigrid or condensed to the boundary, in what memory."""

from __future__ import annotations

import math

from unilateral.discrete.base import DiscreteProblem
from unilateral.discrete.condensed import CondensedProblem, discretise
from unilateral.errors import InputError
from unilateral.fem.condense import REFINED
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.problems.data import Data
from unilateral.problems.sampled import Sampled
from unilateral.solvers.stop import Stop
from unilateral.system.memory import available_mb

PAYS = 20_000
"""Unknowns from which multigrid is cheaper than A_3; below, importing it alone takes longer."""
COARSE = 5000
"""Unknowns of the coarse mesh that an unstructured one is refined from."""
MORE_CELLS = 1.5
"""Times those of uniform meshes that are not made by halving, at most."""
MULTIGRID, RECURSIVE, SPARSE = 400, 1000, 5000
"""Bytes for an unknown, as measured at 1e6 of them."""
LOCAL, SHARP = 300, 5000
"""The same for guaranteed bounds: the cheap one, and the sharp one."""
DENSE = 64
"""Bytes for an entry of A_3 or S: some eight matrices of that size are held."""


def cheapest(problem: Data | Sampled, mesh: Mesh, partition: Partition, stop: Stop) -> DiscreteProblem:
    """The problem on nested levels where these pay and can follow the partition, else `condensed`.

    An algorithm or a rho that is asked for decides. Raises InputError where multigrid is asked for in vain.
    """
    if wants_multigrid(stop, mesh.n_nodes):
        from unilateral.discrete.multilevel import multilevel  # and with it PyAMG

        found = multilevel(problem, mesh, partition)
        if found:
            return found
        if stop.algorithm == "multigrid":
            raise InputError(
                f"multigrid needs a mesh of '{problem.polygon.name}' made by refinement, with nodes at the "
                "ends of all cells and two edges or more in each; take H = 2h or 4h, or another algorithm"
            )
    return condensed(problem, mesh, partition)


def condensed(problem: Data | Sampled, mesh: Mesh, partition: Partition) -> CondensedProblem:
    """The problem condensed to the boundary. Raises InputError where more memory is needed than is free."""
    check_condensed(mesh, partition)
    return discretise(problem, mesh, partition)


def check_condensed(mesh: Mesh, partition: Partition) -> None:
    """Raises InputError where condensing to the boundary takes more memory than is free."""
    needed, free = condensed_mb(mesh, partition), available_mb()
    if needed > free:
        raise InputError(
            f"{mesh.n_nodes} unknowns, {len(mesh.boundary)} of them on the boundary, take about "
            f"{needed:.0f} MB without multigrid, and {free:.0f} MB are free; take larger h and H, or for "
            "multigrid H = 2h or 4h"
        )


def levels_for(polygon: Polygon, H: float, edges: int, stop: Stop) -> int:
    """How often an unstructured mesh with so many edges in a cell of the size H is to be made by halving.

    0 where A_3 is cheaper; and not so often that short sides, which have a cell from the beginning, get many.
    """
    unknowns = polygon.area * (edges / H) ** 2
    if not wants_multigrid(stop, unknowns):
        return 0
    most, cells = max(math.ceil(math.log(unknowns / COARSE, 4)), 1), polygon.counts(H).sum()
    if stop.algorithm == "multigrid":
        return most
    fit = (k for k in range(most, 0, -1) if 2**k * polygon.counts(2**k * H).sum() <= MORE_CELLS * cells)
    return next(fit, 0)


def wants_multigrid(stop: Stop, unknowns: float) -> bool:
    """Whether to try that first."""
    pays = stop.algorithm == "auto" and stop.rho is None and unknowns >= PAYS
    return pays or stop.algorithm == "multigrid"


def condensed_mb(mesh: Mesh, partition: Partition) -> float:
    """What it takes to condense to the boundary."""
    unknown = SPARSE if mesh.halvings < REFINED else RECURSIVE
    return (unknown * mesh.n_nodes + DENSE * (len(mesh.boundary) + partition.n_cells) ** 2) / 2**20


def bound_mb(mesh: Mesh, sharp: bool) -> float:
    """What a guaranteed bound takes."""
    return (SHARP if sharp else LOCAL) * mesh.n_nodes / 2**20


def check_size(polygon: Polygon, h: float) -> None:
    """Raises InputError if a mesh of that size is too large for the memory, whatever the way."""
    unknowns = polygon.area / h**2
    needed, free = MULTIGRID * unknowns / 2**20, available_mb()
    if needed > free:
        raise InputError(
            f"h = {h:.4g} makes {unknowns:.2g} unknowns on '{polygon.name}', which take at least "
            f"{needed:.0f} MB, and {free:.0f} MB are free; take h >= {h * (needed / free) ** 0.5:.2g}"
        )
