"""Sentences on where a solution falls short: accuracy, convergence, uniqueness, sharpness; and warnings."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING

import numpy as np

from unilateral.adaptive.loop import BOUNDS_WITHDRAWN, Search
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import SolutionWarning, pluralise
from unilateral.formulas.decimals import format_interval, format_up
from unilateral.geometry.mesh import Mesh
from unilateral.solution.bounds import explain_memory_shortage, name_solution_norms, relative_bound

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

MAX_CHEAP_BOUND_ASPECT = 10.0
"""The cheap bound is a good one on triangles that are at most this many times as long as high.

It is 1.9 times the error then if u varies across them only, and for flatter ones the factor grows in
proportion: the error is like their height, but the flux of `equilibrate_flux` is off by their length.
"""
ROUNDING_LIMITED_ALGORITHMS = ("active_set", "multigrid")
"""Algorithms that end where their residual falls no more, and not after `max_steps`."""


def explain_nonuniqueness(mesh: Mesh, is_user_mesh: bool) -> str:
    """End of a sentence on lambda_H: that it may not be unique, and how to mend that."""
    shortest = float(mesh.polygon.lengths.min())
    advice = "take h < H, such as H = 2h"
    is_single_edge = np.bincount(mesh.side) == 1
    if is_user_mesh and is_single_edge.any():
        advice = (
            "a side of the polygon needs two edges of the mesh or more, and "
            f"side {is_single_edge.argmax()} is one; take ul.mesh(mesh, halvings=1)"
        )
    elif is_user_mesh:
        advice = "take larger cells, or refine the mesh at the boundary"
    elif mesh.h >= shortest:  # whatever h and H were asked for
        advice = f"a side of the length {shortest:.4g} is one edge; take h <= {shortest / 2:.4g} and H = 2h"
    return f"may not be unique, because beta is 0 up to rounding; {advice}"


def explain_flat_triangles(solved: DiscreteSolution) -> str:
    """Sentence that flat triangles make up most of the square of the cheap bound; else empty."""
    bound = solved.local_bound
    mesh = solved.mesh
    if bound is None:
        return ""
    flatness = mesh.longest_edges**2 / (2 * mesh.areas)  # the longest edge over the height on it
    flat = flatness > MAX_CHEAP_BOUND_ASPECT
    if not bound.shares[flat].sum() > 0.5 * bound.shares.sum():
        return ""
    return (
        "most of the bound on the error comes from triangles that are up to "
        f"{flatness.max():.0f} times as long as high; on such triangles the bound may be far above the "
        "error; try --sharp, or other triangles"
    )


def explain_dominant_lift(solution: Solution) -> str:
    """Sentence that most of the bound on another program's u is the lift that takes it into K; else empty."""
    if not solution.solved.is_foreign or explain_memory_shortage(solution, sharp=False):
        return ""
    bound = solution.bounded.local_bound
    # ||u - u_h|| <= ||u - v|| + ||v - u_h||, with the lift v - u_h
    if bound is None or bound.lift_norm**2 <= 0.5 * bound.u**2:
        return ""
    return (
        "most of the bound on the error of u comes from places where u < g, or where u differs from the "
        "given values on clamped sides; larger penalty parameters, or conditions at the nodes, would reduce "
        "the bound"
    )


def explain_nonconvergence(solved: DiscreteSolution) -> str:
    """Sentence that an iteration did not converge, with the bound on its algebraic error, and why."""
    result = solved.result
    bound = format_interval(-math.inf, result.bound, spec=".4e")
    failure = f"the iteration did not converge: the algebraic error is {bound}"
    if 2 * result.rounding > result.bound:
        rounding = format_up(result.rounding, ".1e")
        return f"{failure}, because rounding alone adds {rounding}; take a larger tolerance"
    if result.algorithm in ROUNDING_LIMITED_ALGORITHMS:
        return f"{failure}, because rounding allows no less; take a larger tolerance"
    steps = pluralise(int(result.iterations), "step")
    return f"{failure} after {steps}; allow more steps, or take another algorithm"


def warn_of_shortfalls(solution: Solution, is_user_mesh: bool = False) -> None:
    """Warns, two calls above, of withdrawn bounds, a missed accuracy, or doubts about the iteration."""
    search = solution.search
    if search and len(search.believed) < len(search.levels):
        withdrawn = f"{len(search.levels) - len(search.believed)} bounds {BOUNDS_WITHDRAWN}"
        warnings.warn(withdrawn, SolutionWarning, stacklevel=3)
    if search and not search.certified:
        warnings.warn(explain_missed_accuracy(search, solution), SolutionWarning, stacklevel=3)
        return
    if not solution.converged:
        warnings.warn(explain_nonconvergence(solution.solved), SolutionWarning, stacklevel=3)
    if not solution.unique:
        nonuniqueness = f"lambda_H {explain_nonuniqueness(solution.mesh, is_user_mesh)}"
        warnings.warn(nonuniqueness, SolutionWarning, stacklevel=3)
    if reason := explain_dominant_lift(solution):
        warnings.warn(reason, SolutionWarning, stacklevel=3)


def explain_missed_accuracy(search: Search, solution: Solution) -> str:
    """Sentence on why the accuracy is not certified, and which one is reached."""
    best = search.best
    clauses = [f"the accuracy {best.goal.accuracy:g} is not certified: {search.ended}"]
    if not search.believed:
        clauses.append("no bound is left")
    elif not best.total < math.inf:
        clauses.append("no bound is known")
    elif best.goal.absolute or not best.size > 0:
        clauses.append(f"reached is {format_up(best.total, '.4e')}")
    else:
        share = format_up(relative_bound(best.total, best.size), ".3g")
        size = getattr(name_solution_norms(solution.problem), best.goal.norm)
        clauses.append(f"reached is {share} of {size}, or {format_up(best.total, '.4e')}")
    if search.refusal:
        clauses.append(str(search.refusal))
    if search.reach:
        clauses.append(f"an accuracy of {search.reach:g} is within reach")
    return "; ".join(clauses)
