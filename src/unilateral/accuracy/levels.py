"""Solves from coarse to fine with H = 2h, up to a stated accuracy.

Other ratios, which might cost less, are not tried. Each mesh is a refinement of the one before, uniform or
where the bound comes from, as `division` says. Each level starts from the last u_h and lambda_H, and is
iterated until the algebraic bound is a tenth of the error that is wanted, or that is predicted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.halvings import Division, divided, evenness, uniform
from unilateral.accuracy.level import (
    ENOUGH,
    SHARE,
    WORTH,
    Level,
    Prospect,
    least_unknowns,
    standing,
    target,
    unknowable,
    without_contact,
)
from unilateral.accuracy.watch import ENCLOSING, Watch
from unilateral.bounds.source import enclosed
from unilateral.discrete.base import AIM, DiscreteProblem
from unilateral.discrete.choice import check_condensed, wants_multigrid
from unilateral.discrete.condensed import discretise
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import AdaptedMesh, adapted
from unilateral.geometry.adapted import divided as divided_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import halved_cells, natural_kind
from unilateral.problems.scaled import Data
from unilateral.solvers.stop import Stop
from unilateral.system.memory import available_mb, forget_peak, peak_mb

GROWTH = 0.4
"""Where all sides are short, triangles grow by this factor times their distance from the boundary.

If they grow faster, gmsh makes flat ones.
"""
MARGIN = 0.93
"""The next level aims at this fraction of the wanted error."""
LEAST_STEP, LARGEST_STEP = 1.25, 8.0
"""A level has at most LARGEST_STEP times the triangles of the one before, before neighbours follow.

If the budget allows neither the wanted step nor LEAST_STEP times the triangles, no level is made.
"""
FOLLOW = 1.15
"""A mesh gets this many times the predicted triangles, because neighbours are refined, too."""
OF_LAMBDA = 0.75
"""On adapted meshes lambda's bound falls like the unknowns to minus this, as H^{3/2}; 0.82 was observed."""
RATES = (0.25, 2.0)
"""An observed rate is believed only as far as it lies between these two."""
SPARE = 0.8
"""The next level may take this fraction of the free memory, beside what the last one still holds."""
CAUTION = 0.7
"""If seconds or memory allow less than is wanted, this fraction of the unknowns that they allow is used.

What these unknowns are predicted to be was right within 1.5.
"""


def levels(
    problem: Data, goal: Goal, stop: Stop | None = None, kind: str = "", watch: Watch | None = None
) -> Iterator[Level]:
    """The levels as they are solved; the last one is certified, or the budget does not allow another.

    `kind` is that of the meshes, "structured" or "unstructured", all of which are then uniform. Raises
    InputError if the coarsest mesh has more unknowns than the goal allows, or, perhaps after some levels, a
    mesh cannot be made; OutOfBudget if a limit is reached in the midst of a level.
    """
    stop, watch, done = stop or Stop(), watch or Watch(), list[Level]()
    forget_peak()
    watch.goal, watch.most_mb = goal, peak_mb() + SPARE * available_mb()
    watch.begin_level()
    prospect = Prospect(done, stop, kind, watch.elapsed)
    of, predicted = _first(problem.polygon, goal, kind, prospect.free), math.inf
    discrete: DiscreteProblem | None = None
    while True:
        prospect = Prospect(done, stop, kind, watch.elapsed)
        watch.expected = prospect.seconds(of.mesh.n_nodes) if done else 0.0
        watch.at("matrices", of.mesh.n_nodes)
        watch.at(ENCLOSING)
        discrete = _on(problem, of, stop, discrete, done[-1].solved if done else None)
        done.append(_solved(discrete, goal, stop, done, predicted, watch))
        yield done[-1]
        following = division(Prospect(done, stop, kind, watch.elapsed))
        if following is None:
            return
        predicted = following.left * done[-1].total
        watch.begin_level()
        of = divided_mesh(of, following.halvings)


def _first(polygon: Polygon, goal: Goal, kind: str, free: bool) -> AdaptedMesh:
    """The coarsest mesh. Where all sides are short it is graded, if meshes are `free` to be so.

    Raises InputError as `levels`.
    """
    made, H = kind or natural_kind(polygon), float(polygon.lengths.max())
    expected = least_unknowns(polygon, H / 2)
    graded = expected > ENOUGH and made == "unstructured" and free
    if not graded and expected > goal.unknowns:
        raise _too_many(polygon, f"at least {expected:.2g}", goal)
    mesh = two_edges_per_cell(polygon, H, made, GROWTH if graded else None)
    if mesh.n_nodes > goal.unknowns:
        raise _too_many(polygon, str(mesh.n_nodes), goal)
    return adapted(mesh)


def _on(
    problem: Data, of: AdaptedMesh, stop: Stop, before: DiscreteProblem | None, last: DiscreteSolution | None
) -> DiscreteProblem:
    """The discrete problem on a mesh, from the problem `before` and its solution, if there is one."""
    if wants_multigrid(stop, math.inf):
        from unilateral.discrete.multilevel import MultilevelProblem, discretise_nested  # and with it PyAMG

        assert isinstance(before, MultilevelProblem | None)
        return discretise_nested(problem, of, before, last)
    check_condensed(of.mesh, of.partition)
    found = discretise(problem, of.mesh, of.partition)
    return found if found.source else replace(found, source=enclosed(of.mesh, problem))


