"""The force over a part of the boundary, the integral of lambda, between two guaranteed numbers.

Let E bound |||lambda - lambda_H|||_*, and N be a norm on H^1 that is at least the energy norm,

    N(w)^2 = k (|w|_1^2 + d^-2 ||w||_0^2),     d the `depth` of `ReactionData`.

lambda is not negative, so for every w in H^1 that vanishes on clamped sides

    int_P lambda <= <lambda, w> <= <lambda_H, w> + E N(w),   if w >= 1 on P, w >= 0 on the rest,
    int_P lambda >= <lambda, w> >= <lambda_H, w> - E N(w),   if w <= 1 on P, w <= 0 on the rest.

With -w in the place of w the second one is like the first: in both <lambda_H, w> + E N(w) is to be
small, and w not below a bound c. On sides that are free lambda is 0, and w is free, too: a flux that is
given there is no part of lambda, in E neither.

The same holds for reactions, the integrals of k du/dn over clamped sides, whose sign is not known: there
w is 1 on P and 0 on the rest, <lambda_H, w> has also that of q.n over P, and E is the `reaction_bound`.
Clamped sides in a row go together, for w cannot jump. Where P ends at a vertex between a clamped side and
one with contact, w passes from 1 to 0 beside it, and one of the bounds lacks what `clamped_ends` bounds. It
is infinite where nothing is known of v - g, and has to be where u = g at the vertex: there a large force and
the opposite reaction have hardly any norm together.

If c = 0, the sum of all forces and reactions is - int f - int q, by (1.1) with v = 1 (`enclose_total_force`).

w is continuous, and linear on the triangles of a mesh of its own, which is graded towards the ends of sides
and of contact where there is a load, as w is steep there. On the mesh the best w is known: k^(-1/2) N(w) is
not below |v|_S, for v its values at the boundary nodes and S the Schur complement on these, and it is |v|_S
if w is extended as S has it (`force_mesh`). What is guaranteed does not rest on that: N(w) is computed from
all values of w, and as v is not below c at the nodes, w is not on the edges, which lie in P or in the rest.
On the exact mesh (`geometry.exact_mesh`) N(w) is at most `exact_mesh_factor` times as large.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.clamped_ends import (
    ReactionData,
    conflict_allowances,
    find_conflicts,
    gap_nodes,
    no_reactions,
)
from unilateral.bounds.force_mesh import condense_force_mesh, extend_with_least_norm
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.source import Source
from unilateral.fem.condense import CondensedMatrix
from unilateral.fem.form import Form
from unilateral.fem.p1 import coupling, energy_norm
from unilateral.formulas.decimals import add_guarantee, format_interval
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.obstacle_and_flux import GivenFlux
from unilateral.solvers.least_norm import minimise_linear_plus_norm

MIN_BOUND_PER_FORCE = 1e-100
MIN_FORCE_BOUND = 1e-300
"""When w is chosen, k^(1/2) E counts as at least the first times the force of lambda_H, and as the second."""


class Force(NamedTuple):
    """The integral of lambda_H over a part of the boundary, and bounds on the integral of lambda there."""

    value: float
    lower: float
    upper: float

    def __repr__(self) -> str:
        """An interval about the value that contains the bounds.

        >>> Force(6.1144, 6.0135, 6.2266)
        Force: 6.11 ± 0.12, guaranteed
        """
        interval = format_interval(self.lower, self.upper, self.value)
        return f"Force: {add_guarantee(interval, self.lower, self.upper)}"


def bound_forces(
    mesh: Mesh,
    partition: Partition,
    lambda_H: Array,
    multiplier_bound: float,
    side_sets: Sequence[Collection[int]],
    reactions: ReactionData | None = None,
) -> list[Force]:
    """The force over each of the `side_sets`, which are numbers of sides, with the reactions on clamped ones.

    lambda_H (m,) >= 0 are the values on the cells, and `multiplier_bound` is a bound on |||lambda -
    lambda_H|||_*. By default all sides have contact, and k = c = 1. If the bound is infinite, no force has an
    upper bound, but the sum of all forces and reactions may have its `enclose_total_force`. Of the `mesh`
    that lambda_H was computed on only the coarsest level is used, where that suffices.
    """
    reactions = reactions or no_reactions(mesh.polygon.n_sides)
    sides = [np.setdiff1d([*side_set], reactions.form.free).astype(int) for side_set in side_sets]
    values = [
        float(partition.lengths @ (lambda_H * np.isin(partition.side, P)) + reactions.outflows[0, P].sum())
        for P in sides
    ]
    lower, upper = np.zeros((2, len(side_sets)))
    # what has reactions has the error of fluxes and any sign, a force alone that of lambda, and it is >= 0
    signed = np.array([bool({*side_set} & {*reactions.form.clamped}) for side_set in sides], dtype=bool)
    for chosen, error_bound in (
        (np.flatnonzero(signed), reactions.reaction_bound),
        (np.flatnonzero(~signed), multiplier_bound),
    ):
        # on free sides alone lambda is 0
        chosen = chosen[[sides[k].size > 0 for k in chosen]]
        if chosen.size:
            chosen_sides = [sides[k] for k in chosen]
            lower[chosen], upper[chosen] = _force_bounds(
                mesh, partition, lambda_H, error_bound, chosen_sides, reactions
            )
    lower[~signed] = np.maximum(lower[~signed], 0.0)
    forces = list(map(Force, values, lower.tolist(), upper.tolist()))
    # the sum of all forces and reactions is - int f - int q, by (1.1) with v = 1
    if reactions.total_force and reactions.total_force[1] < math.inf:
        n_not_free = mesh.polygon.n_sides - len(reactions.form.free)
        for k in np.flatnonzero([len(side_set) == n_not_free for side_set in sides]).tolist():
            forces[k] = _narrow_force(forces[k], *reactions.total_force)
    return forces


def _narrow_force(force: Force, lower: float, upper: float) -> Force:
    """The force between further bounds on it, in the middle of its interval."""
    lower = max(force.lower, lower)
    upper = min(force.upper, upper)
    return Force(0.5 * (lower + upper), lower, upper)


def enclose_total_force(source: Source, flux: GivenFlux) -> tuple[float, float]:
    """Two numbers between which - int f - int q lies, for f on a mesh and q on the sides of its polygon.

    Areas change by the square of 1 + the distortion, and lengths by the stretch.
    """
    mesh = source.mesh
    polygon = source.mesh.polygon
    integral = float(mesh.areas @ source.f_h.mean(axis=1))
    changed = SQUARES_ROUNDING + 3 * mesh.distortion
    # int f: the means of f_h, off by |T|^{1/2} E_T and by what the exact mesh changes of areas
    remainder = float(
        ((1 + changed) * np.sqrt(mesh.areas)) @ source.remainder
        + (changed * mesh.areas) @ np.abs(source.f_h).mean(axis=1)
    )
    # int sigma^k over [-1, 1] is 2 / (k + 1) for even k, and 0 for odd ones
    k = np.arange(len(flux.c))
    lengths = np.diff(flux.points)
    sizes = np.abs(flux.c).sum(axis=0)
    integral += float(lengths @ (np.where(k % 2, 0.0, 1 / (k + 1)) @ flux.c))
    # beside a jump, and where places are rounded, as much of q as reaches there is not known
    remainder += float(lengths @ flux.remainder + 2 * flux.reach * (flux.jumps.sum() + sizes.sum()))
    remainder += (SQUARES_ROUNDING + float(polygon.stretch.max())) * float(lengths @ sizes)
    return -integral - remainder, -integral + remainder


def _force_bounds(
    mesh: Mesh,
    partition: Partition,
    lambda_H: Array,
    error_bound: float,
    side_sets: list[Index],
    reactions: ReactionData,
) -> tuple[Array, Array]:
    """Lower and upper bounds on the forces over sets of sides that are not free, (k,) each."""
    if not error_bound < math.inf:
        return np.full(len(side_sets), -math.inf), np.full(len(side_sets), math.inf)
    best = _build_least_bound(mesh, partition, lambda_H, error_bound, reactions)
    limits = [_nodal_lower_bounds(best.mesh, sides, reactions) for sides in side_sets]
    above = np.column_stack([c for c, _ in limits])
    below = np.column_stack([c for _, c in limits])
    # <lambda_H, w> has the integrals of q.n over clamped sides; what w cannot reach at conflicts is lacking
    flows, magnitudes = np.array([reactions.outflows[:, sides].sum(axis=1) for sides in side_sets]).T
    flow_rounding = (SQUARES_ROUNDING + mesh.polygon.stretch.max()) * magnitudes
    conflicts = np.array([conflict_allowances(best.mesh, sides, reactions) for sides in side_sets]).T
    lacking = conflicts + flow_rounding
    # the search for w begins where w >= c is an equation: on P, and where lambda_H pushes
    active = (above > 0) | (above == 0) & (best.load > 0)[:, None]
    # for the lower bound -w takes the place of w: there <lambda_H, -w> + E N(w) is least
    lower = flows - best.minimise(below, np.isfinite(below)) - lacking[0]
    return lower, flows + best.minimise(above, active) + lacking[1]


def _build_least_bound(
    mesh: Mesh, partition: Partition, lambda_H: Array, error_bound: float, reactions: ReactionData
) -> LeastBound:
    """The `LeastBound` for this error bound, on a mesh that is made for lambda_H and it."""
    # with k^{-1/2} N in place of N, E gets the factor k^{1/2}
    E = math.sqrt(reactions.form.k) * error_bound
    # E is 0 for exact data, or tiny: the mesh needs a finite load
    cell_load = lambda_H / max(E, MIN_BOUND_PER_FORCE * float(partition.lengths @ lambda_H), MIN_FORCE_BOUND)
    force_mesh, condensed = condense_force_mesh(mesh, partition, cell_load, reactions)
    pairing, load = (coupling(force_mesh, partition).T @ np.column_stack([lambda_H, cell_load])).T
    is_fixed = reactions.form.clamped_nodes(force_mesh)[force_mesh.boundary]
    return LeastBound(force_mesh, condensed, pairing, E, load, is_fixed, Form(c=reactions.depth**-2))


def _nodal_lower_bounds(mesh: Mesh, sides: Index, reactions: ReactionData) -> tuple[Array, Array]:
    """The c (nb,) at nodes in w >= c of the upper bound, and in -w >= c of the lower one.

    It is -inf where w is free. At nodes on clamped sides it is what w, or -w, is.
    """
    on_P = np.isin(mesh.side, sides)
    on_rest = ~np.isin(mesh.side, [*reactions.form.free, *sides])
    at_P = on_P | np.roll(on_P, 1)
    at_rest = on_rest | np.roll(on_rest, 1)
    # upper: w >= 1 on P, w >= 0 on the rest; lower: -w >= -1 on P, -w >= 0 on the rest
    c = np.where(at_P | at_rest, 0.0, -np.inf)
    above = c + at_P
    below = c - ~at_rest
    for vertex, which in find_conflicts(sides, reactions):
        # near a conflict w may pass from one value to the other
        (below, above)[which][gap_nodes(mesh, vertex, reactions)] -= 1.0
    clamped = np.isin(mesh.side, reactions.form.clamped)
    clamped_P = clamped & on_P
    value = (clamped_P | np.roll(clamped_P, 1)).astype(float)
    exact = clamped | np.roll(clamped, 1)
    return np.where(exact, value, above), np.where(exact, -value, below)


@dataclass(frozen=True, eq=False)
class LeastBound:
    """The least of <lambda_H, w> + E |||w||| on a mesh with its `condensed`, or among constants without one.

    `pairing` (nb,) are the integrals of lambda_H times the hats of the boundary nodes, and `load` (nb,) is
    about `pairing` over E, which is k^(1/2) times the error bound. At the nodes `is_fixed` (nb,) w is given.
    |||w||| is that of the `norm_form`.
    """

    mesh: Mesh
    condensed: CondensedMatrix | None
    pairing: Array
    E: float
    load: Array
    is_fixed: Mask
    norm_form: Form

    def minimise(self, c: Array, active: Mask) -> Array:
        """The least values of <lambda_H, w> + E |||w||| for w >= c, for each column of c, (k,).

        `minimise_linear_plus_norm` begins with the active sets `active` (nb, k).
        """
        # among constants w is the least that is allowed, -1, 0 or 1
        best = np.full(c.shape[1], np.inf)
        if not self.is_fixed.any():
            constants = self._bound_on_exact_mesh(np.outer(np.ones(self.mesh.n_nodes), [-1.0, 0.0, 1.0]))
            best = constants[1 + c.max(axis=0).astype(int)]
        if self.condensed:
            v = minimise_linear_plus_norm(self.condensed.A_3, self.load, c, active, self.is_fixed)
            # w = 0 is among the constants
            columns = np.flatnonzero(v.any(axis=0) | self.is_fixed.any())
            if columns.size:
                w = extend_with_least_norm(self.condensed, v[:, columns])
                best[columns] = np.minimum(best[columns], self._bound_on_exact_mesh(w))
        return best

    def _bound_on_exact_mesh(self, w: Array) -> Array:
        """Upper bounds on <lambda_H, w> + E |||w||| on the exact mesh, (k,).

        The pairing is off by the `stretch` of sides and by rounding, each term by its own part, and by the
        rounding of places on edges, which is that of the perimeter.
        """
        trace = w[self.mesh.boundary]
        polygon = self.mesh.polygon
        nodal = self.pairing[:, None]
        edge_changes = (nodal + np.roll(nodal, -1, axis=0)) * np.abs(np.roll(trace, -1, axis=0) - trace)
        place_rounding = EPS * polygon.perimeter * (1 / np.diff(self.mesh.s)) @ edge_changes
        error = (SQUARES_ROUNDING + polygon.stretch.max()) * (self.pairing @ np.abs(trace)) + place_rounding
        norms = (1 + SQUARES_ROUNDING) * np.array(
            [energy_norm(self.mesh, column, self.norm_form) for column in w.T]
        )
        return np.asarray(self.pairing @ trace + error + self.mesh.exact_mesh_factor * self.E * norms)
