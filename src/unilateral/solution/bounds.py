"""Guaranteed bounds as users see them, and the names of the norms that they are in."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from unilateral.arrays import Array
from unilateral.discrete.choice import bound_memory_mb
from unilateral.errors import SolutionWarning
from unilateral.formulas.decimals import add_guarantee, format_interval, format_percent
from unilateral.formulas.expression import ONE, ZERO
from unilateral.system.memory import available_mb

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem
    from unilateral.solution.solution import Solution


class NormNames(NamedTuple):
    """Names of the energy norm of u, the dual norm of lambda, and the size of a force, or of their errors."""

    h1: str
    hm12: str
    force: str


def name_energy_norm(problem: Problem, function: str) -> str:
    """Name of the energy norm of a function, which is k^(1/2) |.|_1 if c = 0."""
    if problem.c != ZERO:
        return f"||{function}||_1"
    return f"|{function}|_1" if problem.k == ONE else f"k^(1/2) |{function}|_1"


def name_solution_norms(problem: Problem) -> NormNames:
    """Names of the norms of u and of lambda, to which accuracies are relative."""
    return NormNames(name_energy_norm(problem, "u"), "||lambda||_-1/2", "|force|")


@dataclass(frozen=True)
class Bounds:
    """Guaranteed bounds: ||u - u_h||_1 <= u and ||lambda - lambda_H||_{-1/2} <= multiplier.

    With coefficients ||v||_1 is the energy norm (k |v|_1^2 + c ||v||_0^2)^{1/2}, and the other norm is its
    dual; `unknown` is the part of both that comes from how well f, g and q could be enclosed. `relative_u` is
    `u` over a guaranteed lower bound on ||u||_1, rounded up, and `relative_multiplier` is `multiplier` over
    one on ||lambda||_{-1/2}. Both are NaN where that lower bound is 0: there the error may be as large as the
    solution. `multiplier` is NaN where no side carries contact. `error` is how the error of u is written, in
    the norm of the problem.
    """

    u: float
    multiplier: float
    unknown: float
    relative_u: float = math.nan
    relative_multiplier: float = math.nan
    error: str = "||u - u_h||_1"

    def __repr__(self) -> str:
        """Every number is rounded up.

        >>> Bounds(0.0123456, 0.25, 0.0, 0.045678)
        Bounds: ||u - u_h||_1 at most 0.01235 (4.6 %), ||lambda - lambda_H||_-1/2 at most 0.25, guaranteed
        """
        errors = {self.error: (self.u, self.relative_u)}
        errors["||lambda - lambda_H||_-1/2"] = self.multiplier, self.relative_multiplier
        texts = [
            f"{name} {format_interval(-math.inf, bound)}" + f" ({format_percent(share)})" * (share < math.inf)
            for name, (bound, share) in errors.items()
            if not math.isnan(bound)
        ]
        return f"Bounds: {add_guarantee(', '.join(texts), -math.inf, max(self.u, self.multiplier))}"


def bound_errors(solution: Solution, sharp: bool) -> Bounds | None:
    """The cheap or the sharp bounds of a solution, by Theorem 8.

    None where the bounds of all levels contradict each other, and, with a SolutionWarning two calls above,
    where they take more memory than is free.
    """
    refused = explain_memory_shortage(solution, sharp)
    if refused:
        warnings.warn(refused, SolutionWarning, stacklevel=3)
    if refused or not has_consistent_bounds(solution):
        return None
    solved = solution.bounded
    bound = solved.bound(sharp)
    assert bound is not None  # the data are enclosed
    return Bounds(
        u=bound.u,
        multiplier=bound.lambda_ if len(solved.cells) else math.nan,  # no cells: lambda is not there
        unknown=bound.data_remainder,
        relative_u=relative_bound(bound.u, solved.norm_lower_bound("h1", sharp)),
        relative_multiplier=relative_bound(bound.lambda_, solved.norm_lower_bound("hm12", sharp)),
        error=name_energy_norm(solution.problem, "u - u_h"),
    )


def compute_error_shares(solution: Solution) -> Array | None:
    """Shares (triangles,) of the triangles in the square of the cheap bound on u, or None without bounds."""
    if bound_errors(solution, sharp=False) is None:
        return None
    shares = solution.bounded.bound_shares
    total = float(shares.sum())
    return shares / total if 0 < total < math.inf else None


def has_consistent_bounds(solution: Solution) -> bool:
    """Whether bounds are believed: those of all levels contradict only by a fault of this program."""
    return solution.search is None or bool(solution.search.believed)


def uses_sharp_bounds(solution: Solution) -> bool:
    """Whether an accuracy was asked for by the sharp bounds."""
    return solution.search is not None and solution.search.best.goal.sharp


def relative_bound(bound: float, norm_below: float) -> float:
    """A bound over a lower bound on the solution's norm, rounded up; NaN where that is 0 or unknown."""
    # a quotient is off by half a unit in the last place at most, so the next number is not below it
    return math.nextafter(bound / norm_below, math.inf) if norm_below > 0 else math.nan


def has_computed_bounds(solution: Solution, sharp: bool) -> bool:
    """Whether the bounds are already computed."""
    # to look at solution.bounded would compute it, for it is a cached property
    is_enclosed = solution.solved.data is not None or "bounded" in vars(solution)
    return is_enclosed and solution.bounded.has_bound(sharp)


def explain_memory_shortage(solution: Solution, sharp: bool) -> str:
    """Sentence that bounds which are not yet computed take more memory than is free; else empty."""
    if has_computed_bounds(solution, sharp):
        return ""
    needed = bound_memory_mb(solution.mesh, sharp)
    free = available_mb()
    if needed <= free:
        return ""
    return f"no guaranteed bound: it takes about {needed:.0f} MB, and {free:.0f} MB are free"
