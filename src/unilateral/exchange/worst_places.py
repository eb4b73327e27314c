"""Where a solution meets its conditions least: the least u - g, the least lambda, the largest product."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem
from unilateral.exchange.boundary_function import continuous
from unilateral.exchange.discrete_conditions import conditions
from unilateral.exchange.exported_folder import Foreign
from unilateral.problems.case import Case


class Extreme(NamedTuple):
    """A value, and its place on a side."""

    value: float
    place: tuple[float, float]
    side: int

    def __str__(self) -> str:
        return f"{self.value:.3g} at ({self.place[0]:g}, {self.place[1]:g}) on side {self.side}"


class Extremes(NamedTuple):
    """Extremes of values at the nodes, or of the means over the cells; without a multiplier `gap` alone."""

    at_nodes: bool
    gap: Extreme
    multiplier: Extreme | None
    product: Extreme | None

    def as_numbers(self) -> dict[str, Any]:
        """The extremes for programs; null where there is no multiplier."""
        values = {"gap_least": self.gap, "lambda_least": self.multiplier, "product_largest": self.product}
        where = "values at the nodes" if self.at_nodes else "means over the cells"
        return {"of": where} | {name: each and each._asdict() for name, each in values.items()}

    def __str__(self) -> str:
        """The extremes in a line. A lambda that is constant on the cells is its own mean."""
        where, gap = ("at the nodes", "(u - g)") if self.at_nodes else ("over the cells", "mean(u - g)")
        names = (f"min {gap}", "min lambda", f"max |lambda {gap}|")
        known = [f"{name} = {of}" for name, of in zip(names, self[1:], strict=True) if of is not None]
        return f"{where}: {', '.join(known)}"


def extremes(case: Case, given: Foreign, discrete: CondensedProblem) -> Extremes | None:
    """The extremes for the first conditions that the multiplier may belong to, else at the nodes.

    None if all sides are free. At a node lambda is its integral with the hat over that of the hat.
    """
    mesh, mu = discrete.mesh, given.multiplier
    each = next(conditions(case, discrete, mu or continuous(mesh, np.zeros(len(mesh.boundary)))))
    if not len(each.s):
        return None
    gap = each.means(given.u[mesh.boundary])
    side = mesh.polygon.sides_of(each.s)
    place = mesh.polygon.at(side, each.s - mesh.polygon.starts[side])

    def at(values: Array, k: int) -> Extreme:
        x, y = place[k].tolist()
        return Extreme(float(values[k]), (x, y), int(side[k]))

    least = at(gap, int(gap.argmin()))
    if mu is None:
        return Extremes(True, least, None, None)
    product, at_nodes = np.abs(each.mu * gap), mu.nodal is not None
    return Extremes(at_nodes, least, at(each.mu, int(each.mu.argmin())), at(product, int(product.argmax())))
