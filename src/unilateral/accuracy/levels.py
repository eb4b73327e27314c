"""Solves from coarse to fine with H = 2h, up to a stated accuracy.

Other ratios, which might cost less, are not tried. Meshes are uniform until, by the bounds so far, it pays to
go on with meshes that are refined only where the bound comes from. Each level starts from the last lambda_H,
or by multigrid from its own coarser levels, and is iterated until the algebraic bound is a tenth of the error
that is wanted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from unilateral.accuracy.budget import SPARE, affordable, affordable_H, bulk, wanted
from unilateral.accuracy.cost import Prospect, may_adapt
from unilateral.accuracy.goal import Goal
from unilateral.accuracy.level import ENOUGH, SHARE, Level, least_unknowns, target
from unilateral.accuracy.watch import ENCLOSING, Watch
from unilateral.bounds.source import enclosed
from unilateral.choice import cheapest, levels_for
from unilateral.discrete_solution import AIM, AnyDiscrete
from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import adapted, marked, refined
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import natural_kind, structured
from unilateral.memory import available_mb, forget_peak, peak_mb
from unilateral.multilevel import after
from unilateral.problems.data import Data
from unilateral.solvers.stop import Stop

GROWTH = 0.4
"""Of triangles, over their distance from a boundary of many short sides; faster, and gmsh makes flat ones."""


def levels(
    problem: Data, goal: Goal, stop: Stop | None = None, kind: str = "", watch: Watch | None = None
) -> Iterator[Level]:
    """The levels as they are solved; the last one is certified, or the budget does not allow another.

    `kind` is that of the meshes, "structured" or "unstructured". By default these are uniform, of the first
    kind where there is one, until it pays to refine only where it is needed. Raises InputError if the
    coarsest mesh has more unknowns than the goal allows, or, perhaps after some levels, a mesh cannot be
    made; OutOfBudget if a limit is reached in the midst of a level.
    """
    stop, watch, done = stop or Stop(), watch or Watch(), list[Level]()
    forget_peak()
    watch.goal, watch.most_mb = goal, peak_mb() + SPARE * available_mb()
    for level in _uniform(problem, goal, stop, kind, done, watch):
        yield level
        if Prospect(done, stop, kind, watch.elapsed).adapted:
            yield from _adapted(problem, stop, done, watch)
            return


def _uniform(
    problem: Data, goal: Goal, stop: Stop, kind: str, done: list[Level], watch: Watch
) -> Iterator[Level]:
    """Those on uniform meshes, which are appended to what is `done`."""
    polygon, made = problem.polygon, kind or natural_kind(problem.polygon)
    H: float | None = float(polygon.lengths.max())
    expected = least_unknowns(polygon, polygon.lengths.max() / 2)
    graded = expected > ENOUGH and made == "unstructured" and may_adapt(stop, kind)
    if not graded and expected > goal.unknowns:
        raise _too_many(polygon, f"at least {expected:.2g}", goal)
    while H is not None:
        watch.begin_level()
        mesh, partition = coarsest(polygon, H) if graded else two_edges_per_cell(polygon, H, made, stop)
        if mesh.n_nodes > goal.unknowns:
            break
        if done:
            watch.expected = Prospect(done, stop, kind, watch.elapsed).seconds(mesh.n_nodes)
        watch.at("matrices", mesh.n_nodes)
        discrete = cheapest(problem, mesh, partition, stop)
        watch.at(ENCLOSING)
        if discrete.source is None:
            discrete = replace(discrete, source=enclosed(mesh, problem))
        done.append(_solved(discrete, goal, stop, done[-1] if done else None, watch))
        yield done[-1]
        H = affordable_H(Prospect(done, stop, kind, watch.elapsed))
    if not done:
        raise _too_many(polygon, str(mesh.n_nodes), goal)


def _adapted(problem: Data, stop: Stop, done: list[Level], watch: Watch) -> Iterator[Level]:
    """The same on meshes that are refined from the last one where its bound comes from."""
    of = adapted(done[-1].solved.discrete.mesh)
    while wanted(done):
        last, prospect = done[-1], Prospect(done, stop, "", watch.elapsed)
        watch.begin_level()
        of = refined(of, marked(of.mesh, last.solved.shares, bulk(last)))
        if not affordable(prospect, of.mesh.n_nodes):
            return
        watch.expected = prospect.seconds(of.mesh.n_nodes)
        watch.at(ENCLOSING, of.mesh.n_nodes)
        discrete = after(last.solved, problem, of)
        done.append(_solved(discrete, last.goal, stop, last, watch))
        yield done[-1]


def _too_many(polygon: Polygon, needed: str, goal: Goal) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; "
        f"max_unknowns={goal.unknowns:.0f} has to be at least that"
    )


def two_edges_per_cell(polygon: Polygon, H: float, kind: str, stop: Stop) -> tuple[Mesh, Partition]:
    """A mesh with two equal boundary edges, h = H/2, in every cell, and the cells, of the size H at most."""
    halvings = levels_for(polygon, H, 2, stop)
    if kind == "structured":  # the next smaller H whose cells consist of whole edges, on all these levels
        H = 1 / (math.ceil(square().counts(H)[0] / 2**halvings) * 2**halvings)
        return structured(polygon, H / 2), partitions.uniform(polygon, H)
    return meshes.following(_cells(polygon, 2**halvings * H), 2, halvings)


def coarsest(polygon: Polygon, H: float) -> tuple[Mesh, Partition]:
    """The same with triangles that grow with the distance from the boundary, where all sides are short."""
    return meshes.following(_cells(polygon, H), 2, growth=GROWTH)


def _cells(polygon: Polygon, H: float) -> Partition:
    return partitions.balanced(partitions.uniform(polygon, H))


def _solved(discrete: AnyDiscrete, goal: Goal, stop: Stop, before: Level | None, watch: Watch) -> Level:
    in_norm = 1.0 if goal.norm == "h1" else discrete.beta
    start, tolerance = None, None
    if before is not None:
        start = before.partition.means(before.solved.lambda_H, discrete.partition.points)[discrete.cells]
        if math.isfinite(before.total):
            tolerance = AIM * SHARE * before.target * in_norm or None
    watch.at("solve")
    total = before.total if before else math.inf
    solved = discrete.iterated(tolerance, stop, start, total)
    watch.at("bound")
    if (wanted := SHARE * target(solved, goal) * in_norm) > 0:
        solved = solved.improved(wanted, stop)
    solved.bound(goal.sharp)  # its time counts, too
    seconds = watch.end_level()
    return Level(solved, goal, sum(seconds.values()), peak_mb(), seconds[ENCLOSING])
