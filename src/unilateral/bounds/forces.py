"""The force over a part of the boundary, the integral of lambda, between two guaranteed numbers.

Let E bound ||lambda - lambda_H||_{-1/2}. lambda is not negative, so for every w in H^1

    int_P lambda <= <lambda, w> <= <lambda_H, w> + E ||w||_1,   if w >= 1 on P, w >= 0 on the rest,
    int_P lambda >= <lambda, w> >= <lambda_H, w> - E ||w||_1,   if w <= 1 on P, w <= 0 on the rest.

With -w in the place of w the second one is like the first: in both <lambda_H, w> + E ||w||_1 is to be
small, and w not below a bound c. On sides that are free lambda is 0, and w is free, too: a flux that is
given there is no part of lambda, in E neither.

w is continuous, and linear on the triangles of a `small_mesh` of its own. There the best one is known:
||w||_1 is not below |v|_S, for v its values at the boundary nodes and S the Schur complement on these, and
it is |v|_S if w is extended as S has it; `least_norm` finds v. What is guaranteed does not rest on that. v is
not below c at the nodes, so w is not on the edges, whose ends may be one of P and one of the rest only at
vertices, which are nodes. And ||w||_1 is computed from all values of w. On the exact mesh, see
`geometry.exact_mesh`, it is at most `growth` times as large.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.edge_flux import SUMS
from unilateral.bounds.small_mesh import condensed, extended
from unilateral.fem.condense import Condensed
from unilateral.fem.p1 import coupling, h1_norm
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.solvers.least_norm import least

LEAST, TINY = 1e-100, 1e-300
"""When w is chosen, E counts as at least LEAST times the force of lambda_H, and as at least TINY."""


class Force(NamedTuple):
    """The integral of lambda_H over a part of the boundary, and bounds on the integral of lambda there."""

    value: float
    lower: float
    upper: float


def forces(
    mesh: Mesh,
    cells: Partition,
    lambda_H: Array,
    bound: float,
    parts: Sequence[Collection[int]],
    free: Collection[int] = (),
) -> list[Force]:
    """The force over each of the `parts`, which are numbers of sides.

    lambda_H (m,) >= 0 are the values on the cells, and `bound` is a bound on ||lambda - lambda_H||_{-1/2};
    `free` sides have no constraint. If the bound is infinite, no force has an upper bound. Of the `mesh` that
    lambda_H was computed on only the coarsest level is used, where that suffices (`small_mesh`).
    """
    held = np.setdiff1d(np.arange(mesh.polygon.n_sides), [*free])
    sides = [np.intersect1d(held, [*part]) for part in parts]
    values = [float(cells.lengths @ (lambda_H * np.isin(cells.side, [*part]))) for part in parts]
    some = [k for k, part in enumerate(sides) if part.size]
    lower, upper = np.zeros((2, len(parts)))
    if some and bound < np.inf:
        ends = _ends(mesh, cells, lambda_H, bound, held, [sides[k] for k in some])
        lower[some], upper[some] = np.maximum(ends[0], 0.0), ends[1]
    elif some:
        upper[some] = np.inf
    return [Force(*each) for each in zip(values, lower.tolist(), upper.tolist(), strict=True)]


def _ends(
    mesh: Mesh, cells: Partition, lambda_H: Array, bound: float, held: Index, parts: list[Index]
) -> tuple[Array, Array]:
    """(k,), (k,) numbers below and above the forces over k parts, each some of the sides `held`."""
    load = lambda_H / max(bound, LEAST * float(cells.lengths @ lambda_H), TINY)
    of, space = condensed(mesh, cells, load)
    pairing, load = (coupling(of, cells).T @ np.column_stack([lambda_H, load])).T
    best = Best(of, space, pairing, bound, load)
    above, below = (
        np.column_stack(c) for c in zip(*(_limits(of, held, each) for each in parts), strict=True)
    )
    begin = (above > 0) | (above == 0) & (load > 0)[:, None]
    return -best.of(below, np.isfinite(below)), best.of(above, begin)


def _limits(mesh: Mesh, held: Index, part: Index) -> tuple[Array, Array]:
    """(nb,), (nb,) c at the boundary nodes, for w in the upper bound and for -w in the lower one.

    It is -inf where w is free.
    """
    on, off = np.isin(mesh.side, part), np.isin(mesh.side, np.setdiff1d(held, part))
    at_on, at_off = on | np.roll(on, 1), off | np.roll(off, 1)
    c = np.where(at_on | at_off, 0.0, -np.inf)
    return c + at_on, c - ~at_off


@dataclass(frozen=True, eq=False)
class Best:
    """The least of <lambda_H, w> + E ||w||_1 on a mesh with its `space`, or among constants without one.

    `pairing` (nb,) are the integrals of lambda_H times the hats of the boundary nodes, `load` (nb,) is about
    `pairing` over E, and `bound` is E.
    """

    mesh: Mesh
    space: Condensed | None
    pairing: Array
    bound: float
    load: Array

    def of(self, c: Array, begin: Mask) -> Array:
        """(k,) the least values for w >= c, for each column of c (nb, k), whose largest number is -1, 0 or 1.

        `least` begins with the active sets `begin` (nb, k).
        """
        constants = self._most(np.outer(np.ones(self.mesh.n_nodes), [-1.0, 0.0, 1.0]))
        found = constants[1 + c.max(axis=0).astype(int)]
        if self.space:
            v = least(self.space.A_3, self.load, c, begin)
            other = np.flatnonzero(v.any(axis=0))
            if not other.size:
                return found
            found[other] = np.minimum(found[other], self._most(extended(self.space, v[:, other])))
        return found

    def _most(self, w: Array) -> Array:
        """(k,) what <lambda_H, w> + E ||w||_1 is at most on the exact mesh, for w (n, k) at the nodes.

        The pairing is off by the `stretch` of sides, and by the rounding of places on edges, which is that of
        the perimeter.
        """
        trace, polygon, l = w[self.mesh.boundary], self.mesh.polygon, self.pairing[:, None]  # noqa: E741
        on_edges = (l + np.roll(l, -1, axis=0)) * np.abs(np.roll(trace, -1, axis=0) - trace)
        of_places = EPS * polygon.perimeter * (1 / np.diff(self.mesh.s)) @ on_edges
        off = (SUMS + polygon.stretch.max()) * l.sum() * np.abs(trace).max(axis=0) + of_places
        norms = (1 + SUMS) * np.array([h1_norm(self.mesh, each) for each in w.T])
        return np.asarray(self.pairing @ trace + off + self.mesh.growth * self.bound * norms)
