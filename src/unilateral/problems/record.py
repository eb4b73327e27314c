"""Problems as records for files, and back. A file holds formulas, and no functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon
from unilateral.problems.data import is_case
from unilateral.problems.problem import Problem
from unilateral.problems.problem_file import made
from unilateral.problems.sampled import Sampled

if TYPE_CHECKING:
    from unilateral.problems.case import Case


def record(problem: Case | Problem | Sampled) -> dict[str, Any]:
    """What makes the problem again, but for functions, as JSON can have it."""
    given = {"name": problem.name, "declaration": problem.declaration}
    if not is_case(problem):
        return given | {"kind": "functions" if isinstance(problem, Sampled) else "problem"}
    polygon = {"polygon": problem.polygon.name, "vertices": problem.polygon.vertices.tolist()}
    sides = {"side": problem.side, "free_sides": [*problem.free_sides]}
    return given | {"kind": "case"} | polygon | sides


def of_record(of: dict[str, Any]) -> Case | Problem | Sampled:
    """The problem of a record; in place of functions are such that raise InputError."""
    name, declaration = of["name"], of["declaration"]
    if of["kind"] == "case":
        from unilateral.problems.case import declared_on  # with sympy, which takes long to import

        polygon = Polygon(np.array(of["vertices"]), of["polygon"])
        return declared_on(declaration, name, polygon, of["side"], tuple(of["free_sides"]))
    problem = made(declaration, name, name)
    if of["kind"] == "problem":
        return problem
    on_sides = (_lost,) * problem.polygon.n_sides
    return Sampled(
        name, problem.polygon, _lost, on_sides, problem.free_sides, problem.units, on_sides, declaration
    )


def _lost(x: Array, y: Array) -> Array:
    raise InputError("a file of a solution holds no functions; give f, g and q again with ul.Problem(...)")
