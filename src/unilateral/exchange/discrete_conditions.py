"""The discrete conditions that a multiplier may belong to, each with the solution that has them.

    on cells     means of u - g over the cells
    nodal        u - g at the nodes
    mortar       integrals of (u - g) phi_j

are >= 0, with multipliers >= 0 that are 0 where they are > 0. All are B v >= B g with rows that are scaled as
means, so that one solver does for all. `list_mistaken_conditions` ones are what authors take in their place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Mask
from unilateral.discrete.condensed import CondensedProblem
from unilateral.errors import InputError
from unilateral.exchange.boundary_function import (
    BoundaryFunction,
    has_obstacle,
    obstacle_at_nodes,
    piecewise_constant,
)
from unilateral.fem.condense import CondensedMatrix
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import dual_operator
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.ritz import hat_load
from unilateral.problems.problem import Problem
from unilateral.solvers.active_set import solve_by_active_set

ZERO_VALUE_RATIO = 1e-9
"""Values below this fraction of the largest one count as 0."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions B v / weights >= g at the arc lengths `s` (k,), with B (k, nb), `weights` and `g` (k,).

    `description` says in words how u >= g is meant. `mu` (k,) are the multipliers that were handed in.
    """

    description: str
    B: sp.csr_array
    weights: Array
    g: Array
    s: Array
    mu: Array

    def multiplier_load(
        self, condensed: CondensedMatrix, unconstrained_trace: Array, tolerance: float
    ) -> tuple[Array, float]:
        """Load (nb,) of the multiplier that the conditions need, and a bound on its error in the norm of u.

        Without a multiplier u has the boundary values `unconstrained_trace` (nb,).
        """
        if not len(self.g):
            return np.zeros(len(unconstrained_trace)), 0.0
        result = solve_by_active_set(
            dual_operator(condensed, self.B, self.weights), self.gaps(unconstrained_trace), tolerance
        )
        return self.B.T @ result.lambda_H, result.bound

    def gaps(self, trace: Array) -> Array:
        """Weighted means (k,) of u - g, which have to be >= 0, for boundary values (nb,) of u."""
        return np.asarray(self.B @ trace / self.weights - self.g)

    def select_rows(self, rows: Mask) -> Conditions:
        """The conditions of those rows (k,)."""
        indices = np.flatnonzero(rows)
        return Conditions(
            self.description,
            self.B[indices],
            self.weights[indices],
            self.g[indices],
            self.s[indices],
            self.mu[indices],
        )


class EqualityConditions(Conditions):
    """The conditions u = g in place of u >= g."""

    def multiplier_load(
        self, condensed: CondensedMatrix, unconstrained_trace: Array, tolerance: float
    ) -> tuple[Array, float]:
        """Load of the multiplier that u needs for u = g, and 0 as the bound on its error."""
        # B A_3^{-1} B^T mu = weights (g - means of A^{-1} f); with A_3 = R^T R and half = R^{-T} B^T this is
        # half^T x = weights (g - ..) for x = half mu. The load is B^T mu = R^T x, also if mu is not unique
        half = dual_operator(condensed, self.B, self.weights).D_factor
        missing = -self.weights * self.gaps(unconstrained_trace)
        return np.asarray(condensed.cholesky.T @ np.linalg.lstsq(half.T, missing)[0]), 0.0


class ReversedConditions(Conditions):
    """The conditions u <= g with multipliers <= 0."""

    def multiplier_load(
        self, condensed: CondensedMatrix, unconstrained_trace: Array, tolerance: float
    ) -> tuple[Array, float]:
        """Load of the multiplier <= 0 that u needs for u <= g, and a bound on its error."""
        # -u >= -g with the multiplier -lambda >= 0
        mirrored = Conditions(self.description, self.B, self.weights, -self.g, self.s, -self.mu)
        load, bound = mirrored.multiplier_load(condensed, -unconstrained_trace, tolerance)
        return -load, bound


def list_conditions(case: Problem, discrete: CondensedProblem, mu: BoundaryFunction) -> Iterator[Conditions]:
    """The conditions that mu may belong to; there are none on free and clamped sides.

    A mu that is constant on the cells of the exported partition, or on parts of these, may belong to that.
    """
    mesh = discrete.mesh
    if mu.nodal_values is None:
        if not np.array_equal(mu.partition.points, discrete.partition.points) and mu.is_constant_on(
            discrete.partition
        ):
            yield _make_cell_conditions(case, mesh, discrete.partition, mu)
        yield _make_cell_conditions(case, mesh, mu.partition, mu)
        return
    # nodal: u >= g at the nodes, with the multiplier <mu, phi_j> / <1, phi_j>
    g = obstacle_at_nodes(case, mesh)
    constrained = np.isfinite(g)
    mass = boundary_mass(mesh, has_obstacle(case, mesh.side))
    weights = np.asarray(mass.sum(axis=1))
    lumped = np.divide(mu.load(mesh), weights, where=constrained, out=np.zeros(len(g)))
    nodal = Conditions("at the nodes", sp.diags_array(weights).tocsr(), weights, g, mesh.s[:-1], lumped)
    yield nodal.select_rows(constrained)
    # mortar: the integrals of (u - g) phi_j over the edges with an obstacle, scaled as means of u - g
    moments = np.divide(_obstacle_load(case, mesh), weights, where=constrained, out=np.zeros(len(g)))
    hats = "tested against each hat function"
    mortar = Conditions(hats, mass, weights, moments, mesh.s[:-1], mu.nodal_values)
    yield mortar.select_rows(constrained)


def _obstacle_load(case: Problem, mesh: Mesh) -> Array:
    """<g, phi_j> (nb,) over the edges with an obstacle; g is the exact u less the exact gap."""
    exact = case.known_solution()
    rule = boundary_rule(mesh.polygon, mesh.s, exact.singular_points())
    u, _, gap = exact.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    return hat_load(mesh, rule, (u - gap) * has_obstacle(case, mesh.side)[rule.interval])


def _make_cell_conditions(
    case: Problem, mesh: Mesh, partition: Partition, mu: BoundaryFunction
) -> Conditions:
    """The conditions on the means over the cells of a partition."""
    middle = 0.5 * (partition.points[1:] + partition.points[:-1])
    values = mu.partition.means(mu.values, partition.points)
    means = cell_means(case.known_solution(), partition).g_means
    conditions = Conditions(
        "in the means over the cells", coupling(mesh, partition), partition.lengths, means, middle, values
    )
    return conditions.select_rows(has_obstacle(case, partition.side))


def list_mistaken_conditions(
    case: Problem,
    discrete: CondensedProblem,
    mu: BoundaryFunction,
    correct: Sequence[Conditions],
    trace: Array,
) -> Iterator[tuple[str, Conditions]]:
    """Conditions that an author may have in place of the `correct` ones, and what is wrong with them.

    `trace` (nb,) is u on the boundary: a side is ignored if mu is 0 there, and u below g.
    """
    for conditions in correct:
        fields = vars(conditions)
        yield "the conditions hold as equations (u = g everywhere)", EqualityConditions(**fields)
        yield "the conditions are reversed (u <= g and lambda <= 0)", ReversedConditions(**fields)
        yield "g has the wrong sign", replace(conditions, g=-conditions.g)
        yield "g is taken as 0", replace(conditions, g=np.zeros_like(conditions.g))
    yield from _shift_obstacle_means(correct[-1], mu)
    yield from _drop_ignored_sides(case, discrete, mu, correct[0], trace)


def _shift_obstacle_means(
    cell_conditions: Conditions, mu: BoundaryFunction
) -> Iterator[tuple[str, Conditions]]:
    """The conditions with means of g from another vertex on, where the cells are the same from there."""
    if mu.nodal_values is not None or len(cell_conditions.g) < mu.partition.n_cells:
        return
    obstacle_means = piecewise_constant(mu.partition, cell_conditions.g)
    for text, shifted in list_arc_length_shifts(obstacle_means):
        if np.allclose(shifted.partition.points, mu.partition.points, rtol=0, atol=1e-9 * mu.partition.H):
            yield f"{text} where the means of g are taken", replace(cell_conditions, g=shifted.values)


def list_arc_length_shifts(mu: BoundaryFunction) -> Iterator[tuple[str, BoundaryFunction]]:
    """Functions that mu is if its arc length begins at another vertex or runs clockwise; with words on it."""
    for clockwise in (True, False):
        for vertex, start in enumerate(mu.partition.polygon.starts[:-1].tolist()):
            if clockwise or vertex:
                direction = "clockwise" if clockwise else "anticlockwise"
                text = f"the cells' arc length begins at vertex {vertex} and runs {direction}"
                with suppress(InputError):  # a vertex would lie inside a cell
                    yield text, mu.shift_arc_length(start, clockwise)


def _drop_ignored_sides(
    case: Problem, discrete: CondensedProblem, mu: BoundaryFunction, base_conditions: Conditions, trace: Array
) -> Iterator[tuple[str, Conditions]]:
    """The conditions without the sides, and the nodes at their ends, that look ignored."""
    # sides look ignored on which u is below g somewhere, and mu is 0
    below, active = _find_violated_and_active(base_conditions, trace)
    sides = []
    for side, (start, end) in enumerate(pairwise(case.polygon.starts)):
        inside = (start < base_conditions.s) & (base_conditions.s < end)
        if below[inside].any() and not active[inside].any():
            sides.append(side)
    if not sides:
        return
    name = f"side {sides[0]} is" if len(sides) == 1 else f"sides {', '.join(map(str, sides))} are"
    ends = case.polygon.starts[np.add.outer(sides, [0, 1])] % case.polygon.perimeter
    for conditions in list_conditions(replace(case, free_sides=(*case.free_sides, *sides)), discrete, mu):
        below, active = _find_violated_and_active(conditions, trace)
        yield f"{name} ignored", conditions.select_rows(~(np.isin(conditions.s, ends) & below & ~active))


def _find_violated_and_active(conditions: Conditions, trace: Array) -> tuple[Mask, Mask]:
    """Masks (k,) of the conditions in which u is below g, and of those in which mu is not 0."""
    below = conditions.gaps(trace) < -ZERO_VALUE_RATIO * np.abs(trace).max()
    return below, np.abs(conditions.mu) > ZERO_VALUE_RATIO * np.abs(conditions.mu).max(initial=0)
