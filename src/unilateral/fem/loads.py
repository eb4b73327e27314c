"""Moments of f against the hats of each triangle, of which loads are made."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.fem.quadrature import symmetric, triangle_rules
from unilateral.geometry.mesh import Mesh
from unilateral.problems.case import Case
from unilateral.problems.sampled import Sampled

SAMPLED = 8
"""Degree of the rule on triangles for an f that is known in points only."""


def case_moments(case: Case, mesh: Mesh) -> Array:
    """(m, 3), by a quadrature that sees the case's singular points and kinks."""
    found = np.zeros((len(mesh.triangles), 3))
    for rule in triangle_rules(mesh, case):
        f = case.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(found, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
    return found


def sampled_moments(problem: Sampled, mesh: Mesh) -> Array:
    """(m, 3), by a rule whose error nobody knows."""
    hats, weights = symmetric(SAMPLED)
    f = problem.source(np.einsum("qb,tbd->tqd", hats, mesh.points[mesh.triangles]))
    return mesh.areas[:, None] * ((f * weights) @ hats)
