"""What is known of a solution, as a record for programs."""

from __future__ import annotations

import math
import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

from unilateral.accuracy.level import Level
from unilateral.formulas.exact_numbers import rounded
from unilateral.norms.dual import Errors
from unilateral.solution.contact import Contact

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

NORMS = {
    "h1": "||v||_1 = (k ||grad v||_0^2 + c ||v||_0^2)^(1/2)",
    "hm12": "||mu||_-1/2 = sup <mu, v> / ||v||_1",
    "l2": "||mu||_0 = (integral of mu^2 over the boundary)^(1/2)",
}
"""The norms of errors, bounds and accuracies, by the names that fields have."""
SIZE = {"h1": "||u||_1", "hm12": "||lambda||_-1/2"}
"""What an accuracy in each norm is relative to."""


class Bounds(NamedTuple):
    """Guaranteed bounds: ||u - u_h||_1 <= u and ||lambda - lambda_H||_{-1/2} <= multiplier.

    With coefficients ||v||_1 is the energy norm (k |v|_1^2 + c ||v||_0^2)^{1/2}, and the other norm is its
    dual. `unknown` is the part of both that comes from how well f, g and q could be enclosed.
    """

    u: float
    multiplier: float
    unknown: float


def record(solution: Solution, bounds: Bounds | None, errors: Errors | None, sharp: bool) -> dict[str, Any]:
    """The fields of `solve --json`, but for forces and cost; NaN for what is unknown.

    `bounds` are the `sharp` ones or the cheap ones. Sizes and the contact are in the user's units.
    """
    solved, search, units = solution.solved, solution.search, solution.units
    discrete, result, goal = solved.discrete, solved.result, search.best.goal if search else None
    mesh, cells = discrete.mesh, discrete.partition
    length, norm = units.length, goal.norm if goal else "h1"
    bound_u, bound_lambda, unknown = bounds or (math.nan,) * 3
    size_u, size_lambda = (solved.size(of, sharp) if bounds else math.nan for of in ("h1", "hm12"))
    return {
        "problem": discrete.data.name if discrete.data else None,
        "goal": {name: asdict(goal)[name] for name in ("accuracy", "norm", "absolute")} if goal else None,
        "norm": norm,
        "certified": solution.certified,
        "ended": search.ended or None if search and not search.certified else None,
        "reach": search.reach if search else None,
        "k": rounded(units.k),
        "c": rounded(units.c),
        "norms": NORMS,
        "h": length * mesh.h,
        "diameter": length * mesh.diameter,
        "H": length * cells.H,
        "adapted": discrete.mesh.adapted,
        "triangles": len(mesh.triangles),
        "unknowns": mesh.n_nodes,
        "multipliers": len(discrete.cells),
        "algorithm": result.algorithm,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "algebraic_bound": result.bound,
        "unique": solution.unique,
        "h1_error": errors.h1 if errors else math.nan,
        "hm12_error_lower": errors.hm12_lower if errors else math.nan,
        "hm12_error_upper": errors.hm12_upper if errors else math.nan,
        "l2_error": errors.l2 if errors else math.nan,
        "bounds": ("sharp" if sharp else "cheap") if bounds else None,
        "h1_bound": bound_u,
        "hm12_bound": bound_lambda,
        "h1_relative_bound": relative(bound_u, size_u),
        "hm12_relative_bound": relative(bound_lambda, size_lambda),
        "enclosure": unknown,
        "total_bound": bound_lambda if norm == "hm12" else bound_u,
        "levels": [_level(level, length) for level in search.done] if search else [],
        "contact": _contact(solution.contact),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("unilateral", "numpy", "scipy")},
    }


def relative(bound: float, size: float) -> float:
    """A bound over a lower bound on the solution's norm, rounded up; NaN where that is 0 or unknown."""
    return math.nextafter(bound / size, math.inf) if size > 0 else math.nan


def _level(level: Level, length: float) -> dict[str, float]:
    return {
        "h": length * level.solved.discrete.mesh.h,
        "H": length * level.partition.H,
        "unknowns": level.unknowns,
        "multipliers": len(level.solved.discrete.cells),
        "iterations": level.solved.result.iterations,
        "total_bound": level.total,
    }


def _contact(contact: Contact) -> dict[str, Any]:
    return {
        "full": contact.full,
        "length": contact.length,
        "lengths": contact.lengths.tolist(),
        "intervals": [each._asdict() for each in contact.intervals],
    }
