"""Where the conditions of a case hold: on all sides that are not free, and at the nodes of these."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.case import Case


def held_edges(case: Case, mesh: Mesh) -> Mask:
    """(nb,) which boundary edges lie on no free side."""
    return ~np.isin(mesh.side, case.free_sides)


def held_cells(case: Case, cells: Partition) -> Mask:
    """(m,) which cells lie on no free side."""
    return ~np.isin(cells.side, case.free_sides)


def obstacle(case: Case, mesh: Mesh) -> Array:
    """(nb,) g at the boundary nodes, NaN where both edges are free."""
    nb, edges = len(mesh.boundary), held_edges(case, mesh)
    of_end, g = np.roll(mesh.side, 1), np.full(len(edges), np.nan)
    before = np.flatnonzero(~edges & np.roll(edges, 1))
    side, s = np.where(edges, mesh.side, of_end), mesh.s[:-1].copy()
    s[before] = mesh.s[np.where(before == 0, nb, before)]
    held = np.flatnonzero(edges | np.roll(edges, 1))
    u, _, gap = case.boundary(side[held], s[held] - mesh.polygon.starts[side[held]])
    g[held] = u - gap
    return g
