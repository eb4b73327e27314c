"""Refined meshes with their levels, for tests of what is nested."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from unilateral.fem.hierarchy import FinerSpace, Hierarchy, hierarchy
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry.mesh import Mesh, refine, refine_some


@dataclass(frozen=True, eq=False)
class Nested:
    """The meshes of levels 0 to L, and the hierarchy of the last one."""

    meshes: list[Mesh]
    of: Hierarchy

    @property
    def mesh(self) -> Mesh:
        return self.meshes[-1]


def levels_of(meshes: list[Mesh]) -> Nested:
    return Nested(meshes, hierarchy(meshes[-1]))


def refined(coarse: Mesh, times: int) -> Nested:
    """From a mesh on that came from no other one, each level the uniform refinement of the one before."""
    meshes = [alone(coarse)]
    for _ in range(times):
        meshes.append(refine(meshes[-1]))
    return levels_of(meshes)


def graded(coarse: Mesh, node: int, times: int) -> Nested:
    """The same, only the triangles at a node being cut in four, so often."""
    meshes = [alone(coarse)]
    for _ in range(times):
        at = np.flatnonzero((meshes[-1].triangles == node).any(axis=1))
        meshes.append(refine_some(meshes[-1], at))
    return levels_of(meshes)


def at_random(coarse: Mesh, times: int, seed: int, share: float = 0.3) -> Nested:
    """The same, a share of the triangles chosen at random, in an ever smaller part of the domain."""
    rng, meshes = np.random.default_rng(seed), [alone(coarse)]
    place = coarse.points[rng.integers(coarse.n_nodes)]
    for k in range(times):
        mesh = meshes[-1]
        distance = np.hypot(*(mesh.points[mesh.triangles].mean(axis=1) - place).T)
        near = np.flatnonzero(distance <= max(mesh.polygon.diameter * 0.6**k, distance.min()))
        meshes.append(refine_some(mesh, rng.choice(near, int(share * len(near)) + 1, replace=False)))
    return levels_of(meshes)


def alone(mesh: Mesh) -> Mesh:
    """The mesh as if it had not been refined."""
    return replace(mesh, coarse=None, steps=(), known=None)


def assembled(mesh: Mesh) -> sp.csr_array:
    """The matrix of (., .)_1, element by element."""
    stiffness, mass = stiffness_and_mass(mesh)
    return sp.csr_array(stiffness + mass)


def prolongation(level: FinerSpace) -> sp.csr_array:
    """(n, before) of a level, from that before."""
    new = sp.csr_array((level.n - level.before, level.before)).tolil()
    new[:, level.ends] = level.P.toarray()
    return sp.vstack([sp.eye_array(level.before), new], format="csr")
