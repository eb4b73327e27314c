"""A stated accuracy, certified at the least cost for H = 2h: solves from coarse to fine.

Other ratios, which might cost less, are not tried. Meshes are uniform until, by the bounds so far, it pays to
go on with meshes that are refined only where the bound comes from. Each level starts from the last lambda_H,
or by multigrid from its own coarser levels, and is iterated until the algebraic bound is a tenth of the error
that is wanted.

The first level whose guaranteed total bound is small enough is the last. The search also ends where finer
meshes would not help, because too little is known of f or g, and where two levels' bounds contradict each
other, which would be a fault of this program.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

from unilateral.accuracy.budget import affordable, affordable_H, bulk, refinement_pays, wanted
from unilateral.accuracy.level import SHARE, Goal, Level, standing, target
from unilateral.adapted import adapted as on_adapted
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
from unilateral.memory import forget_peak, peak_mb
from unilateral.problems.data import Data
from unilateral.solvers.iterate import Stop

INTERRUPTED = "interrupted"
CONTRADICTED = "bounds contradict each other"
NOT_CONVERGED = "the iteration did not converge (max_steps=, rho=, algorithm=)"
SAFE = 0.5
"""Below 2 / sqrt(3), the unknowns on equilateral triangles of the size h, times h^2 over the area."""


@dataclass(frozen=True, eq=False)
class Search:
    """The levels done, and what ended the search before the budget did, if anything."""

    done: list[Level]
    ended: str
    refusal: InputError | None = None

    @cached_property
    def believed(self) -> list[Level]:
        """The levels that no other one contradicts."""
        return standing(self.done)

    @cached_property
    def best(self) -> Level:
        """The last of these that is certified, or the one with the smallest bound; of none the finest."""
        candidates = reversed(self.believed or self.done[-1:])
        return min(candidates, key=lambda level: (not level.certified, level.total))

    @property
    def certified(self) -> bool:
        return bool(self.believed) and self.best.certified


def search(
    problem: Data,
    goal: Goal,
    stop: Stop | None = None,
    kind: str = "",
    tell: Callable[[Level], None] | None = None,
) -> Search:
    """All `levels`, of each of which `tell` is told; an interrupt after the first one keeps what was found.

    Raises InputError and KeyboardInterrupt only before the first level is done.
    """
    done: list[Level] = []
    try:
        for level in levels(problem, goal, stop, kind):
            done.append(level)
            if tell:
                tell(level)
    except (KeyboardInterrupt, InputError) as stopped:
        if not done:
            raise
        if isinstance(stopped, InputError):
            return Search(done, "the next level is refused", stopped)
        return Search(done, INTERRUPTED)
    if len(standing(done)) < len(done):
        return Search(done, CONTRADICTED)
    diverged = not (done[-1].certified or done[-1].solved.result.converged)
    return Search(done, NOT_CONVERGED if diverged else "")


def levels(problem: Data, goal: Goal, stop: Stop | None = None, kind: str = "") -> Iterator[Level]:
    """The levels as they are solved; the last one is certified, or the budget does not allow another.

    `kind` is that of the meshes, "structured" or "unstructured". By default these are uniform, of the first
    kind where there is one, until it pays to refine only where it is needed. Raises InputError if the
    coarsest mesh has more unknowns than the goal allows, or, perhaps after some levels, a mesh cannot be
    made.
    """
    stop, done, begin = stop or Stop(), list[Level](), time.perf_counter()
    free = not kind and stop.algorithm == "auto" and stop.rho is None
    for level in _uniform(problem, goal, stop, kind or natural_kind(problem.polygon), done, begin):
        yield level
        if free and refinement_pays(level):
            yield from _adapted(problem, stop, done, begin)
            return


def _uniform(
    problem: Data, goal: Goal, stop: Stop, kind: str, done: list[Level], begin: float
) -> Iterator[Level]:
    """Those on uniform meshes, which are appended to what is `done` since the time `begin`."""
    H: float | None = float(problem.polygon.lengths.max())
    while H is not None:
        start = time.perf_counter()
        expected = SAFE * problem.polygon.area / (H / 2) ** 2
        if not done and expected > goal.max_unknowns:
            raise _too_many(problem.polygon, f"at least {expected:.2g}", goal)
        mesh, partition = two_edges_per_cell(problem.polygon, H, kind, stop)
        if mesh.n_nodes > goal.max_unknowns:
            break
        forget_peak()
        discrete = cheapest(problem, mesh, partition, stop)
        done.append(_solved(discrete, goal, stop, done[-1] if done else None, start))
        yield done[-1]
        H = affordable_H(done, time.perf_counter() - begin)
    if not done:
        raise _too_many(problem.polygon, str(mesh.n_nodes), goal)


def _adapted(problem: Data, stop: Stop, done: list[Level], begin: float) -> Iterator[Level]:
    """The same on meshes that are refined from the last one where its bound comes from."""
    of = adapted(done[-1].solved.discrete.mesh)
    while wanted(done):
        last, start = done[-1], time.perf_counter()
        of, u = refined(of, marked(of.mesh, last.solved.shares, bulk(last)), last.solved.u_h)
        if not affordable(last, of.mesh.n_nodes, start - begin):
            return
        forget_peak()
        discrete = on_adapted(problem, of, u, last.solved.discrete.source)
        done.append(_solved(discrete, last.goal, stop, last, start))
        yield done[-1]


def _too_many(polygon: Polygon, needed: str, goal: Goal) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; "
        f"max_unknowns={goal.max_unknowns:.0f} has to be at least that"
    )


def two_edges_per_cell(polygon: Polygon, H: float, kind: str, stop: Stop) -> tuple[Mesh, Partition]:
    """A mesh with two equal boundary edges, h = H/2, in every cell, and the cells, of the size H at most."""
    halvings = levels_for(polygon, H / 2, stop)
    if kind == "structured":  # the next smaller H whose cells consist of whole edges, on all these levels
        H = 1 / (math.ceil(square().counts(H)[0] / 2**halvings) * 2**halvings)
        return structured(polygon, H / 2), partitions.uniform(polygon, H)
    return meshes.following(partitions.uniform(polygon, 2**halvings * H), 2, halvings)


def _solved(discrete: AnyDiscrete, goal: Goal, stop: Stop, before: Level | None, begin: float) -> Level:
    in_norm = 1.0 if goal.norm == "h1" else discrete.beta
    start, tolerance = None, None
    if before is not None:
        start = before.partition.means(before.solved.lambda_H, discrete.partition.points)[discrete.cells]
        if math.isfinite(before.total):
            tolerance = AIM * SHARE * before.target * in_norm or None
    solved = discrete.iterated(tolerance, stop, start)
    solved = solved.improved(SHARE * target(solved, goal) * in_norm, stop)
    solved.bound(goal.sharp)  # its time counts, too
    return Level(solved, goal, time.perf_counter() - begin, peak_mb())
