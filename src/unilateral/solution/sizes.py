"""The mesh and the partition that go with sizes h and H as users give them."""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import floats
from unilateral.discrete.choice import check_size, levels_for
from unilateral.errors import InputError, shown
from unilateral.formulas.formula import real
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import natural_kind, structured
from unilateral.problems.build import put_on_mesh
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop

Size = float | str
"""A number, or one that is written as a fraction, such as "1/64"."""
KINDS = {"structured": structured, "unstructured": meshes.unstructured}
"""The kinds of meshes that are made for a polygon and a size h."""


def number(name: str, given: Size | None) -> float | None:
    """A number that may be a text, such as "1/64"."""
    if isinstance(given, str):
        return real(given, name)
    try:
        if isinstance(given, bool):
            raise TypeError
        if given is None:
            return None
        # A number of NumPy may be masked; an array of several is no number
        return float(floats(given, name)[()]) if hasattr(given, "__array__") else float(given)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{name} is {shown(repr(given))}; it has to be a number, or a text such as '1/64'"
        ) from None


def check_kind(mesh: Mesh | str) -> None:
    """Raises InputError for what is neither a mesh nor one of KINDS."""
    if not isinstance(mesh, Mesh) and not (isinstance(mesh, str) and mesh in ("", *KINDS)):
        raise InputError(
            f"the mesh is {shown(repr(mesh))}; it has to be {' or '.join(KINDS)}, or a mesh such as "
            "ul.mesh(path)"
        )


def put_on_sizes(
    problem: Problem, h: float | None, H: float | None, kind: Mesh | str, stop: Stop
) -> tuple[Problem, Mesh, Partition]:
    """The mesh and the partition of sizes h and H at most, and the problem put on that mesh.

    The `kind` may be a mesh of one's own. Raises InputError where a size is missing, or one too many, and as
    `put_on_mesh`.
    """
    own = problem.mesh
    if own is not None and kind not in ("", own):
        raise InputError(f"'{problem.name}' was made of a mesh and is solved on it; leave mesh out")
    mesh, partition = sized(problem.polygon, h, H, kind if own is None else own, stop)
    return put_on_mesh(problem, mesh), mesh, partition


def sized(
    polygon: Polygon, h: float | None, H: float | None, kind: Mesh | str, stop: Stop
) -> tuple[Mesh, Partition]:
    """The mesh and the partition of sizes h and H at most. Raises InputError where one of them is missing."""
    if isinstance(kind, Mesh) and H is None:
        raise InputError("a mesh of one's own needs H, the longest cell of the multiplier")
    wanted_H = _checked("H", H)
    if isinstance(kind, Mesh):
        if h is not None:
            raise InputError("the mesh is given; leave h out")
        same = np.array_equal(kind.polygon.vertices, polygon.vertices)
        mesh = kind if same else meshes.from_arrays(polygon, kind.points, kind.triangles)
        return mesh, uniform(polygon, wanted_H)
    wanted_h = _checked("h", h)
    check_size(polygon, wanted_h)
    kind = kind or natural_kind(polygon)
    edges = math.ceil(wanted_H / wanted_h * (1 - 1e-12))
    halvings = levels_for(polygon, wanted_H, edges, stop) if kind == "unstructured" and edges > 1 else 0
    if halvings:
        return meshes.following(uniform(polygon, 2**halvings * wanted_H), edges, halvings)
    return KINDS[kind](polygon, wanted_h), uniform(polygon, wanted_H)


def _checked(name: str, size: float | None) -> float:
    """A size that is given and positive."""
    if size is None:
        raise InputError(
            f"h and H are needed, and {name} is missing; for formulas ul.solve takes an accuracy in their "
            "place"
        )
    if not 0 < size < math.inf:
        raise InputError(f"{name} = {size:g} must be a positive number")
    return size
