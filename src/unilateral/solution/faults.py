"""What a solution has less of than was wanted, in sentences; and the warnings of that."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING

import numpy as np

from unilateral.adaptive.loop import WITHDRAWN, Search
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import SolutionWarning, counted
from unilateral.formulas.decimals import interval, up
from unilateral.geometry.mesh import Mesh
from unilateral.solution.bounds import relative, sizes, too_large

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

FLAT = 10.0
"""The cheap bound is a good one on triangles that are at most this many times as long as high.

It is 1.9 times the error then if u varies across them only, and for flatter ones the factor grows in
proportion: the error is like their height, but the flux of `equilibrated` is off by their length.
"""
ENDED_BY_ROUNDING = ("active_set", "multigrid")
"""Algorithms that end where nothing falls any more, and not after `max_steps`."""


def not_unique(mesh: Mesh, own: bool) -> str:
    """Says that lambda_H may not be unique, and how to mend that; a mesh of the user's `own` has no h."""
    shortest = float(mesh.polygon.lengths.min())
    advice = "take h < H, such as H = 2h"
    alone = np.bincount(mesh.side) == 1
    if own and alone.any():
        advice = (
            f"a side of the polygon needs two edges of the mesh or more, and side {alone.argmax()} is one; "
            "take ul.mesh(mesh, halvings=1)"
        )
    elif own:
        advice = "take larger cells, or refine the mesh at the boundary"
    elif mesh.h >= shortest:  # whatever h and H were asked for
        advice = f"a side of the length {shortest:.4g} is one edge; take h <= {shortest / 2:.4g} and H = 2h"
    return f"may not be unique, because beta is 0 up to rounding; {advice}"


def flat_triangles(solved: DiscreteSolution) -> str:
    """Says that flat triangles make up most of the cheap bound; else empty."""
    bound = solved.local_bound
    mesh = solved.mesh
    if bound is None:
        return ""
    flatness = mesh.longest_edges**2 / (2 * mesh.areas)  # the longest edge over the height on it
    flat = flatness > FLAT
    if not bound.shares[flat].sum() > 0.5 * bound.shares.sum():
        return ""
    return (
        "most of the bound on the error comes from triangles that are up to "
        f"{flatness.max():.0f} times as long as high, where it may be far above the error; try --sharp, or "
        "other triangles"
    )


def lift_dominates(solution: Solution) -> str:
    """Says of another program's u that most of its bound is what makes it admissible; else empty."""
    if not solution.solved.foreign or too_large(solution, sharp=False):
        return ""
    bound = solution.bounded.local_bound
    if bound is None or bound.lifting**2 <= 0.5 * bound.u**2:
        return ""
    return (
        "most of the bound on the error of u is for u < g, or for other values than the given ones on "
        "clamped sides; larger penalty parameters, or conditions at the nodes, would make it smaller"
    )


def not_converged(solved: DiscreteSolution) -> str:
    """Says that an iteration did not converge, with the bound on its algebraic error, and why."""
    result = solved.result
    bound = interval(-math.inf, result.bound, spec=".4e")
    told = f"the iteration did not converge: the algebraic error is {bound}"
    if 2 * result.rounding > result.bound:
        return f"{told}, because rounding alone adds {up(result.rounding, '.1e')}; take a larger tolerance"
    if result.algorithm in ENDED_BY_ROUNDING:
        return f"{told}, because rounding allows no less; take a larger tolerance"
    steps = counted(int(result.iterations), "step")
    return f"{told} after {steps}; allow more of them, or take another algorithm"


def tell_faults(found: Solution, own_mesh: bool = False) -> None:
    """Warns, two calls above, of what is less than what was wanted, or may be."""
    search = found.search
    if search and len(search.believed) < len(search.levels):
        withdrawn = f"{len(search.levels) - len(search.believed)} bounds {WITHDRAWN}"
        warnings.warn(withdrawn, SolutionWarning, stacklevel=3)
    if search and not search.certified:
        warnings.warn(not_certified(search, found), SolutionWarning, stacklevel=3)
        return
    if not found.converged:
        warnings.warn(not_converged(found.solved), SolutionWarning, stacklevel=3)
    if not found.unique:
        warnings.warn(f"lambda_H {not_unique(found.mesh, own_mesh)}", SolutionWarning, stacklevel=3)
    if reason := lift_dominates(found):
        warnings.warn(reason, SolutionWarning, stacklevel=3)


def not_certified(search: Search, found: Solution) -> str:
    """Why the accuracy is not certified, and what is reached: in the same terms, and as an error."""
    best = search.best
    parts = [f"the accuracy {best.goal.accuracy:g} is not certified: {search.ended}"]
    if not search.believed:
        parts.append("no bound is left")
    elif not best.total < math.inf:
        parts.append("no bound is known")
    elif best.goal.absolute or not best.size > 0:
        parts.append(f"reached is {up(best.total, '.4e')}")
    else:
        share = up(relative(best.total, best.size), ".3g")
        size = getattr(sizes(found.problem), best.goal.norm)
        parts.append(f"reached is {share} of {size}, or {up(best.total, '.4e')}")
    if search.refusal:
        parts.append(str(search.refusal))
    if search.reach:
        parts.append(f"an accuracy of {search.reach:g} is within reach")
    return "; ".join(parts)
