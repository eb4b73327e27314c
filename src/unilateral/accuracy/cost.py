"""What levels cost: constants as measured, corrected by what the finished levels have cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from unilateral.accuracy.level import Level, refinement_pays
from unilateral.discrete.choice import SHARP, SPARSE, wants_multigrid
from unilateral.solvers.stop import Stop

BYTES_PER_MB = 2**20
RECENT = 3
"""The enclosure of f is expected to take the mean time of this many last levels.

That time hardly depends on the size of a level.
"""


class Cost(NamedTuple):
    """What a level costs: seconds whatever its size, seconds per unknown (`each`), and bytes per unknown."""

    start: float
    each: float
    bytes: float


MULTILEVEL = Cost(0.02, 8e-6, 1100)
CONDENSED = Cost(0.03, 5e-5, SPARSE)
WITH_SHARP = Cost(0.02, 2.2e-5, SHARP)
"""The costs by multigrid and condensed to the boundary, and what the sharp bound adds.

They were measured with up to 1e6 unknowns, 5e4 with the sharp bound, each on one core of an AMD EPYC.
"""


def may_adapt(stop: Stop, kind: str) -> bool:
    """Whether nothing is asked for that adapted meshes cannot give."""
    return not kind and stop.algorithm == "auto" and stop.rho is None


@dataclass(frozen=True)
class Prospect:
    """What a level after those `done` will cost, `elapsed` seconds after the beginning.

    Meshes are of that `kind`. By default they are adapted once that pays, unless something is asked for that
    adapted meshes cannot give.
    """

    done: Sequence[Level]
    stop: Stop
    kind: str
    elapsed: float

    @property
    def free(self) -> bool:
        """Whether meshes need not be uniform."""
        return may_adapt(self.stop, self.kind)

    @cached_property
    def adapted(self) -> bool:
        """Whether meshes may be adapted, and already are or should be, because it pays."""
        last = self.done[-1]
        return self.free and (last.solved.discrete.mesh.adapted or refinement_pays(last))

    @property
    def cost(self) -> Cost:
        goal = self.done[-1].goal
        cost = MULTILEVEL if wants_multigrid(self.stop, math.inf) else CONDENSED
        return Cost(*(a + b for a, b in zip(cost, WITH_SHARP, strict=True))) if goal.sharp else cost

    @cached_property
    def speed(self) -> float:
        """The seconds taken over those of `cost`, without f's enclosures and the first level (it imports)."""
        later = self.done[1:]
        expected = sum(self.cost.start + self.cost.each * level.unknowns for level in later)
        return sum(level.seconds - level.enclosing for level in later) / expected if later else 1.0

    @cached_property
    def fixed(self) -> float:
        """The seconds that a level takes whatever its size: to enclose f, above all."""
        recent = self.done[-RECENT:]
        return sum(each.enclosing for each in recent) / len(recent) + self.speed * self.cost.start

    @cached_property
    def held(self) -> float:
        """The MB that a level takes whatever its size."""
        return max(level.mb - self.cost.bytes * level.unknowns / BYTES_PER_MB for level in self.done)

    def seconds(self, unknowns: float) -> float:
        return self.fixed + self.speed * self.cost.each * unknowns

    def mb(self, unknowns: float) -> float:
        return self.held + self.cost.bytes * unknowns / BYTES_PER_MB

    def within_seconds(self, seconds: float) -> float:
        """The unknowns of a level that ends in time, 0 if there is none."""
        return max((seconds - self.elapsed - self.fixed) / (self.speed * self.cost.each), 0.0)

    def within_mb(self, mb: float) -> float:
        """The unknowns of a level that fits into the memory, 0 if there is none."""
        return max((mb - self.held) * BYTES_PER_MB / self.cost.bytes, 0.0)
