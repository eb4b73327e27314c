"""One solve towards a goal: whether it is certified, and which solves contradict each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from unilateral.adaptive.goal import Goal
from unilateral.bounds.forces import Force
from unilateral.bounds.local_bounds import Bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, underflow_allowance
from unilateral.discrete.solution import DiscreteSolution
from unilateral.formulas.decimals import format_interval
from unilateral.geometry.partition import Partition

CONTRADICTED = "bounds contradict each other"
WITHOUT_CONTACT = "lambda_H is 0, so a relative error has no meaning; ask for an absolute accuracy"
FORCE_NOT_BOUNDED = (
    "u may touch where a clamped side begins, so the force has no upper bound; ask for it and the reaction "
    "together (sides=)"
)
ITERATION_NOT_CONVERGED = "the iteration did not converge (max_steps=, rho=, algorithm=)"
NOT_ENCLOSED = "f or g varies too fast or has terms that cancel"
BELOW_ROUNDING = "double precision allows no error as small as that"
ALGEBRAIC_SHARE = 0.1
"""The part of the wanted error that the iteration may have."""
ROUNDING_SHARE = 1e-10
"""What stays unknown of f, g and q is taken for rounding up to this part of the solution's norm."""
MIN_CONTACT_UNKNOWNS = 4_000
"""From this many unknowns on, contact that is not seen is taken for none, and so is a gap at a vertex."""
ZERO_SOLUTION_BOUND = 1e-140
"""Where u_h is 0, a bound up to this counts as no error, because no error is a fraction of 0."""


@dataclass(frozen=True, eq=False)
class Level:
    """One solve towards a goal, what it took, and what its bound says of the goal.

    Parameters
    ----------
    solved
        The solution.
    goal
        What is wanted.
    predicted_total
        The bound as the level before predicted it, infinite for the first level.
    partition, unknowns
        The multiplier's partition, and the number of the mesh's nodes.
    bound
        The guaranteed bounds that the goal takes, None without data.
    force
        The interval of the force, for a goal of one.
    total
        The guaranteed bound on the error in the goal's norm; of a force half of the width of its interval.
    algebraic
        The bound on the iteration's part of the error in that norm.
    size
        A lower bound on the solution's norm.
    target
        The error that is wanted, as far as this level knows the solution's norm.
    zero_solution_error
        The error that counts as none where every number of the discrete solution is 0.
    certified
        Whether the bound proves the accuracy, with at most a tenth of it for the iteration.
    seconds
        The time of the level: the refinement that made its mesh, the solution and the bound.
    elapsed
        The seconds from the beginning to the end of this level.
    peak_mb
        The peak memory of the process during the level.
    enclosing_seconds
        The part of the seconds in which f is enclosed, which may grow much slower than the unknowns.
    next_unknowns, next_seconds
        What the next level will have and take, as predicted; 0 if there is none.
    """

    solved: DiscreteSolution
    goal: Goal
    predicted_total: float
    partition: Partition
    unknowns: int
    bound: Bound | None
    force: Force | None
    total: float
    algebraic: float
    size: float
    target: float
    zero_solution_error: float
    certified: bool
    seconds: float = 0.0
    elapsed: float = 0.0
    peak_mb: float = 0.0
    enclosing_seconds: float = 0.0
    next_unknowns: float = 0.0
    next_seconds: float = 0.0

    @property
    def discrete_size(self) -> float:
        """The norm of the discrete solution in the goal's norm; of a force the size of its value."""
        return abs(self.force.value) if self.force else discrete_norm(self.solved, self.goal)

    @property
    def width_per_error(self) -> float:
        """The half-width of the force's interval over the bound on lambda's error; 1 for a norm."""
        return _width_per_error(self.force, self.bound)

    def __repr__(self) -> str:
        error = format_interval(-math.inf, self.total, spec=".3g")
        return f"Level: {self.unknowns} unknowns, the error is {error}"


def measure_level(solved: DiscreteSolution, goal: Goal, predicted_total: float = math.inf) -> Level:
    """The level of a solution: its bound is computed here, and judged by the goal."""
    mesh = solved.mesh
    bound = solved.bound(goal.sharp)
    force = None
    if goal.norm == "force":
        force = solved.bound_forces([goal.sides], goal.sharp)[0]
        total = half_width(force)
        size = max(force.lower, -force.upper, 0.0)
        target = target_error(goal, size, abs(force.value))
    else:
        total = solved.total_bound(goal.norm, goal.sharp)
        size = solved.norm_lower_bound(goal.norm, goal.sharp)
        target = target_error(goal, size, discrete_norm(solved, goal))
    algebraic = solved.algebraic_bound(goal.norm) * _width_per_error(force, bound)
    # No bound is below what underflow adds to it, even where u_h = 0 is the solution
    zero_solution_error = max(
        ZERO_SOLUTION_BOUND, 2 * mesh.exact_mesh_factor * underflow_allowance(mesh, solved.form)
    )

    # The accuracy is one of the lower bound on the norm, of which the iteration may have a tenth. Relative to
    # that bound nothing is certified where it is 0, but for u_h = 0, for which the target is 0, too
    max_error = zero_solution_error
    if target:
        max_error = goal.accuracy if goal.absolute else goal.accuracy * size
    certified = total <= max_error and algebraic <= ALGEBRAIC_SHARE * max_error
    return Level(
        solved=solved,
        goal=goal,
        predicted_total=predicted_total,
        partition=solved.partition,
        unknowns=mesh.n_nodes,
        bound=bound,
        force=force,
        total=total,
        algebraic=algebraic,
        size=size,
        target=target,
        zero_solution_error=zero_solution_error,
        certified=certified,
    )


