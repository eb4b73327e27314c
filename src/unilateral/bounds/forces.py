"""The force over a part of the boundary, the integral of lambda, between two guaranteed numbers.

Let E bound ||lambda - lambda_H||_{-1/2}. lambda is not negative, so for every w in H^1

    int_P lambda <= <lambda, w> <= <lambda_H, w> + E ||w||_1,   if w >= 1 on P, w >= 0 on the rest,
    int_P lambda >= <lambda, w> >= <lambda_H, w> - E ||w||_1,   if w <= 1 on P, w <= 0 on the rest.

w is continuous and linear on triangles. It has to be steep only where contact on P meets the rest, or P meets
contact on the rest: elsewhere it falls from 1 to 0 along the boundary. Inside, where any values are allowed,
it makes ||w||_1 nearly least. On sides that are free lambda is 0, and w is free, too: a flux
that is given there is no part of lambda, in E neither.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Mask
from unilateral.bounds.edge_flux import SUMS
from unilateral.fem.p1 import coupling, h1_norm, stiffness_and_mass
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.solvers.descent import MOST_STEPS, Descent, rough_inverse

ENOUGH = 1e-3
"""Of ||w||_1^2: a step that takes off less is the last."""


class Force(NamedTuple):
    """The integral of lambda_H over a part of the boundary, and bounds of that of lambda."""

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

    lambda_H (m,) >= 0 is that on the cells, `bound` that of ||lambda - lambda_H||_{-1/2}; `free` sides have
    no constraint. An infinite bound leaves every force without an upper bound.
    """
    pressed = coupling(mesh, cells).T @ lambda_H
    held = ~np.isin(mesh.side, [*free])
    extended, grown = _extensions(mesh), (1 + SUMS) * mesh.growth
    found = []
    for part in parts:
        on = np.isin(mesh.side, [*part]) & held
        value = float(cells.lengths @ (lambda_H * np.isin(cells.side, [*part])))
        over, under = _traces(mesh, on, held & ~on, pressed > 0)
        upper = grown * (float(pressed @ over) + bound * extended(over)) if on.any() else 0.0
        lower = float(pressed @ under) / grown - grown * bound * extended(under) if under.any() else 0.0
        found.append(Force(value, max(lower, 0.0), upper))
    return found


def _traces(mesh: Mesh, on: Mask, off: Mask, pressed: Mask) -> tuple[Array, Array]:
    """(nb,), (nb,) w at the boundary nodes for the edges (nb,) `on` a part and `off` it, above and below.

    `pressed` are the nodes with contact. No number lies outside of 0 and 1.
    """
    on, off = on | np.roll(on, 1), off | np.roll(off, 1)  # the nodes of those edges
    above = _between(mesh, off & pressed & ~on, on)
    return above, _between(mesh, off, on & pressed & ~off)


def _between(mesh: Mesh, zeros: Mask, ones: Mask) -> Array:
    """(nb,) 1 at the `ones`, 0 at the `zeros`, and by the distances from both on the way."""
    if not ones.any():
        return np.zeros(len(ones))
    if not zeros.any():
        return np.ones(len(ones))
    of_zeros, of_ones = _distance(mesh.s, zeros), _distance(mesh.s, ones)
    return of_zeros / (of_zeros + of_ones)


def _distance(s: Array, nodes: Mask) -> Array:
    """(nb,) along the boundary, of the nodes at arc lengths s (nb + 1,), from the next of some of them."""
    at, round_ = s[:-1], s[-1]
    some = at[nodes]
    some = np.concatenate([some[-1:] - round_, some, some[:1] + round_])
    after = np.searchsorted(some, at)
    return np.minimum(some[after] - at, at - some[after - 1])


def _extensions(mesh: Mesh) -> Callable[[Array], float]:
    """||w||_1, rounding included, for a w with the values (nb,) at the boundary nodes, near the least."""
    K, M = stiffness_and_mass(mesh)
    A = sp.csr_array(K + M)
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    from_inside = A[inside]
    A_inside = sp.csr_array(from_inside[:, inside])
    inverse = rough_inverse(A_inside)

    def norm(trace: Array) -> float:
        w = np.zeros(mesh.n_nodes)
        w[mesh.boundary] = trace
        run = Descent(A_inside, -(from_inside @ w), w[inside], inverse)
        for _ in range(MOST_STEPS):
            if not run.step() > ENOUGH * max(float(w @ (A @ w)), 0.0):
                break
            w[inside] = run.x
        return (1 + SUMS) * h1_norm(mesh, w)

    return norm
