"""Problems as records for files, and back. A file holds formulas and arrays, and no functions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from unilateral.arrays import Array
from unilateral.formulas.expression import Expression
from unilateral.formulas.trees import of_tree, tree
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems.nodal import NodalTrace
from unilateral.problems.problem import Problem
from unilateral.problems.side_models import SideData
from unilateral.problems.units import Units


def record(of: Problem) -> dict[str, Any]:
    """What makes the problem again, but for an array f at nodes, as JSON can have it."""
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
        "kind": "formulas",
        "title": of.title,
        "k": tree(of.units.k),
        "c": tree(of.units.c),
        "f": _data(of.f),
        "g": [*map(_data, of.g)],
        "q": [*map(_data, of.q)],
        "on_mesh": of.mesh is not None,
    }


def of_record(of: dict[str, Any], f_at_nodes: Array | None = None) -> Problem:
    """The problem of a record, without its mesh."""
    name, free, clamped = of["name"], tuple(of["free_sides"]), tuple(of["clamped_sides"])
    polygon = Polygon(np.array(of["vertices"]), of["polygon"])
    if of["kind"] == "case":
        from unilateral.problems.case import exact_solution  # with sympy, which takes long to import

        solution = exact_solution(of["declaration"], name, polygon, of["side"])
        return replace(solution.problem, free_sides=free)
    units = Units(of_tree(of["k"]), of_tree(of["c"]))
    f = of_tree(of["f"]) if f_at_nodes is None else f_at_nodes
    g, q = (tuple(map(_of_data, of[field])) for field in "gq")
    return Problem(name, polygon, f, g, free, units, q, None, of["title"], clamped)


def on_mesh(problem: Problem, mesh: Mesh) -> Problem:
    """The problem as one that was made of the mesh."""
    return problem if problem.exact else replace(problem, mesh=mesh)


def _data(data: object) -> Any:
    """A formula as nested lists, a trace as its numbers; None for an array f."""
    if isinstance(data, NodalTrace):
        return {"t": data.t.tolist(), "values": data.values.tolist()}
    return tree(data) if isinstance(data, Expression) else None


def _of_data(data: Any) -> SideData:
    if isinstance(data, dict):
        return NodalTrace(np.array(data["t"]), np.array(data["values"]))
    return of_tree(data)
