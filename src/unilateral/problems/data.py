"""What every problem gives to the method, whether or not its solution is known."""

from __future__ import annotations

from typing import Protocol

import sympy

from unilateral.arrays import Index
from unilateral.formulas.elementary import Steps
from unilateral.formulas.taylor import Model
from unilateral.geometry.curves import Kink
from unilateral.geometry.polygon import Polygon
from unilateral.problems.obstacle import Obstacle


class Data(Protocol):
    """f and g of (1.1)-(1.2), on a polygon whose `free_sides` have du/dn = 0 in place of (1.2)."""

    @property
    def name(self) -> str: ...

    @property
    def polygon(self) -> Polygon: ...

    @property
    def free_sides(self) -> tuple[int, ...]: ...

    @property
    def jumps(self) -> dict[sympy.Expr, Kink]:
        """The steps pos(a, 0) in f, and the line or circle at which each changes between 0 and 1."""

    def source_model(self, x: Model, y: Model, steps: Steps) -> Model:
        """f on the boxes of x and y, on which the steps have those values, NaN for both."""

    def obstacle_model(self, side: Index, t: Model) -> Model:
        """g on intervals of the sides (k,), t the arc length in side lengths."""

    @property
    def enclosed_obstacle(self) -> Obstacle:
        """g on the sides that are not free, enclosed."""
