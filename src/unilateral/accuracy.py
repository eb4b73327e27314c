"""A stated accuracy, certified at the least cost for H = 2h: solves from coarse to fine.

Other ratios, which might cost less, are not tried. Each level starts from the last lambda_H, and is iterated
until the algebraic bound is a tenth of the error that is wanted. The first level whose guaranteed total bound
is small enough is the last. The search also ends where finer meshes would not help, because too little is
known of f or g.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unilateral.bounds.total import SUMS
from unilateral.discrete import AIM, FIRST, Bounded, discretise, improved
from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import NAMED, Polygon
from unilateral.problems.case import Case
from unilateral.problems.problem import Problem
from unilateral.solve import Stop, iterate

Array = NDArray[np.float64]
SHARE = 0.1
"""Of the error that is wanted: what the iteration may contribute."""
MARGIN = 0.9
"""Of the error that is wanted: what the next level aims at."""
LEAST_STEP, LARGEST_STEP = 1.25, 4.0
"""Between the sizes of two levels."""
RATES = (0.25, 2.0)
"""Within which an observed rate is believed."""
LARGEST_BOUNDARY = 4096
"""Boundary nodes, whose Schur complement is a dense matrix."""
GUESS = 1.05
"""More unknowns than h^-2 predicts, which gmsh may make."""
SAFE = 0.5
"""Below 2 / sqrt(3), the unknowns on equilateral triangles of the size h, times h^2 over the area."""
GROWTH = 1.3
"""Seconds grow like the unknowns to this power, at most."""


@dataclass(frozen=True)
class Goal:
    """A relative accuracy in a norm, "h1" of u or "hm12" of lambda, and what may be spent on it."""

    accuracy: float
    norm: str = "h1"
    max_unknowns: int = 100_000
    max_seconds: float = math.inf


@dataclass(frozen=True, eq=False)
class Level:
    """One solve; `target` is the error that is wanted, as far as this level knows the solution's norm.

    `seconds` counts its mesh, too.
    """

    solved: Bounded
    target: float
    certified: bool
    seconds: float

    @property
    def partition(self) -> Partition:
        return self.solved.discrete.both.partition

    @property
    def unknowns(self) -> int:
        return self.solved.discrete.mesh.n_nodes


def levels(
    problem: Case | Problem, goal: Goal, free: Sequence[int] = (), stop: Stop | None = None, kind: str = ""
) -> Iterator[Level]:
    """The levels as they are solved; the last one is certified, or the budget does not allow another.

    `free` sides have no multipliers, beside a problem's own. `kind` is that of the meshes, "structured" or
    "unstructured", by default the first where there is one. Raises InputError if the coarsest mesh has more
    unknowns than the goal allows, or, perhaps after some levels, a mesh cannot be made.
    """
    stop = stop or Stop()
    kind = kind or natural_kind(problem.polygon)
    begin = time.perf_counter()
    done: list[Level] = []
    H: float | None = float(problem.polygon.lengths.max())
    while H is not None:
        start = time.perf_counter()
        partition = partitions.uniform(problem.polygon, _nested(problem.polygon, H, kind))
        if 2 * partition.n_cells > LARGEST_BOUNDARY:
            raise InputError(
                f"'{problem.polygon.name}' needs {2 * partition.n_cells} boundary nodes for H = {H:.4g}; at "
                f"most {LARGEST_BOUNDARY} are possible, so take fewer sides"
            )
        expected = SAFE * problem.polygon.area / (partition.H / 2) ** 2
        if not done and expected > goal.max_unknowns:
            raise _too_many(problem.polygon, f"at least {expected:.2g}", goal)
        mesh = two_edges_per_cell(partition, kind)
        if mesh.n_nodes > goal.max_unknowns:
            break
        done.append(_solved(problem, mesh, partition, goal, free, stop, done[-1] if done else None, start))
        yield done[-1]
        H = _next_H(done, goal, time.perf_counter() - begin)
    if not done:
        raise _too_many(problem.polygon, str(mesh.n_nodes), goal)


def standing(done: Sequence[Level]) -> list[Level]:
    """The levels but those whose bounds a finer one contradicts, which are false and not to be used."""
    return [
        level for k, level in enumerate(done) if not any(contradict(level, finer) for finer in done[k + 1 :])
    ]


def contradict(a: Level, b: Level) -> bool:
    """Whether two levels' bounds cannot both hold: for ||u||_1, the integral of u or that of lambda.

    |int v| <= |Omega|^{1/2} ||v||_1, and |<mu, 1>| <= |Omega|^{1/2} ||mu||_{-1/2}.
    """
    root = math.sqrt(a.partition.polygon.area)
    of_u, of_lambda = (a.solved.total(norm) + b.solved.total(norm) for norm in ("h1", "hm12"))
    apart = (
        (a.solved.u_norm, b.solved.u_norm, of_u),
        (a.solved.u_integral, b.solved.u_integral, root * of_u),
        (a.solved.force, b.solved.force, root * of_lambda),
    )
    return any(abs(x - y) > (1 + SUMS) * bound + SUMS * max(abs(x), abs(y)) for x, y, bound in apart)


def _too_many(polygon: Polygon, needed: str, goal: Goal) -> InputError:
    return InputError(
        f"the coarsest mesh of '{polygon.name}' needs {needed} unknowns; --max-unknowns {goal.max_unknowns} "
        "has to be at least that"
    )


def _nested(polygon: Polygon, H: float, kind: str) -> float:
    """H, or on structured meshes the next smaller one whose cells consist of whole edges.

    There all sides are multiples of the first one.
    """
    return float(polygon.lengths[0] / polygon.counts(H)[0]) if kind == "structured" else H


def natural_kind(polygon: Polygon) -> str:
    """The kind of mesh that a polygon gets if nobody asks for another one."""
    named = any(np.array_equal(polygon.vertices, make().vertices) for make in NAMED.values())
    return "structured" if named else "unstructured"


def two_edges_per_cell(partition: Partition, kind: str) -> Mesh:
    """A mesh with two equal boundary edges in every cell, h = H/2."""
    if kind == "structured":
        return meshes.structured(partition.polygon, partition.H / 2)
    return meshes.with_boundary(partition.polygon, partitions.refine(partition).points[:-1])


def prolonged(lambda_H: Array, partition: Partition, finer: Partition) -> Array:
    """(m,) means on the cells of another partition of lambda_H, which is constant on those of the first."""
    integral = np.append(0.0, np.cumsum(partition.lengths * lambda_H))
    return np.diff(np.interp(finer.points, partition.points, integral)) / finer.lengths


def next_H(sizes: Sequence[float], bounds: Sequence[float], target: float) -> float:
    """The next level's H from those of the levels done and their bounds: where it should meet the target.

    Bounds are taken to fall at the rate of the last two; without two of them, or a target, H is halved.
    """
    H, bound = sizes[-1], bounds[-1]
    if len(sizes) < 2 or target <= 0 or not (math.isfinite(bounds[-2]) and math.isfinite(bound)):
        return H / 2
    observed = math.log(bounds[-2] / bound) / math.log(sizes[-2] / H)
    wanted = H * (MARGIN * target / bound) ** (1 / min(max(observed, RATES[0]), RATES[1]))
    return min(max(wanted, H / LARGEST_STEP), H / LEAST_STEP)


def _solved(
    problem: Case | Problem,
    mesh: Mesh,
    partition: Partition,
    goal: Goal,
    free: Sequence[int],
    stop: Stop,
    before: Level | None,
    begin: float,
) -> Level:
    discrete = discretise(problem, mesh, partition, free)
    in_norm = discrete.beta if goal.norm == "hm12" else 1.0
    start, tolerance = None, FIRST * discrete.first_residual
    if before is not None:
        start = prolonged(before.solved.lambda_H, before.partition, partition)[discrete.both.cells]
        if math.isfinite(before.solved.total(goal.norm)):
            tolerance = AIM * SHARE * before.target * in_norm or tolerance
    solved = discrete.bounded(iterate(discrete.both.operator, discrete.offset, tolerance, stop, start))
    solved = improved(solved, SHARE * _target(solved, goal) * in_norm, stop)
    certified = solved.total(goal.norm) <= goal.accuracy * solved.size(goal.norm) and solved.algebraic(
        goal.norm
    ) <= SHARE * goal.accuracy * solved.size(goal.norm)
    return Level(solved, _target(solved, goal), certified, time.perf_counter() - begin)


def _target(solved: Bounded, goal: Goal) -> float:
    """The error that is wanted: of the norm's lower bound or, where that is 0, of the discrete norm."""
    size = solved.u_norm if goal.norm == "h1" else solved.lambda_norm
    return goal.accuracy * (solved.size(goal.norm) or size)


