"""How a multiplier may have been meant: the boundary load that u's equation has, in another shape."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array
from unilateral.exchange.boundary_function import Trace, constant, of_reactions
from unilateral.exchange.discrete_conditions import ROUNDING, conditions, moves
from unilateral.exchange.equation_residual import Residual
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.geometry.mesh import Mesh
from unilateral.problems.case import Case


@dataclass(frozen=True, eq=False)
class MeantMultiplier:
    """A way in which a multiplier may have been meant; `fault` says which.

    `load` (nb,) is the boundary load that it is then. `mu` is None where the fault says all, and its
    conditions need not be looked at.
    """

    fault: str
    load: Array
    mu: Trace | None


def plain(mu: Trace, mesh: Mesh) -> MeantMultiplier:
    """The multiplier as it was handed in."""
    return MeantMultiplier("", mu.load(mesh), mu)


def readings(mu: Trace, mesh: Mesh, right: Array) -> Iterator[MeantMultiplier]:
    """Other ways to read the multiplier, where u's equation has the `right` load (nb,)."""
    if mu.nodal is None:
        yield from _of_cells(mu, mesh, right)
        return
    mass = boundary_mass(mesh)
    for fault, load in (
        (
            "the multiplier is lumped: its values are reactions over the row sums of the mass matrix",
            mass.sum(axis=1) * mu.nodal,
        ),
        ("the multiplier's values are reactions; hand these in as `reaction`", mu.nodal),
        ("the reactions are values of a multiplier; hand these in as `multiplier`", mass @ (mass @ mu.nodal)),
    ):
        yield MeantMultiplier(fault, np.asarray(load), of_reactions(mesh, np.asarray(load)))


def _of_cells(mu: Trace, mesh: Mesh, right: Array) -> Iterator[MeantMultiplier]:
    divided = constant(mu.cells, mu.values / mu.cells.lengths)
    fault = "the multiplier's values are integrals over the cells; hand in means"
    yield MeantMultiplier(fault, divided.load(mesh), divided)
    for text, moved in moves(mu):
        fault = f"{text}; it has to begin at vertex 0 and run anticlockwise"
        yield MeantMultiplier(fault, moved.load(mesh), moved)
    spread = coupling(mesh, mu.cells) @ (right / boundary_mass(mesh).sum(axis=1))
    as_reactions = of_reactions(mesh, right)
    means = coupling(mesh, mu.cells) @ as_reactions.nodal
    for how, values in (("their shares in the cells", spread), ("the means of their function", means)):
        fault = f"the multiplier is nodal reactions, made {how}; hand in `reaction`"
        other = mu.load(mesh) - constant(mu.cells, values / mu.cells.lengths).load(mesh)
        yield MeantMultiplier(fault, right + other, as_reactions)


def ahead(case: Case, mu: Trace, of: Residual, right: Array) -> Iterator[MeantMultiplier]:
    """The multiplier after one more step of Uzawa's iteration than u has.

    That is max(0, mu_u - rho times the means of u - g), where mu_u has the `right` load (nb,). The rho > 0 is
    taken that comes nearest.
    """
    for each in conditions(case, of.discrete, mu):
        gap = each.means(of.u[of.discrete.mesh.boundary])
        mu_u, on = np.linalg.lstsq(each.B.T.toarray(), right)[0], each.mu > ROUNDING * np.abs(each.mu).max()
        if not gap[on].any():
            continue
        rho = -float(gap[on] @ (each.mu - mu_u)[on] / (gap[on] @ gap[on]))
        if rho > 0:
            step = each.B.T @ np.maximum(0, mu_u - rho * gap)
            what = "the iteration stopped too early: the multiplier is one step of Uzawa's ahead of u"
            yield MeantMultiplier(what, right + mu.load(of.discrete.mesh) - step, None)