def _too_many(polygon: Polygon, needed: str, goal: Goal) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; "
        f"max_unknowns={goal.unknowns:.0f} has to be at least that"
    )


def two_edges_per_cell(polygon: Polygon, H: float, kind: str, growth: float | None = None) -> Mesh:
    """A mesh with two equal boundary edges, h = H/2, in every cell of the size H at most.

    With a `growth` triangles are larger the farther they are from the boundary.
    """
    if kind == "structured":
        return halved_cells(polygon, H)
    cells = partitions.balanced(partitions.uniform(polygon, H))
    return meshes.following(cells, 2, growth=growth)[0]


def _solved(
    discrete: DiscreteProblem, goal: Goal, stop: Stop, done: Sequence[Level], predicted: float, watch: Watch
) -> Level:
    """Solves a level whose bound will be about as `predicted`."""
    in_norm = 1.0 if goal.norm == "h1" else discrete.beta
    start, tolerance, total = None, None, math.inf
    if done:
        before = done[-1]
        start = before.partition.means(before.solved.lambda_H, discrete.partition.points)[discrete.cells]
        total = max(before.target, predicted)
        if math.isfinite(total):
            tolerance = AIM * SHARE * total * in_norm or None
    watch.at("solve")
    solved = discrete.iterated(tolerance, stop, start, total)
    watch.at("bound")
    if done and (wanted_bound := SHARE * max(target(solved, goal), predicted) * in_norm) > 0:
        solved = discrete.improved(solved, wanted_bound, stop)
    solved.bound(goal.sharp)  # its time counts, too
    seconds = watch.end_level()
    return Level(solved, goal, sum(seconds.values()), peak_mb(), seconds[ENCLOSING], predicted)


def wanted(done: Sequence[Level]) -> bool:
    """Whether another level is wanted after these."""
    last = done[-1]
    over = last.certified or not last.solved.result.converged or unknowable(last) or without_contact(last)
    return not over and len(standing(done)) == len(done)


def division(prospect: Prospect) -> Division | None:
    """How to divide the triangles for the next level, None if it is not wanted or not within the budget.

    Where the budget does not allow what is wanted, the last level stays away from the limits.
    """
    if not wanted(prospect.done):
        return None
    last, most = prospect.done[-1], min(most_unknowns(prospect).values())
    best = _best(prospect)
    if FOLLOW * best.times * last.unknowns <= most:
        return best
    times = min(most_unknowns(prospect, CAUTION).values()) / (FOLLOW * last.unknowns)
    known = 0 < last.solved.shares.max() < math.inf
    if not (prospect.free and known) or times < LEAST_STEP:
        return None
    return divided(last.solved.shares, 0.0, times)


def _best(prospect: Prospect) -> Division:
    """The wanted division, which is uniform where that takes at most WORTH times the triangles.

    If several steps are needed, they are of one size.
    """
    last, part = prospect.done[-1], wanted_part(prospect.done)
    shares, m = last.solved.shares, len(last.solved.shares)
    if part == 0 or not prospect.free or not 0 < shares.max() < math.inf:
        return uniform(m)
    needed, most = evenness(shares) / part**2, LARGEST_STEP
    if needed > most and not prospect.adapted:
        return uniform(m)
    if needed > most:
        steps = math.ceil(math.log(needed) / math.log(most))
        most = max(needed ** (1 / steps), 4.0)
    found, times = divided(shares, part, most), max(math.ceil(-math.log2(part)), 1)
    return uniform(m, times) if 4**times <= WORTH * found.times else found


def wanted_part(done: Sequence[Level]) -> float:
    """The part of the last bound that the next level is to leave; 0 where it is not known what is wanted.

    The next prediction is taken to miss by the factor `missed` of the last one. The bound on lambda falls
    like the unknowns to the power -OF_LAMBDA.
    """
    last = done[-1]
    if not (last.target > 0 and math.isfinite(last.total)):
        return 0.0
    part = MARGIN * last.target / (last.total * last.missed)
    return part if last.goal.norm == "h1" else part ** (0.5 / OF_LAMBDA)


def most_unknowns(prospect: Prospect, part: float = 1.0) -> dict[str, float]:
    """The unknowns that each limit allows the next level to have, that `part` of those that are predicted.

    What a level takes whatever its size is held already, and no part of what is free.
    """
    goal = prospect.done[-1].goal
    (of_memory, mb), (of_time, seconds) = goal.memory(prospect.held + SPARE * available_mb()), goal.seconds
    return {
        f"max_unknowns={goal.unknowns:.0f}": goal.unknowns,
        of_memory: part * prospect.within_mb(mb),
        of_time: part * prospect.within_seconds(seconds),
    }


def limits(prospect: Prospect) -> list[str]:
    """The limits that do not allow a level after the last one; the limit that allows least, if all do."""
    last, most = prospect.done[-1], most_unknowns(prospect)
    least = FOLLOW * (LEAST_STEP if prospect.free else 4) * last.unknowns
    return [name for name, unknowns in most.items() if unknowns < least or unknowns == min(most.values())]


def observed_rate(done: Sequence[Level]) -> float:
    """The rate between the last two levels, as far as it is believed; NaN without two finite bounds."""
    if not all(math.isfinite(level.total) for level in done[-2:]) or len(done) < 2:
        return math.nan
    coarse, fine = done[-2:]
    observed = math.log(coarse.total / fine.total) / math.log(coarse.partition.H / fine.partition.H)
    return min(max(observed, RATES[0]), RATES[1])
