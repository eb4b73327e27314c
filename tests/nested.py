"""A refined mesh with its levels, for tests of what is nested."""

from __future__ import annotations

from typing import NamedTuple

from unilateral.fem.hierarchy import Level, hierarchy
from unilateral.geometry.mesh import Mesh, refine


class Nested(NamedTuple):
    """The finest mesh and levels 0 to L."""

    mesh: Mesh
    levels: list[Level]


def refined(coarse: Mesh, times: int) -> Nested:
    """From a mesh on, each level the uniform refinement of the one before."""
    mesh = refine(coarse, times)
    return Nested(mesh, hierarchy(mesh))
