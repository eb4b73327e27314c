"""Solves from coarse to fine with H = 2h, up to a stated accuracy.

Other ratios, which might cost less, are not tried. Each mesh is a refinement of the one before, uniform or
where the bound comes from, see `next_level.division`. Each level starts from the last u_h and lambda_H, and
is iterated until the algebraic bound is a tenth of the error that is wanted, or that is predicted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from unilateral.accuracy.cost import Prospect, may_adapt
from unilateral.accuracy.goal import Goal
from unilateral.accuracy.level import ENOUGH, SHARE, Level, least_unknowns, target
from unilateral.accuracy.next_level import SPARE, division
from unilateral.accuracy.watch import ENCLOSING, Watch
from unilateral.bounds.source import enclosed
from unilateral.discrete.base import AIM, DiscreteProblem, DiscreteSolution
from unilateral.discrete.choice import condensed, wants_multigrid
from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import AdaptedMesh, adapted, divided
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import natural_kind, structured
from unilateral.problems.data import Data
from unilateral.solvers.stop import Stop
from unilateral.system.memory import available_mb, forget_peak, peak_mb

GROWTH = 0.4
"""Where all sides are short, triangles grow by this factor times their distance from the boundary.

If they grow faster, gmsh makes flat ones.
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
    of, predicted = _first(problem.polygon, goal, kind, may_adapt(stop, kind)), math.inf
    while True:
        prospect = Prospect(done, stop, kind, watch.elapsed)
        watch.expected = prospect.seconds(of.mesh.n_nodes) if done else 0.0
        watch.at("matrices", of.mesh.n_nodes)
        watch.at(ENCLOSING)
        discrete = _on(problem, of, stop, done[-1].solved if done else None)
        done.append(_solved(discrete, goal, stop, done, predicted, watch))
        yield done[-1]
        following = division(Prospect(done, stop, kind, watch.elapsed))
        if following is None:
            return
        predicted = following.left * done[-1].total
        watch.begin_level()
        of = divided(of, following.halvings)


def _first(polygon: Polygon, goal: Goal, kind: str, free: bool) -> AdaptedMesh:
    """The coarsest mesh. Where all sides are short it is graded, if meshes are `free` to be so.

    Raises InputError as `levels`.
    """
    made, H = kind or natural_kind(polygon), float(polygon.lengths.max())
    expected = least_unknowns(polygon, H / 2)
    graded = expected > ENOUGH and made == "unstructured" and free
    if not graded and expected > goal.unknowns:
        raise _too_many(polygon, f"at least {expected:.2g}", goal)
    mesh = coarsest(polygon, H) if graded else two_edges_per_cell(polygon, H, made)
    if mesh.n_nodes > goal.unknowns:
        raise _too_many(polygon, str(mesh.n_nodes), goal)
    return adapted(mesh)


def _on(problem: Data, of: AdaptedMesh, stop: Stop, last: DiscreteSolution | None) -> DiscreteProblem:
    """The discrete problem on a mesh, from the solution on the one before, if there is one."""
    if wants_multigrid(stop, math.inf):
        from unilateral.discrete.multilevel import after  # and with it PyAMG

        return after(last, problem, of)
    found = condensed(problem, of.mesh, of.partition)
    return found if found.source else replace(found, source=enclosed(of.mesh, problem))


def _too_many(polygon: Polygon, needed: str, goal: Goal) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; "
        f"max_unknowns={goal.unknowns:.0f} has to be at least that"
    )


def two_edges_per_cell(polygon: Polygon, H: float, kind: str) -> Mesh:
    """A mesh with two equal boundary edges, h = H/2, in every cell of the size H at most."""
    if kind == "structured":  # the next smaller H whose cells consist of whole edges
        return structured(polygon, 0.5 / square().counts(H)[0])
    return meshes.following(_cells(polygon, H), 2)[0]


def coarsest(polygon: Polygon, H: float) -> Mesh:
    """A mesh with two boundary edges per cell, for domains with short sides only.

    Its triangles grow with the distance from the boundary.
    """
    return meshes.following(_cells(polygon, H), 2, growth=GROWTH)[0]


def _cells(polygon: Polygon, H: float) -> Partition:
    return partitions.balanced(partitions.uniform(polygon, H))


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
    if done and (wanted := SHARE * max(target(solved, goal), predicted) * in_norm) > 0:
        solved = solved.improved(wanted, stop)
    solved.bound(goal.sharp)  # its time counts, too
    seconds = watch.end_level()
    return Level(solved, goal, sum(seconds.values()), peak_mb(), seconds[ENCLOSING], predicted)