def _next_H(done: Sequence[Level], goal: Goal, seconds: float) -> float | None:
    """The next level's H within the budget, or None."""
    last, in_time = done[-1], _in_time(done[-1], goal, seconds)
    if last.certified or in_time == math.inf or not last.solved.result.converged or unknowable(last):
        return None
    H, believed = last.partition.H, standing(done)
    totals = [level.solved.total(goal.norm) for level in believed]
    wanted = next_H([level.partition.H for level in believed], totals, last.target)
    affordable = H * max(*_shares(last, goal).values(), in_time)
    if LEAST_STEP * affordable > H:
        return None
    return max(wanted, affordable)


def unknowable(last: Level) -> bool:
    """Whether what is not known of f and g, and would not be on finer meshes, is more than what is wanted."""
    return last.solved.bound.irreducible > last.target > 0


def _shares(last: Level, goal: Goal) -> dict[str, float]:
    """Of the limits to sizes, the part of a level's H to which each allows the next one to go down."""
    return {
        f"--max-unknowns {goal.max_unknowns}": math.sqrt(GUESS * last.unknowns / goal.max_unknowns),
        f"{LARGEST_BOUNDARY} boundary nodes": len(last.solved.discrete.mesh.boundary) / LARGEST_BOUNDARY,
    }


def _in_time(last: Level, goal: Goal, seconds: float) -> float:
    """The same for the time that is left."""
    left = goal.max_seconds - seconds
    return float((last.seconds / left) ** (0.5 / GROWTH)) if left > 0 else math.inf


def limits(done: Sequence[Level], goal: Goal) -> list[str]:
    """Those that do not allow a level after these."""
    found = [name for name, share in _shares(done[-1], goal).items() if LEAST_STEP * share > 1]
    if LEAST_STEP * _in_time(done[-1], goal, sum(level.seconds for level in done)) > 1:
        found.append(f"--max-seconds {goal.max_seconds:g}")
    return found or [f"--max-unknowns {goal.max_unknowns}"]
