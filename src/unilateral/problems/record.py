"""Problems as records for files, and back. A file holds formulas and arrays, and no functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.expression import Expression
from unilateral.formulas.trees import of_tree, tree
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems.given import FormulaFunction
from unilateral.problems.nodal import Nodal, NodalTrace, NodalTraces
from unilateral.problems.problem import Problem
from unilateral.problems.sampled import Function, Sampled
from unilateral.problems.units import Units


def record(of: Problem | Sampled) -> dict[str, Any]:
    """What makes the problem again, but for functions and an array f at nodes, as JSON can have it."""
    found = {
        "name": of.name,
        "polygon": of.polygon.name,
        "vertices": of.polygon.vertices.tolist(),
        "free_sides": [*of.free_sides],
        "clamped_sides": [*of.clamped_sides],
    }
    if of.exact:
        return found | {"kind": "case", "declaration": of.exact.declaration, "side": of.exact.side}
    return found | {
        "kind": "functions" if isinstance(of, Sampled) else "formulas",
        "title": of.title,
        "k": tree(of.units.k),
        "c": tree(of.units.c),
        "f": _formula(of.f),
        "g": [*map(_formula, of.g)],
        "q": [*map(_formula, of.q)],
        "on_mesh": of.nodal.mesh is not None,
        "g_at_nodes": _traces(of.nodal.g),
        "q_at_nodes": _traces(of.nodal.q),
    }


def of_record(of: dict[str, Any], f_at_nodes: Array | None = None) -> Problem | Sampled:
    """The problem of a record, without its mesh; in place of functions are such that raise InputError."""
    name, free, clamped = of["name"], tuple(of["free_sides"]), tuple(of["clamped_sides"])
    polygon = Polygon(np.array(of["vertices"]), of["polygon"])
    if of["kind"] == "case":
        from unilateral.problems.case import exact_solution  # with sympy, which takes long to import

        solution = exact_solution(of["declaration"], name, polygon, of["side"])
        return replace(solution.problem, free_sides=free)
    units = Units(of_tree(of["k"]), of_tree(of["c"]))
    at_nodes = (_of_traces(of[f"{field}_at_nodes"]) for field in "gq")
    nodal = Nodal(None, f_at_nodes, *at_nodes)
    if of["kind"] == "formulas":
        formulas = (tuple(map(of_tree, of[field])) for field in "gq")
        g, q = next(formulas), next(formulas)
        return Problem(name, polygon, of_tree(of["f"]), g, free, units, q, nodal, of["title"], clamped)
    functions = (tuple(map(_function, of[field])) for field in "gq")
    given = _function(of["f"]), next(functions), free, units, next(functions)
    return Sampled(name, polygon, *given, nodal, clamped)


def on_mesh(problem: Problem | Sampled, mesh: Mesh) -> Problem | Sampled:
    """The problem as one that was made of the mesh."""
    if problem.exact:
        return problem
    return replace(problem, nodal=replace(problem.nodal, mesh=mesh))


def _formula(of: Expression | Function) -> list[Any] | None:
    """A formula as nested lists, None for a function."""
    if isinstance(of, FormulaFunction):
        of = of.formula
    return tree(of) if isinstance(of, Expression) else None


def _function(of: list[Any] | None) -> Function:
    return lost if of is None else FormulaFunction(of_tree(of))


def lost(x: Array, y: Array) -> Array:
    """In place of a function that a file cannot hold."""
    raise InputError("a file of a solution holds no functions; give f, g and q again with ul.Problem(...)")


def _traces(of: NodalTraces) -> Sequence[Any]:
    return [[side, each.t.tolist(), each.values.tolist()] for side, each in of.items()]


def _of_traces(of: Sequence[Any]) -> NodalTraces:
    return {side: NodalTrace(np.array(t), np.array(values)) for side, t, values in of}
