"""Meshes and refined meshes with their levels, for tests of what is to hold on any of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array
from unilateral.discrete.multilevel import MultilevelProblem, discretise_on_nested_spaces, nested_spaces
from unilateral.discrete.problem_data import problem_form
from unilateral.fem.hierarchy import FinerSpace, Hierarchy, build_hierarchy
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry.mesh import (
    Mesh,
    from_arrays,
    make_unstructured_mesh,
    refine_triangles,
    refine_uniformly,
    triangulate_from_boundary,
)
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.problem import Problem
from unilateral.solvers.multigrid import MultigridResult

FLAT = Polygon(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.3], [0.4, 0.25]]), "flat")
SLANTED = Polygon(np.array([[0, 0], [3, 1], [2.5, 2], [4, 4], [0.5, 3]]), "slanted")
RIGHT = Polygon(np.array([[0.0, 0], [1, 0], [0, 1]]), "right and isosceles")
TIMES = {"uniform": 3, "at random": 6, "at a node": 15, "mixed": 3}


@dataclass(frozen=True, eq=False)
class Nested:
    """The meshes of levels 0 to L, and the hierarchy of the last one."""

    meshes: list[Mesh]
    hierarchy: Hierarchy

    @property
    def mesh(self) -> Mesh:
        return self.meshes[-1]


def multilevel(problem: Problem, mesh: Mesh, partition: Partition) -> MultilevelProblem | None:
    """The problem on the levels of a mesh; None as for `nested_spaces`."""
    spaces = nested_spaces(mesh, partition, form=problem_form(problem, mesh))
    return discretise_on_nested_spaces(problem, spaces) if spaces else None


def ritz(result: MultigridResult) -> Array:
    """Approximate eigenvalues of the preconditioned matrix, by Lanczos' method from the last run's steps."""
    alpha, beta = np.array(result.cg_coefficients).reshape(-1, 2).T
    diagonal = 1 / alpha + np.append(0, beta / alpha)[:-1]
    beside = np.sqrt(beta[:-1]) / alpha[:-1]
    return np.linalg.eigvalsh(np.diag(diagonal) + np.diag(beside, -1))


def levels_of(meshes: list[Mesh]) -> Nested:
    return Nested(meshes, build_hierarchy(meshes[-1]))


def refine_mesh_levels(coarse: Mesh, times: int) -> Nested:
    """From a mesh on that came from no other one, each level the uniform refinement of the one before."""
    meshes = [forget_refinement(coarse)]
    for _ in range(times):
        meshes.append(refine_uniformly(meshes[-1]))
    return levels_of(meshes)


def grade_mesh_levels(coarse: Mesh, node: int, times: int) -> Nested:
    """The same, only the triangles at a node being cut in four, so often."""
    meshes = [forget_refinement(coarse)]
    for _ in range(times):
        indices = np.flatnonzero((meshes[-1].triangles == node).any(axis=1))
        meshes.append(refine_triangles(meshes[-1], indices))
    return levels_of(meshes)


def refine_at_random(coarse: Mesh, times: int, seed: int, share: float = 0.3) -> Nested:
    """The same, a share of the triangles chosen at random, in an ever smaller part of the domain."""
    rng = np.random.default_rng(seed)
    meshes = [forget_refinement(coarse)]
    place = coarse.points[rng.integers(coarse.n_nodes)]
    for k in range(times):
        mesh = meshes[-1]
        distance = np.hypot(*(mesh.points[mesh.triangles].mean(axis=1) - place).T)
        near = np.flatnonzero(distance <= max(mesh.polygon.diameter * 0.6**k, distance.min()))
        meshes.append(refine_triangles(mesh, rng.choice(near, int(share * len(near)) + 1, replace=False)))
    return levels_of(meshes)


def forget_refinement(mesh: Mesh) -> Mesh:
    """The mesh as if it had not been refined."""
    return replace(mesh, coarse=None, steps=(), stored_triangulation=None)


def assemble_by_elements(mesh: Mesh) -> sp.csr_array:
    """The matrix of (., .)_1, element by element."""
    stiffness, mass = stiffness_and_mass(mesh)
    return sp.csr_array(stiffness + mass)


def prolongation(level: FinerSpace) -> sp.csr_array:
    """(n, before) of a level, from that before."""
    new = sp.csr_array((level.n - level.n_coarse, level.n_coarse)).tolil()
    new[:, level.ends] = level.P.toarray()
    return sp.vstack([sp.eye_array(level.n_coarse), new], format="csr")


@cache
def coarse(name: str) -> Mesh:
    """A mesh that came from no other one: made by gmsh, by hand, or of squares, as in "lshape 3"."""
    if name == "gmsh":
        return make_unstructured_mesh(find_polygon("lshape"), 0.5)
    if name == "slanted":  # six edges a side
        return triangulate_from_boundary(SLANTED, SLANTED.divided(np.full(5, 6))[:-1])
    if name == "flat":
        return from_arrays(FLAT, FLAT.vertices, [[0, 1, 2], [0, 2, 3]])
    if name == "one triangle":
        return from_arrays(RIGHT, RIGHT.vertices, [[0, 1, 2]])
    polygon, n = name.split()
    return forget_refinement(make_structured_mesh(find_polygon(polygon), 1 / int(n)))


@cache
def make_mesh_levels(name: str, way: str, times: int | None = None, seed: int = 3) -> Nested:
    """A coarse mesh refined so often, by default as in TIMES.

    In the way "mixed" some triangles are cut between uniform refinements.
    """
    first = coarse(name)
    times = TIMES[way] if times is None else times
    if way == "uniform":
        return refine_mesh_levels(first, times)
    if way == "at random":
        return refine_at_random(first, times, seed)
    if way == "at a node":
        return grade_mesh_levels(first, 0, times)
    before = refine_uniformly(first)
    middle = refine_triangles(before, np.arange(0, len(before.triangles), 5))
    return levels_of([first, before, middle, refine_uniformly(middle)])
