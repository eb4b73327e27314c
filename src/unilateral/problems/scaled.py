"""Problems with k and c as problems (1.1)-(1.2), on the domain scaled by (c/k)^{1/2}: see `units`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.formulas.taylor import EPS, Model
from unilateral.geometry.polygon import Polygon
from unilateral.problems.nodal import cuts
from unilateral.problems.obstacle_and_flux import Flux, Obstacle, enclose_flux, enclose_obstacle
from unilateral.problems.problem import Problem, SourceFunction


@dataclass(frozen=True, eq=False)
class Scaled:
    """The problem for v, made from the problem `of` u. Vertices are rounded once more."""

    of: Problem

    exact = None  # cases have k = 1, and are not scaled

    @property
    def name(self) -> str:
        return self.of.name

    @property
    def title(self) -> str:
        return self.of.title

    @property
    def free_sides(self) -> tuple[int, ...]:
        return self.of.free_sides

    @property
    def clamped_sides(self) -> tuple[int, ...]:
        return self.of.clamped_sides

    @property
    def reaction(self) -> float:
        return self.of.reaction

    @cached_property
    def polygon(self) -> Polygon:
        return scaled_polygon(self.of)

    @property
    def source(self) -> SourceFunction | Array:
        """k^{1/2} f / c on the scaled domain."""
        f, length, load = self.of.source, self.of.units.length, self.of.units.load
        if isinstance(f, np.ndarray):
            return f / load
        model = f.model
        jumps = {
            step: replace(
                kink,
                centre=(kink.centre[0] / length, kink.centre[1] / length),
                radius=kink.radius / length,
            )
            for step, kink in f.jumps.items()
        }
        return SourceFunction(
            model=lambda x, y, steps: model(x.scaled(length), y.scaled(length), steps).scaled(1 / load),
            jumps=jumps,
        )

    def obstacle_model(self, side: Index, t: Model) -> Model:
        """k^{1/2} g; t, in side lengths, stays."""
        return self.of.obstacle_model(side, t).scaled(1 / self.of.units.value)

    def slope_model(self, side: Index, t: Model) -> Model:
        """The derivative by t of k^{1/2} u on clamped sides."""
        return self.of.slope_model(side, t).scaled(1 / self.of.units.value)

    @cached_property
    def enclosed_obstacle(self) -> Obstacle:
        """See `Problem`."""
        least = -math.inf if self.clamped_sides else self.of.least / self.of.units.value
        least -= 4 * EPS * abs(least) if math.isfinite(least) else 0.0
        on = self.free_sides, least, cuts(self.of.g), self.clamped_sides, self.slope_model
        return enclose_obstacle(self.polygon, self.obstacle_model, *on)

    def flux_model(self, side: Index, t: Model) -> Model:
        """c^{-1/2} q; t, in side lengths, stays."""
        return self.of.flux_model(side, t).scaled(1 / self.of.units.flux)

    @cached_property
    def enclosed_flux(self) -> Flux:
        return enclose_flux(self.polygon, self.flux_model, self.of.flux_sides, cuts(self.of.q))


Data = Problem | Scaled
"""A problem in units in which it is (1.1)-(1.2), as all solvers and bounds take it."""


def scaled_polygon(of: Problem) -> Polygon:
    """The scaled polygon. Raises InputError if it is too large or too small.

    Its vertices, and the coordinates of meshes on either polygon, are rounded three times: by less than 2 EPS
    of their size, and 3 EPS of the perimeter along the boundary.
    """
    vertices = of.polygon.vertices / of.units.length
    perimeter = of.polygon.perimeter / of.units.length
    return Polygon(vertices, of.polygon.name, doubt=4 * EPS * float(np.abs(vertices).max() + perimeter))


def scaled(problem: Problem) -> Data:
    """The problem for v; the problem itself if k = c = 1, as for cases."""
    return problem if problem.units.trivial else Scaled(problem)
