"""What every problem gives to the method, whether or not its solution is known; formulas on sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Protocol

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.formulas.derivative import derivative
from unilateral.formulas.expression import Atom, Expression
from unilateral.formulas.taylor import Model, joined, number
from unilateral.formulas.taylor_enclosures import Steps, evaluate
from unilateral.geometry.curves import Kink
from unilateral.geometry.polygon import Polygon
from unilateral.problems.nodal import NodalTrace, NodalTraces
from unilateral.problems.obstacle_and_flux import Flux, Obstacle

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution


class Data(Protocol):
    """f and g of (1.1)-(1.2), on a polygon whose `free_sides` have du/dn = q in place of (1.2).

    On the `clamped_sides` u is given in place of (1.2).
    """

    @property
    def name(self) -> str: ...

    @property
    def title(self) -> str:
        """One line that says what problem it is; empty if nobody gave one."""

    @property
    def polygon(self) -> Polygon: ...

    @property
    def free_sides(self) -> tuple[int, ...]: ...

    @property
    def clamped_sides(self) -> tuple[int, ...]:
        """The sides on which u is given."""

    @property
    def exact(self) -> ExactSolution | None:
        """The exact solution of a case."""

    @property
    def reaction(self) -> float:
        """What u is multiplied by in (1.1): 1, or 0 if c = 0."""

    @property
    def f_at_nodes(self) -> Array | None:
        """(n,) f at the nodes of the mesh, if it is given by them; it is then linear on the triangles."""

    @property
    def jumps(self) -> dict[Atom, Kink]:
        """The steps pos(a, 0) in f, and the line or circle at which each changes between 0 and 1."""

    def source_model(self, x: Model, y: Model, steps: Steps) -> Model:
        """f on the boxes of x and y, on which the steps have the values `steps`, NaN for both 0 and 1."""

    def obstacle_model(self, side: Index, t: Model) -> Model:
        """g, or the given u, on intervals of the sides (k,), t the arc length in side lengths."""

    @property
    def enclosed_obstacle(self) -> Obstacle:
        """g on the sides with contact, and u on clamped ones, enclosed."""

    @property
    def enclosed_flux(self) -> Flux:
        """q on free sides, enclosed."""


def places(polygon: Polygon, side: Index, t: Model) -> tuple[Model, Model]:
    """x and y on intervals of the sides (k,), t the arc length in side lengths."""
    start, edge = polygon.vertices[side].T, polygon.edges[side].T
    x, y = (number(t, a) + number(t, along) * t for a, along in zip(start, edge, strict=True))
    return x, y


def on_sides(
    formulas: Sequence[Expression],
    side: Index,
    variables: Mapping[str, Model],
    traces: NodalTraces | None = None,
) -> Model:
    """One formula per side, on intervals of the sides (k,); equal ones are evaluated together.

    On some sides `traces` take their place, in the variable t.
    """
    same: dict[Expression | NodalTrace, list[int]] = {}
    for i in np.unique(side).tolist():
        same.setdefault((traces or {}).get(i, formulas[i]), []).append(i)
    parts = [(formula, np.flatnonzero(np.isin(side, sides))) for formula, sides in same.items()]
    return joined(
        [(_on(formula, {z: of.on(at) for z, of in variables.items()}), at) for formula, at in parts]
    )


def slopes_on_sides(
    formulas: Mapping[int, Expression], polygon: Polygon, side: Index, t: Model, traces: NodalTraces
) -> Model:
    """The derivatives of formulas in x, y by t, on intervals of the sides (k,); traces as in `on_sides`."""
    parts = []
    for i in np.unique(side).tolist():
        at = np.flatnonzero(side == i)
        here = t.on(at)
        if i in traces:
            parts.append((traces[i].slope_model(here), at))
            continue
        variables = dict(zip("xy", places(polygon, side[at], here), strict=True))
        along = zip("xy", polygon.edges[i], strict=True)
        of = (evaluate(derivative(formulas[i], z), variables).scaled(e) for z, e in along)
        parts.append((reduce(add, of), at))
    return joined(parts)


def _on(of: Expression | NodalTrace, variables: Mapping[str, Model]) -> Model:
    return of.model(variables["t"]) if isinstance(of, NodalTrace) else evaluate(of, variables)
