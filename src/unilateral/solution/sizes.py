"""The mesh and the partition that go with sizes h and H as users give them."""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import read_floats
from unilateral.discrete.choice import check_mesh_memory, choose_halvings
from unilateral.errors import InputError, quote_input
from unilateral.formulas.formula import parse_real
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import (
    default_mesh_kind,
    make_structured_cells,
    make_structured_mesh,
)
from unilateral.problems.build import put_on_mesh
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop

Size = float | str
"""A number, or one that is written as a fraction, such as "1/64"."""
MESH_KINDS = {"structured": make_structured_mesh, "unstructured": meshes.make_unstructured_mesh}
"""The kinds of meshes that are made for a polygon and a size h."""


def read_optional_number(name: str, value: Size | None) -> float | None:
    """The number, which may be a text such as "1/64", or None. Raises InputError for anything else."""
    if isinstance(value, str):
        return parse_real(value, name)
    try:
        if isinstance(value, bool):
            raise TypeError
        if value is None:
            return None
        # a number of NumPy may be masked; an array of several is no number
        return float(read_floats(value, name)[()]) if hasattr(value, "__array__") else float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{name} is {quote_input(repr(value))}; it has to be a number, or a text such as '1/64'"
        ) from None


def check_mesh_kind(mesh_or_kind: Mesh | str) -> None:
    """Raises InputError for what is neither a mesh nor one of MESH_KINDS."""
    if not isinstance(mesh_or_kind, Mesh) and not (
        isinstance(mesh_or_kind, str) and mesh_or_kind in ("", *MESH_KINDS)
    ):
        raise InputError(
            f"the mesh is {quote_input(repr(mesh_or_kind))}; it has to be {' or '.join(MESH_KINDS)}, or a "
            "mesh such as ul.mesh(path)"
        )


def mesh_problem(
    problem: Problem, h: float | None, H: float | None, mesh_or_kind: Mesh | str, stop: Stop
) -> tuple[Problem, Mesh, Partition]:
    """The mesh and the partition of sizes h and H at most, and the problem put on that mesh.

    The `mesh_or_kind` may be a mesh of one's own. Raises InputError where a size is missing, or one too many,
    and as `put_on_mesh`.
    """
    problem_mesh = problem.mesh
    if problem_mesh is not None and mesh_or_kind not in ("", problem_mesh):
        raise InputError(f"'{problem.name}' has a mesh of its own and is solved on it; leave mesh out")
    mesh, partition = make_mesh_and_partition(
        problem.polygon, h, H, mesh_or_kind if problem_mesh is None else problem_mesh, stop
    )
    return put_on_mesh(problem, mesh), mesh, partition


def make_mesh_and_partition(
    polygon: Polygon, h: float | None, H: float | None, mesh_or_kind: Mesh | str, stop: Stop
) -> tuple[Mesh, Partition]:
    """The mesh and the partition of sizes h and H at most. Raises InputError where one of them is missing."""
    if isinstance(mesh_or_kind, Mesh) and H is None:
        raise InputError("with a mesh of your own give H, the length of the longest cell of the multiplier")
    max_H = _require_positive_size("H", H)
    if isinstance(mesh_or_kind, Mesh):
        if h is not None:
            raise InputError("the mesh is given; leave h out")
        return fit_mesh(mesh_or_kind, polygon), make_uniform_partition(polygon, max_H)
    max_h = _require_positive_size("h", h)
    check_mesh_memory(polygon, max_h)
    mesh_kind = mesh_or_kind or default_mesh_kind(polygon)
    # edges in each cell: H/h, rounded up unless rounding alone has made it larger than a whole number
    edges = math.ceil(max_H / max_h * (1 - 1e-12))
    halvings = choose_halvings(polygon, max_H, edges, stop) if edges > 1 else 0
    if not halvings:
        return MESH_KINDS[mesh_kind](polygon, max_h), make_uniform_partition(polygon, max_H)
    # large meshes are refined from coarse ones, so that multigrid has levels: h and H become smaller than
    # asked for where a side does not consist of whole cells of the coarse mesh
    coarse_H = 2**halvings * max_H
    if mesh_kind == "structured":
        return make_structured_cells(polygon, coarse_H, edges, halvings)
    return meshes.triangulate_from_cells(make_uniform_partition(polygon, coarse_H), edges, halvings)


def fit_mesh(mesh: Mesh, polygon: Polygon) -> Mesh:
    """The mesh, as one of the polygon. Raises InputError if its triangles are those of another one."""
    if np.array_equal(mesh.polygon.vertices, polygon.vertices):
        return mesh
    return meshes.from_arrays(polygon, mesh.points, mesh.triangles)


def _require_positive_size(name: str, size: float | None) -> float:
    """The size, if it is given and positive. Raises InputError if not."""
    if size is None:
        raise InputError(
            f"h and H are needed, and {name} is missing; if all data are formulas, ul.solve takes an "
            "accuracy instead"
        )
    if not 0 < size < math.inf:
        raise InputError(f"{name} = {size:g} must be a positive number")
    return size
