"""Functions on the boundary: those that are linear on cells, as which a multiplier is read, and the obstacle.

The conditions of a case hold on all sides that are neither free nor clamped, and at the nodes of these that
are not clamped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import spsolve

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.form import Form
from unilateral.fem.p1 import boundary_mass
from unilateral.fem.quadrature import boundary_rule
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, from_points, overlay
from unilateral.norms.functionals import values_on
from unilateral.norms.ritz import hat_load

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution
    from unilateral.problems.problem import Problem

ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Trace:
    """A function that is linear on each cell, with the values `ends` (m, 2) at the ends of the cell.

    `nodal` (nb,) are its values at the boundary nodes where it is P1, None where it is constant on the cells.
    """

    cells: Partition
    ends: Array
    nodal: Array | None = None

    @property
    def values(self) -> Array:
        """(m,) the values of a function that is constant on the cells, else `ends`."""
        return self.ends[:, 0] if self.nodal is None else self.ends

    def load(self, mesh: Mesh) -> Array:
        """<mu, phi_j> (nb,) of the boundary hats."""
        cuts, edge, cell = overlay(mesh.s, self.cells.points)
        rule = boundary_rule(mesh.polygon, cuts)
        values = values_on(self.cells, rule, cell[rule.interval], self.values[None])[:, 0]
        return hat_load(mesh, rule._replace(interval=edge[rule.interval]), values)

    def distance(self, exact: ExactSolution) -> float:
        """||lambda - mu||_0, NaN where lambda is not in L2."""
        weight, flux, mu = self.beside(exact)
        return math.sqrt(weight @ (flux - mu) ** 2) if exact.flux_in_L2 else math.nan

    def beside(self, exact: ExactSolution) -> tuple[Array, Array, Array]:
        """Weights (Q,), lambda (Q,) and mu (Q,) at the points of a rule for the singularities of lambda."""
        rule = boundary_rule(exact.polygon, self.cells.points, exact.singular())
        flux = exact.boundary(rule.side, rule.s, rule.near)[1]
        return rule.weight, flux, values_on(self.cells, rule, rule.interval, self.values[None])[:, 0]

    def is_constant_on(self, cells: Partition) -> bool:
        """Whether it has one value on each of those cells, up to rounding."""
        _, cell, own = overlay(cells.points, self.cells.points)
        highest = np.full(cells.n_cells, -np.inf)
        lowest = np.full(cells.n_cells, np.inf)
        np.maximum.at(highest, cell, self.ends[own].max(axis=1))
        np.minimum.at(lowest, cell, self.ends[own].min(axis=1))
        return bool(np.all(highest - lowest <= ROUNDING * np.abs(self.ends).max()))

    def without(self, sides: Sequence[int]) -> Trace:
        """The function that is 0 on those sides."""
        return replace(self, ends=np.where(np.isin(self.cells.side, sides)[:, None], 0.0, self.ends))

    def times(self, factor: float) -> Trace:
        """The function times a factor."""
        return Trace(self.cells, factor * self.ends, None if self.nodal is None else factor * self.nodal)

    def carried(self, mesh: Mesh, node: Index) -> Trace:
        """The function with its values at the boundary nodes taken from other nodes, `node` (n,).

        If it is constant on cells it stays as it is.
        """
        if self.nodal is None:
            return self
        values = np.zeros(mesh.n_nodes)
        values[mesh.boundary] = self.nodal
        return continuous(mesh, values[node][mesh.boundary])

    def moved(self, start: float, clockwise: bool) -> Trace:
        """The function as it is if the arc length of its cells began at `start`, and ran clockwise or not.

        Raises InputError where a vertex would lie inside a cell.
        """
        middle = 0.5 * (self.cells.points[1:] + self.cells.points[:-1])
        order = np.argsort((start + (-middle if clockwise else middle)) % self.cells.polygon.perimeter)
        points = np.append(0.0, np.cumsum(self.cells.lengths[order]))
        return constant(from_points(self.cells.polygon, points), self.values[order])


def constant(cells: Partition, values: Array) -> Trace:
    """The function with the values (m,) on the cells."""
    return Trace(cells, np.repeat(values[:, None], 2, axis=1))


def continuous(mesh: Mesh, values: Array) -> Trace:
    """The function that is linear on the boundary edges, with the values (nb,) at the boundary nodes."""
    return Trace(Partition(mesh.polygon, mesh.s), np.column_stack([values, np.roll(values, -1)]), values)


def of_reactions(mesh: Mesh, reactions: Array) -> Trace:
    """The continuous mu with <mu, phi_j> = the reactions (nb,): by the boundary mass matrix."""
    return continuous(mesh, np.asarray(spsolve(boundary_mass(mesh).tocsc(), reactions)))


def has_obstacle(case: Problem, side: Index) -> Mask:
    """(k,) which of the sides (k,) are neither free nor clamped."""
    return ~np.isin(side, [*case.free_sides, *case.clamped_sides])


def obstacle(case: Problem, mesh: Mesh) -> Array:
    """(nb,) g at the boundary nodes, NaN where both edges are free, and on clamped sides."""
    nb = len(mesh.boundary)
    edges = has_obstacle(case, mesh.side)
    of_end = np.roll(mesh.side, 1)
    g = np.full(len(edges), np.nan)
    before = np.flatnonzero(~edges & np.roll(edges, 1))
    side = np.where(edges, mesh.side, of_end)
    s = mesh.s[:-1].copy()
    s[before] = mesh.s[np.where(before == 0, nb, before)]
    clamped = Form(clamped=case.clamped_sides).fixed(mesh)[mesh.boundary]
    held = np.flatnonzero((edges | np.roll(edges, 1)) & ~clamped)
    u, _, gap = case.known_solution().boundary(side[held], s[held] - mesh.polygon.starts[side[held]])
    g[held] = u - gap
    return g
