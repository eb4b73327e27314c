"""What the reference spaces see of functions on the boundary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.fem.quadrature import BoundaryRule, boundary_rule
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import oscillation_bound

if TYPE_CHECKING:
    from unilateral.norms.reference import ReferenceSpaces
    from unilateral.problems.case import ExactSolution


class Functionals(NamedTuple):
    """What the reference spaces see of k functions mu on the boundary.

    `loads` (n_p2, k) are <mu, psi_i>; `fluxes` (2 nb, k) are Pi_1 mu at the ends of the boundary edges;
    `oscillation` (k,) bounds ||mu - Pi_1 mu||_{-1/2}.
    """

    loads: sp.csc_array
    fluxes: sp.csc_array
    oscillation: Array


def cellwise_functionals(spaces: ReferenceSpaces, partition: Partition, mu_H: Array) -> Functionals:
    """The `Functionals` of functions mu_H (k, m) constant on the cells."""
    rule, cell = _reference_rule(spaces, partition, None)
    return _integrate_functionals(spaces, rule, mu_H.T[cell])


def difference_functionals(
    spaces: ReferenceSpaces, partition: Partition, case: ExactSolution, mu_H: Array
) -> Functionals:
    """The `Functionals` of lambda - mu_H; for a lambda outside L2 the bound on the oscillation is NaN.

    mu_H (k, m) is constant on the cells, or linear between its values (k, m, 2) at their ends.
    """
    rule, cell = _reference_rule(spaces, partition, case)
    flux = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)[1]
    functionals = _integrate_functionals(
        spaces, rule, flux[:, None] - evaluate_on_cells(partition, rule, cell, mu_H)
    )
    return functionals if case.flux_in_L2 else functionals._replace(oscillation=np.full(len(mu_H), math.nan))


def evaluate_on_cells(partition: Partition, rule: BoundaryRule, cell: Index, mu: Array) -> Array:
    """The values at the points of a rule of functions that are constant or linear on the cells, (Q, k)."""
    if mu.ndim == 2:
        return mu.T[cell]
    starts = partition.points[cell] - partition.polygon.starts[rule.side]
    x = ((rule.s - starts) / partition.lengths[cell])[:, None]
    return (1 - x) * mu[..., 0].T[cell] + x * mu[..., 1].T[cell]


def indicator_functionals(spaces: ReferenceSpaces, partition: Partition) -> Functionals:
    """The `Functionals` of the indicators of T_H's cells, each a union of edges of the reference mesh."""
    s = spaces.mesh.s
    m = partition.n_cells
    cell = np.searchsorted(partition.points, 0.5 * (s[1:] + s[:-1])) - 1
    # <1, psi> by Simpson's rule: |e|/6 at both ends of an edge, 4 |e|/6 at its midpoint
    shares = (np.diff(s)[:, None] * np.array([1.0, 1.0, 4.0]) / 6).ravel()
    where = (spaces.edge_unknowns.ravel(), np.repeat(cell, 3))
    loads = sp.coo_array((shares, where), shape=(spaces.n_p2, m)).tocsc()
    ends = (np.arange(2 * len(cell)), np.repeat(cell, 2))
    fluxes = sp.coo_array((np.ones(2 * len(cell)), ends), shape=(2 * len(cell), m)).tocsc()
    return Functionals(loads, fluxes, np.zeros(m))


def _reference_rule(
    spaces: ReferenceSpaces, partition: Partition, case: ExactSolution | None
) -> tuple[BoundaryRule, Index]:
    """Quadrature whose intervals are the reference mesh's edges, and the cell (Q,) of every point."""
    # split at the ends of cells, too, which need not be nodes
    cuts, edge, cell = overlay(spaces.mesh.s, partition.points)
    rule = boundary_rule(partition.polygon, cuts, case.singular_points() if case else ())
    return rule._replace(interval=edge[rule.interval]), cell[rule.interval]


def _integrate_functionals(spaces: ReferenceSpaces, rule: BoundaryRule, values: Array) -> Functionals:
    """The `Functionals` of functions mu with the values (Q, k) at the points of the rule."""
    mesh = spaces.mesh
    edge = rule.interval
    lengths = np.diff(mesh.s)
    x = ((rule.s - (mesh.s[edge] - mesh.polygon.starts[rule.side])) / lengths[edge])[:, None]
    weighted = rule.weight[:, None] * values
    # integrals over each edge of mu times the hats 1 - x and x, and times the bubble 4 x (1 - x)
    start = _sum_by_edge((1 - x) * weighted, edge, len(lengths))
    end = _sum_by_edge(x * weighted, edge, len(lengths))
    bubble = _sum_by_edge((4 * x * (1 - x)) * weighted, edge, len(lengths))
    # the shape functions of P2 on an edge are 1 - x and x, less half a bubble, and the bubble
    loads = np.zeros((spaces.n_p2, values.shape[1]))
    shapes = np.stack([start - bubble / 2, end - bubble / 2, bubble], axis=1)
    np.add.at(loads, spaces.edge_unknowns.ravel(), shapes.reshape(-1, values.shape[1]))
    # Pi_1 mu: the mass matrix |e| ((2, 1), (1, 2)) / 6 has the inverse ((4, -2), (-2, 4)) / |e|
    at_start = (4 * start - 2 * end) / lengths[:, None]
    at_end = (4 * end - 2 * start) / lengths[:, None]
    oscillation = values - (1 - x) * at_start[edge] - x * at_end[edge]
    squares = _sum_by_edge(rule.weight[:, None] * oscillation**2, edge, len(lengths))
    fluxes = np.stack([at_start, at_end], axis=1).reshape(-1, values.shape[1])
    return Functionals(sp.csc_array(loads), sp.csc_array(fluxes), oscillation_bound(mesh, squares))


def _sum_by_edge(values: Array, edge: Index, n_edges: int) -> Array:
    """The sums (nb, k) of values (Q, k) over the points on each edge."""
    return np.stack([np.bincount(edge, column, n_edges) for column in values.T], axis=1)
