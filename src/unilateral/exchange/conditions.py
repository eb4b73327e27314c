"""The discrete conditions that a multiplier may belong to, each with the solution that has them.

    on cells     means of u - g over the cells
    nodal        u - g at the nodes
    mortar       integrals of (u - g) phi_j

are >= 0, with multipliers >= 0 that are 0 where they are > 0. All are B v >= B g with rows that are scaled as
means, so that one solver does for all.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Mask
from unilateral.discrete import Discrete
from unilateral.exchange.held import held_cells, held_edges, obstacle
from unilateral.exchange.trace import Trace
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import dual_operator
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact import cell_means
from unilateral.norms.ritz import hat_load
from unilateral.problems.case import Case
from unilateral.solvers.active_set import active_set


class Conditions(NamedTuple):
    """`what` is >= 0, B (k, nb) v over `weights` (k,) not below `g` (k,)."""

    what: str
    B: sp.csr_array
    weights: Array
    g: Array

    def multiplier_load(self, discrete: Discrete, load: Array, tolerance: float) -> tuple[Array, float]:
        """(nb,) of the multiplier that belongs to a load (n,), and a bound of its error in H1."""
        condensed = discrete.spaces.condensed
        trace = condensed.solve(load)[discrete.mesh.boundary]
        operator = dual_operator(condensed, self.B, self.weights)
        found = active_set(operator, self.B @ trace / self.weights - self.g, tolerance)
        return self.B.T @ found.lambda_H, found.bound


def conditions(case: Case, discrete: Discrete, mu: Trace) -> Iterator[Conditions]:
    """Those that mu may belong to; none on free sides.

    A mu that is constant on the cells of the exported partition, or on parts of these, may belong to it.
    """
    mesh = discrete.mesh
    if mu.nodal is None:
        if not np.array_equal(mu.cells.points, discrete.partition.points) and mu.is_constant_on(
            discrete.partition
        ):
            yield _on_cells(case, mesh, discrete.partition)
        yield _on_cells(case, mesh, mu.cells)
        return
    edges, g = held_edges(case, mesh), obstacle(case, mesh)
    held = np.flatnonzero(np.isfinite(g))
    mass = boundary_mass(mesh, edges)[held]
    weights = np.asarray(mass.sum(axis=1))
    nodal = sp.diags_array(np.asarray(boundary_mass(mesh, edges).sum(axis=1))).tocsr()[held]
    yield Conditions("at the nodes", nodal, weights, g[held])
    yield Conditions("in the means by the hats", mass, weights, _moments(case, mesh, edges)[held] / weights)


def _on_cells(case: Case, mesh: Mesh, cells: Partition) -> Conditions:
    held = held_cells(case, cells)
    means = cell_means(case, cells).g_means[held]
    return Conditions("in the means over the cells", coupling(mesh, cells)[held], cells.lengths[held], means)


def _moments(case: Case, mesh: Mesh, edges: Mask) -> Array:
    """(nb,) integrals of g phi_j over those edges (nb,)."""
    rule = boundary_rule(mesh.polygon, mesh.s, case.singular())
    u, _, gap = case.boundary(rule.side, rule.s, rule.near)
    return hat_load(mesh, rule, (u - gap) * edges[rule.interval])
