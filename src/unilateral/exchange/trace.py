"""Functions on the boundary that are linear on the cells of a partition: what a multiplier is read as."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import spsolve

from unilateral.arrays import Array
from unilateral.fem.p1 import boundary_mass
from unilateral.fem.quadrature import boundary_rule
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.functionals import values_on
from unilateral.norms.ritz import hat_load
from unilateral.problems.case import Case


@dataclass(frozen=True, eq=False)
class Trace:
    """Linear between the values `ends` (m, 2) at the ends of each cell.

    `nodal` (nb,): its values at the boundary nodes where it is P1, None where it is constant on the cells.
    """

    cells: Partition
    ends: Array
    nodal: Array | None = None

    @property
    def values(self) -> Array:
        """(m,) of a function that is constant on the cells, else `ends`."""
        return self.ends[:, 0] if self.nodal is None else self.ends

    def load(self, mesh: Mesh) -> Array:
        """<mu, phi_j> (nb,) of the boundary hats."""
        cuts, edge, cell = overlay(mesh.s, self.cells.points)
        rule = boundary_rule(mesh.polygon, cuts)
        values = values_on(self.cells, rule, cell[rule.interval], self.values[None])[:, 0]
        return hat_load(mesh, rule._replace(interval=edge[rule.interval]), values)

    def distance(self, case: Case) -> float:
        """||lambda - mu||_0, NaN where lambda is not in L2."""
        weight, flux, mu = self.beside(case)
        return math.sqrt(weight @ (flux - mu) ** 2) if case.flux_in_L2 else math.nan

    def beside(self, case: Case) -> tuple[Array, Array, Array]:
        """Weights (Q,), lambda (Q,) and mu (Q,) at the points of a rule that sees the case."""
        rule = boundary_rule(case.polygon, self.cells.points, case.singular())
        flux = case.boundary(rule.side, rule.s, rule.near)[1]
        return rule.weight, flux, values_on(self.cells, rule, rule.interval, self.values[None])[:, 0]

    def reversed(self) -> Trace:
        """The same, constant on the cells, taken to be given clockwise."""
        s = self.cells.polygon.perimeter - self.cells.points[::-1]
        middle = 0.5 * (self.cells.points[1:] + self.cells.points[:-1])
        there = np.searchsorted(s, middle, side="right") - 1
        return Trace(self.cells, self.ends[::-1, ::-1][there])


def constant(cells: Partition, values: Array) -> Trace:
    """The function with the values (m,) on the cells."""
    return Trace(cells, np.repeat(values[:, None], 2, axis=1))


def continuous(mesh: Mesh, values: Array) -> Trace:
    """The function that is linear on the boundary edges, with the values (nb,) at the boundary nodes."""
    return Trace(Partition(mesh.polygon, mesh.s), np.column_stack([values, np.roll(values, -1)]), values)


def of_reactions(mesh: Mesh, reactions: Array) -> Trace:
    """The continuous mu with <mu, phi_j> = the reactions (nb,): by the boundary mass matrix."""
    return continuous(mesh, np.asarray(spsolve(boundary_mass(mesh).tocsc(), reactions)))
