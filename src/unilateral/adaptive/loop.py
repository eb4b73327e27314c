"""Solve, bound, mark, refine: levels up to a stated accuracy, within three limits.

The first level has the coarsest mesh, with H = 2h. Each next mesh is a refinement of the one before, uniform
or where the bound comes from. Each level starts from the last u_h and lambda_H, and is iterated until the
algebraic bound is a tenth of the error that is wanted, or that is predicted. The first level whose guaranteed
bound is small enough is the last one.

Limits are looked at before a level begins. It does not begin if it is predicted to exceed one of them; a
level that has begun ends, or Ctrl-C ends it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from unilateral.adaptive.forecast import (
    NEIGHBOUR_RATIO,
    Plan,
    allowed_unknowns,
    check_limits,
    is_hopeless,
    make_plan,
    predict_seconds,
    reachable_accuracy,
    show_costs,
)
from unilateral.adaptive.goal import Goal
from unilateral.adaptive.level import (
    ALGEBRAIC_SHARE,
    Level,
    discrete_norm,
    find_fault,
    measure_level,
    select_consistent,
    target_error,
)
from unilateral.adaptive.marking import (
    MIN_ADAPTED_UNKNOWNS,
    MIN_TRIANGLE_RATIO,
    Division,
    choose_target_division,
    divide_by_shares,
    min_unknowns,
)
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.discrete.base import RETRY_TOLERANCE_SHARE, DiscreteProblem
from unilateral.discrete.choice import check_condensing_memory, wants_multigrid
from unilateral.discrete.condensed import discretise
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError, pluralise
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import AdaptedMesh, halve_triangle_edges, start_adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import default_mesh_kind, make_structured_cells
from unilateral.problems.problem import Problem
from unilateral.system.memory import forget_peak, peak_mb

ENDED_BY_INTERRUPT = "interrupted"
BOUNDS_WITHDRAWN = "withdrawn, because they contradict each other; please report it"
OUT_OF_REACH = "out of reach"
NEXT_LEVEL_REFUSED = "the next level is refused"
BOUNDARY_GROWTH = 0.4
"""Where all sides are short, triangles grow by this factor times their distance from the boundary.

If they grow faster, gmsh makes flat ones.
"""
LIMIT_SHARE = 0.7
"""If seconds or memory allow less than is wanted, this fraction of the unknowns that they allow is used.

