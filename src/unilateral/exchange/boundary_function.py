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
from unilateral.norms.functionals import evaluate_on_cells
from unilateral.norms.ritz import hat_load

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution
    from unilateral.problems.problem import Problem

MAX_CELL_VARIATION = 1e-12
"""A function varies on a cell if it does by more than this fraction of its largest value."""


@dataclass(frozen=True, eq=False)
class BoundaryFunction:
    """A function that is linear on each cell, with the values `end_values` (m, 2) at the ends of the cell.

    `nodal_values` (nb,) are its values at the boundary nodes where it is P1, None where it is constant on the
    cells.
    """

    partition: Partition
    end_values: Array
    nodal_values: Array | None = None

    @property
    def values(self) -> Array:
        """Values (m,) on the cells if the function is constant on them, else (m, 2) at both ends of each."""
        return self.end_values[:, 0] if self.nodal_values is None else self.end_values

    def load(self, mesh: Mesh) -> Array:
        """Load <mu, phi_j> (nb,) of the boundary hats."""
        # mu phi_j is a polynomial between the ends of cells and of edges
        cuts, edge, cell = overlay(mesh.s, self.partition.points)
        rule = boundary_rule(mesh.polygon, cuts)
        values = evaluate_on_cells(self.partition, rule, cell[rule.interval], self.values[None])[:, 0]
        return hat_load(mesh, rule._replace(interval=edge[rule.interval]), values)

    def distance(self, exact: ExactSolution) -> float:
        """L2 distance ||lambda - mu||_0 from the exact lambda, NaN where that is not in L2."""
        weight, flux, mu = self.sample_with_exact(exact)
        return math.sqrt(weight @ (flux - mu) ** 2) if exact.flux_in_L2 else math.nan

    def sample_with_exact(self, exact: ExactSolution) -> tuple[Array, Array, Array]:
        """Weights (Q,), lambda (Q,) and mu (Q,) at the points of a rule for the singularities of lambda."""
        rule = boundary_rule(exact.polygon, self.partition.points, exact.singular_points())
        flux = exact.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)[1]
        return (
            rule.weight,
            flux,
            evaluate_on_cells(self.partition, rule, rule.interval, self.values[None])[:, 0],
        )

    def is_constant_on(self, partition: Partition) -> bool:
        """Whether the function has one value on each cell of a partition, up to rounding."""
        _, cell, mu_cell = overlay(partition.points, self.partition.points)
        highest = np.full(partition.n_cells, -np.inf)
        lowest = np.full(partition.n_cells, np.inf)
        np.maximum.at(highest, cell, self.end_values[mu_cell].max(axis=1))
        np.minimum.at(lowest, cell, self.end_values[mu_cell].min(axis=1))
        return bool(np.all(highest - lowest <= MAX_CELL_VARIATION * np.abs(self.end_values).max()))

    def zero_on_sides(self, sides: Sequence[int]) -> BoundaryFunction:
        """The function with 0 in place of its values on some sides."""
        return replace(
            self, end_values=np.where(np.isin(self.partition.side, sides)[:, None], 0.0, self.end_values)
        )

    def scale(self, factor: float) -> BoundaryFunction:
        """The function times a factor."""
        return BoundaryFunction(
            self.partition,
            factor * self.end_values,
            None if self.nodal_values is None else factor * self.nodal_values,
        )

    def permute_nodes(self, mesh: Mesh, source_nodes: Index) -> BoundaryFunction:
        """The function with values of `source_nodes` (n,) at nodes; one that is constant on cells stays."""
        if self.nodal_values is None:
            return self
        values = np.zeros(mesh.n_nodes)
        values[mesh.boundary] = self.nodal_values
        return piecewise_linear(mesh, values[source_nodes][mesh.boundary])

    def shift_arc_length(self, start: float, clockwise: bool) -> BoundaryFunction:
        """The function that was meant if its arc length began at `start` and ran clockwise or not.

        Raises InputError where a vertex would lie inside a cell.
        """
        # cells in the order of what their middles are on the true boundary
        middle = 0.5 * (self.partition.points[1:] + self.partition.points[:-1])
        order = np.argsort((start + (-middle if clockwise else middle)) % self.partition.polygon.perimeter)
        points = np.append(0.0, np.cumsum(self.partition.lengths[order]))
        return piecewise_constant(from_points(self.partition.polygon, points), self.values[order])


def piecewise_constant(partition: Partition, values: Array) -> BoundaryFunction:
    """The function that has the values (m,) on the cells."""
    return BoundaryFunction(partition, np.repeat(values[:, None], 2, axis=1))


def piecewise_linear(mesh: Mesh, values: Array) -> BoundaryFunction:
    """The function that is linear on the boundary edges, with the values (nb,) at the boundary nodes."""
    return BoundaryFunction(
        Partition(mesh.polygon, mesh.s), np.column_stack([values, np.roll(values, -1)]), values
    )


def represent_reactions(mesh: Mesh, reactions: Array) -> BoundaryFunction:
    """The continuous P1 function mu with <mu, phi_j> = the reactions (nb,): M mu = r on the boundary."""
    return piecewise_linear(mesh, np.asarray(spsolve(boundary_mass(mesh).tocsc(), reactions)))


def has_obstacle(case: Problem, sides: Index) -> Mask:
    """Whether each of some sides (k,) has an obstacle, so is neither free nor clamped."""
    return ~np.isin(sides, [*case.free_sides, *case.clamped_sides])


def obstacle_at_nodes(case: Problem, mesh: Mesh) -> Array:
    """Values (nb,) of g at the boundary nodes, NaN where both edges are free, and on clamped sides."""
    nb = len(mesh.boundary)
    has_contact = has_obstacle(case, mesh.side)
    previous_side = np.roll(mesh.side, 1)
    g = np.full(len(has_contact), np.nan)
    # g is evaluated on the edge that begins at a node; if that is free, at the end of the one before
    before = np.flatnonzero(~has_contact & np.roll(has_contact, 1))
    side = np.where(has_contact, mesh.side, previous_side)
    s = mesh.s[:-1].copy()
    # node 0 is the end of the last edge at s = perimeter, the last entry of mesh.s
    s[before] = mesh.s[np.where(before == 0, nb, before)]
    clamped = Form(clamped=case.clamped_sides).clamped_nodes(mesh)[mesh.boundary]
    nodes = np.flatnonzero((has_contact | np.roll(has_contact, 1)) & ~clamped)
    u, _, gap = case.known_solution().trace_flux_and_gap(
        side[nodes], s[nodes] - mesh.polygon.starts[side[nodes]]
    )
    g[nodes] = u - gap
    return g
