"""Loads, made of the moments of f against the hats of each triangle, and those of functions on sides."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from unilateral.arrays import Array, blocks
from unilateral.fem.p1 import edge_load, linear_parts
from unilateral.fem.quadrature import boundary_rule, symmetric, triangle_rules
from unilateral.geometry.mesh import Mesh
from unilateral.problems.sampled import Sampled

if TYPE_CHECKING:
    from unilateral.problems.case import Case

SAMPLED = 8
"""The degree of the rule on triangles for an f that is known in points only."""

PART = 1 << 16
"""This many triangles are treated together: such a part of a mesh takes some 10 MB."""


def parts(mesh: Mesh) -> Iterator[Mesh]:
    """The mesh in blocks, each with all nodes and some of the triangles."""
    for of in blocks(len(mesh.triangles), PART):
        yield mesh.part(np.arange(of.start, of.stop))


def by_parts(mesh: Mesh, moments: Callable[[Mesh], Array]) -> Array:
    """(n,) values of (f, phi_i), from the moments (m, 3) on each part, in little memory."""
    found = np.zeros(mesh.n_nodes)
    for part in parts(mesh):
        np.add.at(found, part.triangles, moments(part))
    return found


def case_moments(case: Case, mesh: Mesh) -> Array:
    """(m, 3) the moments of a case's f, by a quadrature that sees the case's singular points and kinks."""
    found = np.zeros((len(mesh.triangles), 3))
    for rule in triangle_rules(mesh, case):
        f = case.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(found, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
    return found


def sampled_moments(problem: Sampled, mesh: Mesh) -> Array:
    """(m, 3) the moments of a sampled f, by a rule whose error nobody knows."""
    hats, weights = symmetric(SAMPLED)
    f = problem.source(np.einsum("qb,tbd->tqd", hats, mesh.points[mesh.triangles]))
    return mesh.areas[:, None] * ((f * weights) @ hats)


def sampled_edge_load(problem: Sampled, mesh: Mesh) -> Array:
    """(n,) the load of the given flux, by a Gauss rule on every edge."""
    rule = boundary_rule(problem.polygon, mesh.s)
    x = (problem.polygon.starts[rule.side] + rule.s - mesh.s[rule.interval]) / np.diff(mesh.s)[rule.interval]
    points = (each[:, None] for each in (x, rule.weight, problem.flux(rule.side, rule.s)))
    return edge_load(mesh, linear_parts(mesh, rule.interval, *points))