What these unknowns are predicted to be was right within 1.5.
"""


@dataclass(frozen=True, eq=False)
class Search:
    """The finished levels, and what `ended` the loop; that is empty if the accuracy was reached.

    `believed` are the levels that no other one contradicts. `best` is the last believed level that is
    certified, or else the one with the smallest bound; if none is believed, it is the finest one. `certified`
    says whether a believed level is certified. `refusal` says why the next mesh was refused, if it was.
    `plan` predicts what the accuracy takes if a limit ended the loop and that can be told. `reach` is a
    larger accuracy that the limits allow, where the plan shows that they do not allow this one.
    """

    levels: list[Level]
    ended: str
    believed: list[Level]
    best: Level
    certified: bool
    refusal: InputError | None = None
    plan: Plan | None = None
    reach: float | None = None

    def __repr__(self) -> str:
        outcome = "certified" if self.certified else "not certified" + f": {self.ended}" * bool(self.ended)
        return f"Search: {pluralise(len(self.levels), 'level')}, {outcome}"


def make_search(
    levels: list[Level],
    ended: str,
    refusal: InputError | None = None,
    plan: Plan | None = None,
    reach: float | None = None,
) -> Search:
    """The search that has ended, with its best level."""
    believed = select_consistent(levels)
    candidates = reversed(believed or levels[-1:])
    best = min(candidates, key=lambda level: (not level.certified, level.total))
    certified = bool(believed) and best.certified
    return Search(
        levels, ended, believed, best=best, certified=certified, refusal=refusal, plan=plan, reach=reach
    )


def search(
    problem: Problem,
    goal: Goal,
    report_level: Callable[[Level], None] | None = None,
    dry_run: bool = False,
    start_time: float | None = None,
    coarsest: Mesh | None = None,
) -> Search:
    """Solves level after level until one is certified, or nothing more can be done.

    Parameters
    ----------
    problem
        The problem. None of its data waits for a mesh.
    goal
        The accuracy, and the limits. Without a limit of its own, the loop ends as soon as the default ones
        do not suffice by far.
    report_level : optional
        A function that is called with each finished level.
    dry_run
        The loop ends when the levels are enough for a plan.
    start_time : optional
        The `time.perf_counter()` from which the seconds of the limit count; by default now.
    coarsest : optional
        A mesh of the problem's polygon from which all meshes are refined; by default one is made.

    Returns
    -------
    Search
        The finished levels, also after Ctrl-C and where memory is refused.

    Raises
    ------
    KeyboardInterrupt, MemoryError
        Before the first level is finished.
    BudgetError
        Where a limit does not suffice for the first level.
    InputError
        Where the first mesh cannot be made, or has more unknowns than the goal allows; and by `report_level`.
    """
    start_time = perf_counter() if start_time is None else start_time
    levels: list[Level] = []
    discrete: DiscreteProblem | None = None
    predicted_total = math.inf
    report_error: InputError | None = None  # to tell it from one that refuses a mesh
    try:
        forget_peak()
        check_limits(problem.polygon, goal, perf_counter() - start_time)
        mesh = make_first_mesh(problem.polygon, goal, coarsest)
        start = perf_counter()
        while True:
            # Solve and bound
            enclosing_start = perf_counter()
            discrete = discretise_level(mesh, problem, goal, discrete, levels)
            enclosing_seconds = perf_counter() - enclosing_start
            solved = solve_next_level(discrete, goal, levels, predicted_total)
            level = measure_level(solved, goal, predicted_total)
            levels.append(add_costs(level, start, start_time, enclosing_seconds))

            # Mark, if another level is wanted and within the limits
            fault = find_fault(levels)
            division = None if fault else choose_division(levels, dry_run)
            if division:
                unknowns = NEIGHBOUR_RATIO * division.triangle_ratio * levels[-1].unknowns
                seconds = predict_seconds(levels, unknowns)
                levels[-1] = replace(levels[-1], next_unknowns=unknowns, next_seconds=seconds)
            if report_level:
                try:
                    report_level(levels[-1])
                except InputError as error:
                    report_error = error
                    raise
            if not division:
                return conclude_search(levels, fault, dry_run)

            # Refine, in the next level's time
            start = perf_counter()
            forget_peak()
            predicted_total = division.bound_ratio * levels[-1].total
            mesh = halve_triangle_edges(mesh, division.halvings)
    except (KeyboardInterrupt, MemoryError, InputError) as stopped:
        # The finished levels are a result, unless there are none or the caller's own function failed
        if not levels or stopped is report_error:
            raise
        if isinstance(stopped, KeyboardInterrupt):
            return make_search(levels, ENDED_BY_INTERRUPT)
        if isinstance(stopped, MemoryError):
            return make_search(levels, "out of budget (the memory of this machine)", plan=make_plan(levels))
        return make_search(levels, NEXT_LEVEL_REFUSED, stopped)


def add_costs(level: Level, start: float, start_time: float, enclosing_seconds: float) -> Level:
    """The level that ends now, with its time since `start`, that of the search, and the peak memory."""
    end = perf_counter()
    return replace(
        level,
        seconds=end - start,
        elapsed=end - start_time,
        peak_mb=peak_mb(),
        enclosing_seconds=enclosing_seconds,
    )


def conclude_search(levels: list[Level], fault: str, dry_run: bool) -> Search:
    """The search as it ends after its last level, by a `fault`, the accuracy, a plan or a limit."""
    if fault or (levels[-1].certified and not dry_run):
        return make_search(levels, fault)
    planned = make_plan(levels)
    # A plan ends a dry run, and a search that it shows to be hopeless
    if dry_run or is_hopeless(levels):
        missed = planned.missed if planned else ()
        names = f" ({', '.join(missed)})" if missed else ""
        reach = reachable_accuracy(levels) if missed else None
        return make_search(levels, "" if dry_run else f"{OUT_OF_REACH}{names}", plan=planned, reach=reach)
    # Else a limit does: the one that allows the fewest unknowns is named
    allowed = allowed_unknowns(levels)
    return make_search(
        levels, f"out of budget ({min(allowed, key=lambda name: allowed[name])})", plan=planned
    )


def make_first_mesh(polygon: Polygon, goal: Goal, coarsest: Mesh | None = None) -> AdaptedMesh:
    """The first mesh. Where all sides are short it is graded, if meshes may be so.

    If a `coarsest` one is given, it is that with all edges halved: boundary edges then come in pairs, and
    each pair is a cell, an edge of the coarsest mesh. Raises InputError if the first mesh has more unknowns
    than the goal allows, where possible before it is made.
    """
    kind = goal.kind or default_mesh_kind(polygon)
    H = float(polygon.lengths.max())
    max_unknowns = math.inf if goal.max_unknowns is None else goal.max_unknowns
    if coarsest is not None:
        # Halving adds a node on each edge; Euler: nodes - edges + triangles = 1 without holes
        n_nodes = 2 * coarsest.n_nodes + len(coarsest.triangles) - 1
        if n_nodes <= max_unknowns:
            return start_adapted_mesh(meshes.refine_uniformly(coarsest))
        raise _too_many_unknowns_error(polygon, str(n_nodes), max_unknowns)
    # Short sides need short edges, which need not go on inside: adapted meshes may be graded
    min_count = min_unknowns(polygon, H / 2)
    graded = min_count > MIN_ADAPTED_UNKNOWNS and kind == "unstructured" and goal.can_adapt
    if graded or min_count <= max_unknowns:
        mesh = make_edge_pair_mesh(polygon, H, kind, BOUNDARY_GROWTH if graded else None)
        if mesh.n_nodes <= max_unknowns:
            return start_adapted_mesh(mesh)
        needed = str(mesh.n_nodes)
    else:
        needed = f"at least {min_count:.2g}"
    raise _too_many_unknowns_error(polygon, needed, max_unknowns)


def _too_many_unknowns_error(polygon: Polygon, needed: str, max_unknowns: float) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; "
        f"max_unknowns={max_unknowns:.0f} has to be at least that"
    )


def make_edge_pair_mesh(polygon: Polygon, H: float, kind: str, growth: float | None = None) -> Mesh:
    """A mesh with two equal boundary edges, h = H/2, in every cell of the size H at most.

    With a `growth` triangles are larger the farther they are from the boundary.
    """
    if kind == "structured":
        return make_structured_cells(polygon, H, 2)[0]
    cells = partitions.balance_cells(partitions.make_uniform_partition(polygon, H))
    return meshes.triangulate_from_cells(cells, 2, growth=growth)[0]


def choose_division(levels: Sequence[Level], dry_run: bool = False) -> Division | None:
    """How to divide the triangles for the next level, None if it is not wanted or not within the limits.

    The levels have to be without a fault (`find_fault`). Where the limits do not allow the wanted division,
    the next level takes LIMIT_SHARE of what they allow, and is the last one.
    """
    last = levels[-1]
    if last.certified or (dry_run and show_costs(levels)) or is_hopeless(levels):
        return None
    target_division = choose_target_division(last)
    if NEIGHBOUR_RATIO * target_division.triangle_ratio * last.unknowns <= min(
        allowed_unknowns(levels).values()
    ):
        return target_division
    # the triangles that the limits allow, where the bound is largest; uniform meshes can only be quartered
    triangle_ratio = min(allowed_unknowns(levels, LIMIT_SHARE).values()) / (NEIGHBOUR_RATIO * last.unknowns)
    has_shares = 0 < last.solved.bound_shares.max() < math.inf
    if not (last.goal.can_adapt and has_shares) or triangle_ratio < MIN_TRIANGLE_RATIO:
        return None
    return divide_by_shares(last.solved.bound_shares, 0.0, triangle_ratio)


def discretise_level(
    mesh: AdaptedMesh, problem: Problem, goal: Goal, previous: DiscreteProblem | None, levels: Sequence[Level]
) -> DiscreteProblem:
    """The discrete problem on a mesh, from the previous one and the last solution, if there are any."""
    if wants_multigrid(goal.stop, math.inf):
        from unilateral.discrete.multilevel import MultilevelProblem, discretise_on_adapted_mesh  # and PyAMG

        assert isinstance(previous, MultilevelProblem | None)
        return discretise_on_adapted_mesh(problem, mesh, previous, levels[-1].solved if levels else None)
    check_condensing_memory(mesh.mesh, mesh.partition)
    condensed = discretise(problem, mesh.mesh, mesh.partition)
    if condensed.data is None:  # of a case, whose error is bounded, too, on every level
        condensed = replace(condensed, data=enclose_data(problem, mesh.mesh, condensed.form))
    return condensed


def solve_next_level(
    discrete: DiscreteProblem, goal: Goal, levels: Sequence[Level], predicted_total: float
) -> DiscreteSolution:
    """The solution, from that of the last level; its bound will be about as `predicted_total`.

    The algebraic bound is to be a tenth of the error that is wanted, or predicted if that is larger.
    """
    # The bound on lambda's algebraic error is that on u's over beta, so what it may be is times beta
    scale = 1.0 if goal.norm == "h1" else discrete.beta
    start = None
    tolerance = None
    total = math.inf
    if levels:
        # first by the norm of the last solution, as this one's is not known
        last = levels[-1]
        start = last.partition.means(last.solved.lambda_H, discrete.partition.points)[discrete.cells]
        scale /= last.width_per_error
        total = max(last.target, predicted_total)
        if math.isfinite(total):
            tolerance = RETRY_TOLERANCE_SHARE * ALGEBRAIC_SHARE * total * scale or None
    solved = discrete.iterate(tolerance, goal.stop, start, total)
    if levels:
        # then by the norm of this solution; of a force the last level knows enough
        target = last.target
        if not last.force:
            size = solved.norm_lower_bound(goal.norm, goal.sharp)
            target = target_error(goal, size, discrete_norm(solved, goal))
        max_bound = ALGEBRAIC_SHARE * max(target, predicted_total) * scale
        if max_bound > 0:
            solved = discrete.improve(solved, max_bound, goal.stop)
    return solved
