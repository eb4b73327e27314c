"""The discrete conditions that a multiplier may belong to, each with the solution that has them.

    on cells     means of u - g over the cells
    nodal        u - g at the nodes
    mortar       integrals of (u - g) phi_j

are >= 0, with multipliers >= 0 that are 0 where they are > 0. All are B v >= B g with rows that are scaled as
means, so that one solver does for all. `mistaken` ones are what authors take in their place.
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
from unilateral.exchange.boundary_function import Trace, constant, has_obstacle, obstacle
from unilateral.fem.condense import Condensed
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.fem.quadrature import boundary_rule
from unilateral.fem.spaces import dual_operator
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import cell_means
from unilateral.norms.ritz import hat_load
from unilateral.problems.problem import Problem
from unilateral.solvers.active_set import active_set

ROUNDING = 1e-9
"""Values below this fraction of the largest one count as 0."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions B v / weights >= g at the arc lengths `s` (k,), with B (k, nb), `weights` and `g` (k,).

    `what` says in words how u >= g is meant. `mu` (k,) are the multipliers that were handed in.
    """

    what: str
    B: sp.csr_array
    weights: Array
    g: Array
    s: Array
    mu: Array

    def multiplier_load(self, of: Condensed, trace: Array, tolerance: float) -> tuple[Array, float]:
        """The load (nb,) of the multiplier without which u has the `trace` (nb,).

        With it comes a bound on its error in the norm of u.
        """
        if not len(self.g):
            return np.zeros(len(trace)), 0.0
        found = active_set(dual_operator(of, self.B, self.weights), self.means(trace), tolerance)
        return self.B.T @ found.lambda_H, found.bound

    def means(self, trace: Array) -> Array:
        """(k,) what has to be >= 0, for the values (nb,) on the boundary."""
        return np.asarray(self.B @ trace / self.weights - self.g)

    def kept(self, rows: Mask) -> Conditions:
        """The conditions of those rows (k,)."""
        at = np.flatnonzero(rows)
        return Conditions(self.what, self.B[at], self.weights[at], self.g[at], self.s[at], self.mu[at])


class Equal(Conditions):
    """The conditions u = g in place of u >= g."""

    def multiplier_load(self, of: Condensed, trace: Array, tolerance: float) -> tuple[Array, float]:
        half = dual_operator(of, self.B, self.weights).half
        missing = -self.weights * self.means(trace)
        return np.asarray(of.cholesky.T @ np.linalg.lstsq(half.T, missing)[0]), 0.0


class Reversed(Conditions):
    """The conditions u <= g with multipliers <= 0."""

    def multiplier_load(self, of: Condensed, trace: Array, tolerance: float) -> tuple[Array, float]:
        turned = Conditions(self.what, self.B, self.weights, -self.g, self.s, -self.mu)
        found, bound = turned.multiplier_load(of, -trace, tolerance)
        return -found, bound


def conditions(case: Problem, discrete: CondensedProblem, mu: Trace) -> Iterator[Conditions]:
    """The conditions that mu may belong to; there are none on free and clamped sides.

    A mu that is constant on the cells of the exported partition, or on parts of these, may belong to that.
    """
    mesh = discrete.mesh
    if mu.nodal is None:
        if not np.array_equal(mu.cells.points, discrete.partition.points) and mu.is_constant_on(
            discrete.partition
        ):
            yield _on_cells(case, mesh, discrete.partition, mu)
        yield _on_cells(case, mesh, mu.cells, mu)
        return
    edges = has_obstacle(case, mesh.side)
    g = obstacle(case, mesh)
    held = np.isfinite(g)
    mass = boundary_mass(mesh, edges)
    weights = np.asarray(mass.sum(axis=1))
    s = mesh.s[:-1]
    lumped = np.divide(mu.load(mesh), weights, where=held, out=np.zeros(len(g)))
    nodal = sp.diags_array(weights).tocsr()
    yield Conditions("at the nodes", nodal, weights, g, s, lumped).kept(held)
    # integrals of g phi_j over the edges with an obstacle
    exact = case.known_solution()
    rule = boundary_rule(mesh.polygon, mesh.s, exact.singular())
    u, _, gap = exact.boundary(rule.side, rule.s, rule.near)
    load = hat_load(mesh, rule, (u - gap) * edges[rule.interval])
    moments = np.divide(load, weights, where=held, out=np.zeros(len(g)))
    yield Conditions("tested against each hat function", mass, weights, moments, s, mu.nodal).kept(held)


def _on_cells(case: Problem, mesh: Mesh, cells: Partition, mu: Trace) -> Conditions:
    middle = 0.5 * (cells.points[1:] + cells.points[:-1])
    values = mu.cells.means(mu.values, cells.points)
    means = cell_means(case.known_solution(), cells).g_means
    found = Conditions(
        "in the means over the cells", coupling(mesh, cells), cells.lengths, means, middle, values
    )
    return found.kept(has_obstacle(case, cells.side))


def mistaken(
    case: Problem, discrete: CondensedProblem, mu: Trace, right: Sequence[Conditions], trace: Array
) -> Iterator[tuple[str, Conditions]]:
    """Conditions that an author may have in place of the `right` ones, and what is wrong with them.

    `trace` (nb,) is u on the boundary: a side is ignored if mu is 0 there, and u below g.
    """
    for each in right:
        fields = vars(each)
        yield "the conditions hold as equations (u = g everywhere)", Equal(**fields)
        yield "the conditions are reversed (u <= g and lambda <= 0)", Reversed(**fields)
        yield "g has the wrong sign", replace(each, g=-each.g)
        yield "g is taken as 0", replace(each, g=np.zeros_like(each.g))
    yield from _counted(right[-1], mu)
    yield from _ignored(case, discrete, mu, right[0], trace)


def _counted(of_cells: Conditions, mu: Trace) -> Iterator[tuple[str, Conditions]]:
    """The conditions with means of g from another vertex on, where the cells are the same from there."""
    if mu.nodal is not None or len(of_cells.g) < mu.cells.n_cells:
        return
    given = constant(mu.cells, of_cells.g)
    for text, moved in moves(given):
        if np.allclose(moved.cells.points, mu.cells.points, rtol=0, atol=1e-9 * mu.cells.H):
            yield f"{text} where the means of g are taken", replace(of_cells, g=moved.values)


def moves(mu: Trace) -> Iterator[tuple[str, Trace]]:
    """What mu, constant on cells, would be if their arc length began at another vertex or ran clockwise.

    Each comes with a text that says so.
    """
    for clockwise in (True, False):
        for vertex, start in enumerate(mu.cells.polygon.starts[:-1].tolist()):
            if clockwise or vertex:
                way = "clockwise" if clockwise else "anticlockwise"
                with suppress(InputError):
                    yield (
                        f"the cells' arc length begins at vertex {vertex} and runs {way}",
                        mu.moved(start, clockwise),
                    )


def _ignored(
    case: Problem, discrete: CondensedProblem, mu: Trace, first: Conditions, trace: Array
) -> Iterator[tuple[str, Conditions]]:
    """The conditions without the sides, and the nodes at their ends, that look ignored."""
    below, pushed = _below_and_pushed(first, trace)
    sides = []
    for side, (start, end) in enumerate(pairwise(case.polygon.starts)):
        inside = (start < first.s) & (first.s < end)
        if below[inside].any() and not pushed[inside].any():
            sides.append(side)
    if not sides:
        return
    name = f"side {sides[0]} is" if len(sides) == 1 else f"sides {', '.join(map(str, sides))} are"
    ends = case.polygon.starts[np.add.outer(sides, [0, 1])] % case.polygon.perimeter
    for each in conditions(replace(case, free_sides=(*case.free_sides, *sides)), discrete, mu):
        below, pushed = _below_and_pushed(each, trace)
        yield f"{name} ignored", each.kept(~(np.isin(each.s, ends) & below & ~pushed))


def _below_and_pushed(each: Conditions, trace: Array) -> tuple[Mask, Mask]:
    """Where u is below g, and where mu is not 0, (k,) each."""
    below = each.means(trace) < -ROUNDING * np.abs(trace).max()
    return below, np.abs(each.mu) > ROUNDING * np.abs(each.mu).max(initial=0)
