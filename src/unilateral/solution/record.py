"""What is known of a solution, as a record for programs."""

from __future__ import annotations

import math
import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from unilateral.adaptive.level import Level
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ZERO
from unilateral.norms.dual import Errors
from unilateral.problems.fields import linear_fields
from unilateral.solution.bounds import Bounds, name_energy_norm

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem
    from unilateral.solution.contact import Contact
    from unilateral.solution.solution import Solution

MAX_NODES_FOR_BETA = 20_000
"""Up to this many nodes the bound on beta takes less than half a second, and the record has it."""


def describe_norms(problem: Problem) -> dict[str, str]:
    """Formulas of the norms of errors, bounds and accuracies, by the names that fields have."""
    v_norm = name_energy_norm(problem, "v")
    energy_formula = "(k ||grad v||_0^2 + c ||v||_0^2)^(1/2)" if problem.c != ZERO else "k^(1/2) ||grad v||_0"
    vanishing = " over v that vanish on clamped sides" if problem.clamped_sides else ""
    return {
        "h1": f"{v_norm} = {energy_formula}",
        "hm12": f"||mu||_-1/2 = sup <mu, v> / {v_norm}{vanishing}",
        "l2": "||mu||_0 = (integral of mu^2 over the boundary)^(1/2)",
    }


def make_solution_record(
    solution: Solution, bounds: Bounds | None, errors: Errors | None, sharp: bool
) -> dict[str, Any]:
    """The fields of `solve --json`, but for forces and cost; NaN for what is unknown.

    `bounds` are the `sharp` ones or the cheap ones.
    """
    solved = solution.solved
    search = solution.search
    result = solved.result
    goal = search.best.goal if search else None
    mesh = solved.mesh
    partition = solved.partition
    norm = goal.norm if goal else "h1"
    goal_names = ("accuracy", "norm", "absolute") + (("sides",) if norm == "force" else ())
    total_bounds = {"h1": bounds.u, "hm12": bounds.multiplier} if bounds else {}
    beta = solution.beta if mesh.n_nodes <= MAX_NODES_FOR_BETA else math.nan
    # ||lambda_H - its exact value||_-1/2,h, by Proposition 7; by (3.4) over beta it is one in H^(-1/2)
    algebraic = math.nan if solved.is_foreign else result.bound
    return {
        "problem": solution.problem.name,
        "goal": {name: getattr(goal, name) for name in goal_names} if goal else None,
        "norm": norm,
        "certified": solution.certified,
        "ended": search.ended or None if search and not search.certified else None,
        "reach": search.reach if search else None,
        "k": as_float(solution.problem.k),
        "c": as_float(solution.problem.c),
        "norms": describe_norms(solution.problem),
        "linear_between_nodes": linear_fields(solution.problem),
        "h": mesh.h,
        "diameter": mesh.diameter,
        "H": partition.H,
        "adapted": mesh.is_adapted,
        "triangles": len(mesh.triangles),
        "unknowns": mesh.n_nodes,
        "multipliers": len(solved.cells),
        "algorithm": result.algorithm,
        "iterations": solution.iterations,
        "foreign": solved.is_foreign,
        "converged": solution.converged,
        "algebraic_bound": algebraic,
        "beta": beta,
        "hm12_algebraic_bound": algebraic / beta if beta > 0 else math.nan,
        "unique": solution.unique,
        **_make_error_record(errors),
        "bounds": ("sharp" if sharp else "cheap") if bounds else None,
        **_make_bounds_record(bounds or Bounds(*(math.nan,) * 3)),
        "total_bound": search.best.total if search and norm == "force" else total_bounds.get(norm, math.nan),
        "levels": [make_level_record(level) for level in search.levels] if search else [],
        "contact": _make_contact_record(solution.contact, has_bounds=bounds is not None),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("unilateral", "numpy", "scipy")},
    }


def _make_error_record(errors: Errors | None) -> dict[str, float]:
    """The true errors, NaN where the exact solution is not known."""
    return {
        "h1_error": errors.h1 if errors else math.nan,
        "hm12_error_lower": errors.hm12_lower if errors else math.nan,
        "hm12_error_upper": errors.hm12_upper if errors else math.nan,
        "l2_error": errors.l2 if errors else math.nan,
    }


def _make_bounds_record(bounds: Bounds) -> dict[str, float]:
    """The guaranteed bounds, and how much of them comes from enclosing f, g and q."""
    return {
        "h1_bound": bounds.u,
        "hm12_bound": bounds.multiplier,
        "h1_relative_bound": bounds.relative_u,
        "hm12_relative_bound": bounds.relative_multiplier,
        "enclosure": bounds.unknown,
    }


def _make_contact_record(contact: Contact, has_bounds: bool) -> dict[str, Any]:
    """The computed contact set, and the certain arcs if there are bounds, from which these follow."""
    return {
        "full": contact.full,
        "length": contact.length,
        "lengths": contact.lengths.tolist(),
        "intervals": [interval._asdict() for interval in contact.intervals],
        "certain": [arc._asdict() for arc in contact.certain] if has_bounds else [],
    }


def make_level_record(level: Level) -> dict[str, float]:
    """The fields of a level."""
    return {
        "h": level.solved.mesh.h,
        "H": level.partition.H,
        "unknowns": level.unknowns,
        "multipliers": len(level.solved.cells),
        "iterations": level.solved.result.iterations,
        "total_bound": level.total,
    }
