"""One solve towards a goal: whether it is certified, and which solves contradict each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from unilateral.adaptive.goal import Goal
from unilateral.bounds.flux_residuals import SUMS, underflow
from unilateral.discrete.solution import DiscreteSolution
from unilateral.formulas.decimals import interval
from unilateral.geometry.partition import Partition

CONTRADICTED = "bounds contradict each other"
WITHOUT_CONTACT = "lambda_H is 0, so a relative error has no meaning; ask for an absolute accuracy"
NOT_CONVERGED = "the iteration did not converge (max_steps=, rho=, algorithm=)"
NOT_ENCLOSED = "f or g varies too fast or has terms that cancel"
ALGEBRAIC_SHARE = 0.1
"""The part of the wanted error that the iteration may have."""
CONTACT_UNKNOWNS = 4_000
"""From this many unknowns on, contact that is not seen is taken for none."""
ZERO_SOLUTION_BOUND = 1e-140
"""Where u_h is 0, a bound up to this counts as no error, because no error is a fraction of 0."""


@dataclass(frozen=True, eq=False)
class Level:
    """One solve towards a goal, and what it took.

    Parameters
    ----------
    solved
        The solution, on the scaled domain.
    goal
        What is wanted.
    seconds
        The time of the level, with that for its mesh and its bound.
    elapsed
        The seconds from the beginning to the end of this level.
    mb
        The peak memory of the process during the level.
    enclosing
        The part of the seconds in which f is enclosed, which may grow much slower than the unknowns.
    predicted
        The bound as the level before predicted it, infinite for the first level.
    next_unknowns, next_seconds
        What the next level will have and take, as predicted; 0 if there is none.
    """

    solved: DiscreteSolution
    goal: Goal
    seconds: float
    elapsed: float = 0.0
    mb: float = 0.0
    enclosing: float = 0.0
    predicted: float = math.inf
    next_unknowns: float = 0.0
    next_seconds: float = 0.0

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
        return wanted_error(self.solved, self.goal)

    @property
    def nothing(self) -> float:
        """The error that counts as none where every number of the discrete solution is 0."""
        mesh = self.solved.mesh
        return max(ZERO_SOLUTION_BOUND, 2 * mesh.growth * underflow(mesh, self.solved.form))

    @property
    def certified(self) -> bool:
        """Whether the bound proves the accuracy, with at most a tenth of it for the iteration."""
        wanted = self.goal.accuracy if self.goal.absolute else self.goal.accuracy * self.size
        wanted = wanted if self.target else self.nothing
        return self.total <= wanted and self.algebraic <= ALGEBRAIC_SHARE * wanted


def wanted_error(solved: DiscreteSolution, goal: Goal) -> float:
    """The accuracy times a lower bound on the solution's norm.

    If that lower bound is 0 the discrete norm takes its place. An absolute accuracy is the wanted error
    itself.
    """
    if goal.absolute:
        return goal.accuracy
    return goal.accuracy * (solved.size(goal.norm, goal.sharp) or discrete_norm(solved, goal))


def discrete_norm(solved: DiscreteSolution, goal: Goal) -> float:
    """The norm of u_h, or of lambda_H, in the goal's norm."""
    return solved.u_norm if goal.norm == "h1" else solved.lambda_norm


def lacks_contact(level: Level) -> bool:
    """Whether lambda_H is 0 although an error relative to it is wanted, on a mesh that is not coarse."""
    return level.target == 0 and level.goal.norm == "hm12" and level.unknowns >= CONTACT_UNKNOWNS


def unknowable(level: Level) -> bool:
    """Whether what stays unknown of f, g and q on finer meshes, too, exceeds the error that is wanted."""
    bound = level.solved.bound(level.goal.sharp)
    return bound is not None and bound.irreducible > level.target > 0


def uncontradicted(levels: Sequence[Level]) -> list[Level]:
    """The levels whose bounds no other level's contradict; of two that contradict, none is believed."""
    return [a for a in levels if not any(contradict(a, b) for b in levels if b is not a)]


def contradict(a: Level, b: Level) -> bool:
    """Whether two levels' bounds cannot both hold: for ||u||_1, the integral of u or that of lambda.

    |int v| <= |Omega|^{1/2} ||v||_0, and |<mu, 1>| <= |Omega|^{1/2} ||mu||_{-1/2}. Beside clamped sides only
    ||u||_1 tells: u - u_h need not vanish there, as Friedrichs' inequality asks, and 1 does not.
    """
    root = math.inf if a.solved.form.clamped else math.sqrt(a.partition.polygon.area)
    u_bound = a.solved.total("h1", a.goal.sharp) + b.solved.total("h1", b.goal.sharp)
    lambda_bound = a.solved.total("hm12", a.goal.sharp) + b.solved.total("hm12", b.goal.sharp)
    pairs = (
        (a.solved.u_norm, b.solved.u_norm, u_bound),
        (a.solved.u_integral, b.solved.u_integral, root * u_bound),
        (a.solved.force, b.solved.force, root * lambda_bound),
    )
    # Norms on the exact meshes differ from the computed ones by their growth, and by rounding
    rounding = (1 + SUMS) * a.solved.mesh.growth * b.solved.mesh.growth - 1
    return any(abs(x - y) > (1 + SUMS) * bound + rounding * max(abs(x), abs(y)) for x, y, bound in pairs)


def find_fault(levels: Sequence[Level]) -> str:
    """Why finer meshes do not help; empty if they may, and if the last level is certified."""
    last = levels[-1]
    if len(uncontradicted(levels)) < len(levels):
        return CONTRADICTED
    if last.certified:
        return ""
    if lacks_contact(last):
        return WITHOUT_CONTACT
    if not last.solved.result.converged:
        return NOT_CONVERGED
    return NOT_ENCLOSED if unknowable(last) else ""
