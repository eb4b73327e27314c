"""What is known of a solution, as a record for programs."""

from __future__ import annotations

import math
import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

from unilateral.adaptive.level import Level
from unilateral.discrete.choice import bound_mb
from unilateral.discrete.solution import DiscreteSolution
from unilateral.formulas.decimals import guaranteed, interval, percent
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ONE
from unilateral.norms.dual import Errors
from unilateral.problems.fields import linear_fields
from unilateral.problems.units import Units
from unilateral.system.memory import available_mb

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem
    from unilateral.solution.solution import Solution

L2 = "||mu||_0 = (integral of mu^2 over the boundary)^(1/2)"
QUICK = 20_000
"""Up to this many nodes the bound on beta takes less than half a second, and the record has it."""


class Named(NamedTuple):
    """What a norm of u is called, and that of lambda, and of their errors."""

    h1: str
    hm12: str


def energy(units: Units, of: str) -> str:
    """The name of the norm of a function: k^(1/2) |.|_1 if c = 0."""
    if units.reaction:
        return f"||{of}||_1"
    return f"|{of}|_1" if units.k == ONE else f"k^(1/2) |{of}|_1"


def sizes(units: Units) -> Named:
    """What an accuracy in each norm is relative to."""
    return Named(energy(units, "u"), "||lambda||_-1/2")


def norms(problem: Problem) -> dict[str, str]:
    """The norms of errors, bounds and accuracies, by the names that fields have."""
    of_v = energy(problem.units, "v")
    whole = "(k ||grad v||_0^2 + c ||v||_0^2)^(1/2)" if problem.units.reaction else "k^(1/2) ||grad v||_0"
    vanishing = " over v that vanish on clamped sides" if problem.clamped_sides else ""
    return {"h1": f"{of_v} = {whole}", "hm12": f"||mu||_-1/2 = sup <mu, v> / {of_v}{vanishing}", "l2": L2}


class Bounds(NamedTuple):
    """Guaranteed bounds: ||u - u_h||_1 <= u and ||lambda - lambda_H||_{-1/2} <= multiplier.

    With coefficients ||v||_1 is the energy norm (k |v|_1^2 + c ||v||_0^2)^{1/2}, and the other norm is its
    dual; `unknown` is the part of both that comes from how well f, g and q could be enclosed. `relative_u` is
    `u` over a guaranteed lower bound on ||u||_1, rounded up, and `relative_multiplier` is `multiplier` over
    one on ||lambda||_{-1/2}. Both are NaN where that lower bound is 0: there the error may be as large as the
    solution. `multiplier` is NaN where no side carries contact.
    """

    u: float
    multiplier: float
    unknown: float
    relative_u: float = math.nan
    relative_multiplier: float = math.nan

    def __repr__(self) -> str:
        """Every number is rounded up.

        >>> Bounds(0.0123456, 0.25, 0.0, 0.045678)
        Bounds: ||u - u_h||_1 at most 0.01235 (4.6 %), ||lambda - lambda_H||_-1/2 at most 0.25, guaranteed
        """
        errors = {"||u - u_h||_1": (self.u, self.relative_u)}
        errors["||lambda - lambda_H||_-1/2"] = self.multiplier, self.relative_multiplier
        parts = [
            f"{name} {interval(-math.inf, bound)}" + f" ({percent(part)})" * (part < math.inf)
            for name, (bound, part) in errors.items()
            if not math.isnan(bound)
        ]
        return f"Bounds: {guaranteed(', '.join(parts), -math.inf, max(self.u, self.multiplier))}"


class BoundsWithoutReaction(Bounds):
    """Bounds where c = 0: that on u is in the norm k^{1/2} |v|_1, and the other one in its dual."""

    def __repr__(self) -> str:
        return super().__repr__().replace("||u - u_h||_1", "k^(1/2) |u - u_h|_1")


def record(solution: Solution, bounds: Bounds | None, errors: Errors | None, sharp: bool) -> dict[str, Any]:
    """The fields of `solve --json`, but for forces and cost; NaN for what is unknown.

    `bounds` are the `sharp` ones or the cheap ones. Sizes and the contact are in the user's units.
    """
    solved, search, units = solution.solved, solution.search, solution.problem.units
    result, goal = solved.result, search.best.goal if search else None
    mesh, cells, contact = solved.mesh, solved.partition, solution.contact
    length, norm = units.length, goal.norm if goal else "h1"
    known = bounds or Bounds(*(math.nan,) * 3)
    beta = solution.beta if mesh.n_nodes <= QUICK else math.nan
    algebraic = math.nan if solved.foreign else result.bound
    return {
        "problem": solved.data.name if solved.data else None,
        "goal": {name: asdict(goal)[name] for name in ("accuracy", "norm", "absolute")} if goal else None,
        "norm": norm,
        "certified": solution.certified,
        "ended": search.ended or None if search and not search.certified else None,
        "reach": search.reach if search else None,
        "k": rounded(units.k),
        "c": rounded(units.c),
        "norms": norms(solution.problem),
        "linear_between_nodes": linear_fields(solution.problem),
        "h": length * mesh.h,
        "diameter": length * mesh.diameter,
        "H": length * cells.H,
        "adapted": mesh.adapted,
        "triangles": len(mesh.triangles),
        "unknowns": mesh.n_nodes,
        "multipliers": len(solved.cells),
        "algorithm": result.algorithm,
        "iterations": solution.iterations,
        "foreign": solved.foreign,
        "converged": solution.converged,
        "algebraic_bound": algebraic,
        "beta": beta,
        "hm12_algebraic_bound": algebraic / beta if beta > 0 else math.nan,
        "unique": solution.unique,
        "h1_error": errors.h1 if errors else math.nan,
        "hm12_error_lower": errors.hm12_lower if errors else math.nan,
        "hm12_error_upper": errors.hm12_upper if errors else math.nan,
        "l2_error": errors.l2 if errors else math.nan,
        "bounds": ("sharp" if sharp else "cheap") if bounds else None,
        "h1_bound": known.u,
        "hm12_bound": known.multiplier,
        "h1_relative_bound": known.relative_u,
        "hm12_relative_bound": known.relative_multiplier,
        "enclosure": known.unknown,
        "total_bound": known.multiplier if norm == "hm12" else known.u,
        "levels": [level_record(level, length) for level in search.levels] if search else [],
        "contact": {
            "full": contact.full,
            "length": contact.length,
            "lengths": contact.lengths.tolist(),
            "intervals": [each._asdict() for each in contact.intervals],
        },
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("unilateral", "numpy", "scipy")},
    }


def level_record(level: Level, length: float) -> dict[str, float]:
    """The fields of a level. Sizes are in the user's units: 1 in the level's is a `length` in these."""
    return {
        "h": length * level.solved.mesh.h,
        "H": length * level.partition.H,
        "unknowns": level.unknowns,
        "multipliers": len(level.solved.cells),
        "iterations": level.solved.result.iterations,
        "total_bound": level.total,
    }


def relative(bound: float, size: float) -> float:
    """A bound over a lower bound on the solution's norm, rounded up; NaN where that is 0 or unknown."""
    return math.nextafter(bound / size, math.inf) if size > 0 else math.nan


def too_large(solved: DiscreteSolution, sharp: bool) -> str:
    """Says that bounds that are not yet computed take more memory than is free; else empty."""
    if solved.data is None or solved.known(sharp):
        return ""
    needed, free = bound_mb(solved.mesh, sharp), available_mb()
    if needed <= free:
        return ""
    return f"no guaranteed bound: it takes about {needed:.0f} MB, and {free:.0f} MB are free"
