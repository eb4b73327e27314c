"""What one level of the search found, which levels contradict each other, and what the next one will cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from unilateral.accuracy.goal import NORMS, Goal
from unilateral.accuracy.halvings import evenness
from unilateral.bounds.flux_residuals import SUMS, underflow
from unilateral.discrete.choice import SHARP, SPARSE, wants_multigrid
from unilateral.discrete.solution import DiscreteSolution
from unilateral.formulas.decimals import interval
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.solvers.stop import Stop

SHARE = 0.1
"""The part of the wanted error that the iteration may have."""
WORTH, ENOUGH = 1.5, 200
"""Adapted meshes pay if uniform ones need more than WORTH times as many triangles.

Where solutions vary alike everywhere that ratio is seen to be 1. Below ENOUGH unknowns all meshes cost alike.
"""
SEEN = 4_000
"""From this many unknowns on, contact that is not seen is taken for none."""
NOTHING = 1e-140
"""Where u_h is 0, a bound up to this counts as no error, because no error is a fraction of 0."""
BYTES_PER_MB = 2**20
RECENT = 3
"""The time to enclose f, which hardly depends on the size, is taken to be the mean of so many last ones."""


class Summary(NamedTuple):
    """What is told of a level; sizes are those of the scaled domain."""

    h: float
    H: float
    unknowns: int
    multipliers: int
    iterations: float
    total_bound: float


@dataclass(frozen=True, eq=False)
class Level:
    """One solve towards a goal. Its `seconds` include those for its mesh; `mb` is its peak memory.

    `enclosing` is the part of the seconds in which f is enclosed. `predicted` is the bound as it was
    predicted, if it could be.
    """

    solved: DiscreteSolution
    goal: Goal
    seconds: float
    mb: float = 0.0
    enclosing: float = 0.0
    predicted: float = math.inf

    def __repr__(self) -> str:
        return f"Level: {self.unknowns} unknowns, the error is {interval(-math.inf, self.total, spec='.3g')}"

    @property
    def partition(self) -> Partition:
        return self.solved.partition

    @property
    def unknowns(self) -> int:
        return self.solved.mesh.n_nodes

    @property
    def total(self) -> float:
        """The guaranteed bound on the error in the goal's norm."""
        return self.solved.total(self.goal.norm, self.goal.sharp)

    @property
    def summary(self) -> Summary:
        solved = self.solved
        sizes = solved.mesh.h, self.partition.H, self.unknowns, len(solved.cells)
        return Summary(*sizes, solved.result.iterations, self.total)

    @property
    def missed(self) -> float:
        """The factor by which the bound missed the predicted one, as far as that is believed to go on."""
        found = self.total / self.predicted
        return min(max(found, 0.9), 1.5) if found > 0 else 1.0

    @property
    def algebraic(self) -> float:
        """The bound on the iteration's part of the error in the goal's norm."""
        return self.solved.algebraic(self.goal.norm)

    @property
    def size(self) -> float:
        """A lower bound on the solution's norm."""
        return self.solved.size(self.goal.norm, self.goal.sharp)

    @property
    def target(self) -> float:
        """The error that is wanted, as far as this level knows the solution's norm."""
        return target(self.solved, self.goal)

    @property
    def nothing(self) -> float:
        """The error that counts as none where every number of the discrete solution is 0."""
        mesh = self.solved.mesh
        return max(NOTHING, 2 * mesh.growth * underflow(mesh, self.solved.form))

    @property
    def certified(self) -> bool:
        wanted = self.goal.accuracy if self.goal.absolute else self.goal.accuracy * self.size
        wanted = wanted if self.target else self.nothing
        return self.total <= wanted and self.algebraic <= SHARE * wanted


def target(solved: DiscreteSolution, goal: Goal) -> float:
    """The error that is wanted: the accuracy times a lower bound on the norm.

    If that lower bound is 0 the discrete norm takes its place. An absolute accuracy is the wanted error
    itself.
    """
    if goal.absolute:
        return goal.accuracy
    size = solved.u_norm if goal.norm == "h1" else solved.lambda_norm
    return goal.accuracy * (solved.size(goal.norm, goal.sharp) or size)


def without_contact(last: Level) -> bool:
    """Whether lambda_H is 0 although an error relative to it is wanted, on a mesh that is not coarse."""
    return last.target == 0 and last.goal.norm == "hm12" and last.unknowns >= SEEN


def unknowable(last: Level) -> bool:
    """Whether what stays unknown of f, g and q on finer meshes, too, exceeds the error that is wanted."""
    bound = last.solved.bound(last.goal.sharp)
    return bound is not None and bound.irreducible > last.target > 0


def least_unknowns(polygon: Polygon, h: float) -> float:
    """The unknowns that a mesh of equal triangles of the size h has at least.

    Equilateral triangles make 2 / sqrt(3) times the area over h^2.
    """
    return 0.5 * polygon.area / h**2


def refinement_pays(last: Level) -> bool:
    """Whether uniform meshes need more than WORTH times the triangles of adapted ones, by the bound's parts.

    They do so at once where short sides leave a mesh with fewer unknowns than a uniform one has at least.
    """
    shares, mesh = last.solved.shares, last.solved.mesh
    if last.unknowns < least_unknowns(mesh.polygon, mesh.h):
        return True
    return last.unknowns >= ENOUGH and WORTH * evenness(shares) < 1


def standing(done: Sequence[Level]) -> list[Level]:
    """The levels whose bounds no other level's contradict; of two that contradict, none is believed."""
    return [a for a in done if not any(contradict(a, b) for b in done if b is not a)]


def contradict(a: Level, b: Level) -> bool:
    """Whether two levels' bounds cannot both hold: for ||u||_1, the integral of u or that of lambda.

    |int v| <= |Omega|^{1/2} ||v||_0, and |<mu, 1>| <= |Omega|^{1/2} ||mu||_{-1/2}. Beside clamped sides only
    ||u||_1 tells: u - u_h need not vanish there, as Friedrichs' inequality asks, and 1 does not.
    """
    root = math.inf if a.solved.form.clamped else math.sqrt(a.partition.polygon.area)
    of_u, of_lambda = (sum(each.solved.total(norm, each.goal.sharp) for each in (a, b)) for norm in NORMS)
    apart = (
        (a.solved.u_norm, b.solved.u_norm, of_u),
        (a.solved.u_integral, b.solved.u_integral, root * of_u),
        (a.solved.force, b.solved.force, root * of_lambda),
    )
    rounding = (1 + SUMS) * math.prod(each.solved.mesh.growth for each in (a, b)) - 1
    return any(abs(x - y) > (1 + SUMS) * bound + rounding * max(abs(x), abs(y)) for x, y, bound in apart)


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


@dataclass(frozen=True)
class Prospect:
    """What a level after those `done` will cost, `elapsed` seconds after the beginning.

    Meshes are of that `kind`. By default they are adapted once that pays.
    """

    done: Sequence[Level]
    stop: Stop
    kind: str
    elapsed: float

    @property
    def free(self) -> bool:
        """Whether meshes need not be uniform: nothing is asked for that adapted ones cannot give."""
        return not self.kind and self.stop.algorithm == "auto" and self.stop.rho is None

    @cached_property
    def adapted(self) -> bool:
        """Whether meshes may be adapted, and already are or should be, because it pays."""
        last = self.done[-1]
        return self.free and (last.solved.mesh.adapted or refinement_pays(last))

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