def half_width(force: Force) -> float:
    """Half of the width of the force's interval."""
    return 0.5 * (force.upper - force.lower)


def _width_per_error(force: Force | None, bound: Bound | None) -> float:
    """The half-width of the force's interval over the bound on lambda's error, 1 where one is not known."""
    if force is None or bound is None or not 0 < half_width(force) < math.inf > bound.lambda_ > 0:
        return 1.0
    return half_width(force) / bound.lambda_


def judge_for_goal(level: Level, goal: Goal) -> Level:
    """The level with another goal; what it took stays."""
    return replace(
        measure_level(level.solved, goal, level.predicted_total),
        seconds=level.seconds,
        elapsed=level.elapsed,
        peak_mb=level.peak_mb,
        enclosing_seconds=level.enclosing_seconds,
    )


def target_error(goal: Goal, size: float, discrete_norm: float) -> float:
    """The accuracy times a lower bound `size` on the solution's norm.

    If that lower bound is 0 the discrete norm takes its place. An absolute accuracy is the wanted error
    itself.
    """
    if goal.absolute:
        return goal.accuracy
    return goal.accuracy * (size or discrete_norm)


def discrete_norm(solved: DiscreteSolution, goal: Goal) -> float:
    """The norm of u_h, or of lambda_H, in the goal's norm."""
    return solved.u_norm if goal.norm == "h1" else solved.lambda_norm


def is_limited_by_data(level: Level) -> bool:
    """Whether what stays unknown of f, g and q on finer meshes, too, exceeds the error that is wanted."""
    if level.bound is None:
        return False
    return level.bound.irreducible_remainder * level.width_per_error > level.target > 0


def select_consistent(levels: Sequence[Level]) -> list[Level]:
    """The levels whose bounds no other level's contradict; of two that contradict, none is believed."""
    return [a for a in levels if not any(contradict(a, b) for b in levels if b is not a)]


def contradict(a: Level, b: Level) -> bool:
    """Whether two levels' bounds cannot both hold: for ||u||_1, a force, the integral of u or that of lambda.

    |int v| <= (|Omega| / c)^{1/2} ||v||, and |<mu, 1>| <= (c |Omega|)^{1/2} ||mu||_{-1/2}. Beside clamped
    sides only ||u||_1 tells: u - u_h need not vanish there, as Friedrichs' inequality asks, and 1 does not.
    """
    if a.force and b.force and not (a.force.lower <= b.force.upper and b.force.lower <= a.force.upper):
        return True
    form = a.solved.form
    # |int v| <= u_factor ||v||, |<mu, 1>| <= lambda_factor ||mu||_{-1/2}
    u_factor = math.inf
    lambda_factor = math.inf
    if not form.clamped:
        area = a.partition.polygon.area
        u_factor = math.sqrt(area / form.c)
        lambda_factor = math.sqrt(area * form.c)
    # ||u_a - u_b|| <= ||u_a - u|| + ||u - u_b||
    u_bound = lambda_bound = math.inf
    if a.bound and b.bound:
        u_bound = a.bound.u + b.bound.u
        lambda_bound = a.bound.lambda_ + b.bound.lambda_
    comparisons = (
        (a.solved.u_norm, b.solved.u_norm, u_bound),
        (a.solved.u_integral, b.solved.u_integral, u_factor * u_bound),
        (a.solved.force, b.solved.force, lambda_factor * lambda_bound),
    )
    # Norms on the exact meshes differ from the computed ones by their growth, and by rounding
    rounding = (1 + SQUARES_ROUNDING) * a.solved.mesh.exact_mesh_factor * b.solved.mesh.exact_mesh_factor - 1
    return any(
        abs(x - y) > (1 + SQUARES_ROUNDING) * bound + rounding * max(abs(x), abs(y))
        for x, y, bound in comparisons
    )


def find_fault(levels: Sequence[Level]) -> str:
    """Why finer meshes do not help; empty if they may, and if the last level is certified."""
    last = levels[-1]
    if len(select_consistent(levels)) < len(levels):
        return CONTRADICTED
    if last.certified:
        return ""
    # an error relative to lambda or to a force is wanted, but lambda_H is 0 on a mesh that is not coarse
    if last.target == 0 and last.goal.norm != "h1" and last.unknowns >= MIN_CONTACT_UNKNOWNS:
        return WITHOUT_CONTACT
    if last.force and last.total == math.inf and last.unknowns >= MIN_CONTACT_UNKNOWNS:
        return FORCE_NOT_BOUNDED
    # where the algebraic error hardly counts, finer meshes do help
    if not last.solved.result.converged and last.algebraic > ALGEBRAIC_SHARE * last.total:
        return ITERATION_NOT_CONVERGED
    if last.bound is None or not is_limited_by_data(last):
        return ""
    rounding = ROUNDING_SHARE * last.discrete_size
    return NOT_ENCLOSED if last.bound.irreducible_remainder > rounding else BELOW_ROUNDING
