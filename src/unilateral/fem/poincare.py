"""Constants in the inequalities of Poincare, on triangles, and of Friedrichs, on a polygon.

That of Friedrichs is a guaranteed C with ||v||_0 <= C |v|_1 for functions v of H^1 that vanish on some sides.
C^{-2} is the least eigenvalue lambda of -Delta with v = 0 there. The space of Crouzeix and Raviart has
functions that are linear on each triangle, with one mean on each edge, 0 on clamped edges. With its least
eigenvalue lambda_h and h the longest edge,

    lambda >= lambda_h / (1 + KAPPA^2 h^2 lambda_h)

(C. Carstensen and J. Gedicke, Math. Comp. 83, 2014, 2605-2629, with a larger KAPPA). Proof: let v be an
eigenfunction with ||v||_0 = 1, and I v the function with its means. Then |v|_1^2 = |I v|_1^2 + |v - I v|_1^2
and ||v - I v||_0 <= KAPPA h |v - I v|_1. With t = |v - I v|_1,

    lambda^{1/2} = |v|_1,     lambda - t^2 = |I v|_1^2 >= lambda_h (1 - KAPPA h t)^2,

so lambda is at least the least value of t^2 + lambda_h (1 - KAPPA h t)^2, which is the right-hand side.

lambda_h is the least eigenvalue of a matrix B. That no eigenvalue of B is below mu, up to rounding, is known
where B - mu can be factorised with positive pivots: these are the pivots of a matrix that differs from it by
at most (n + 2) EPS trace B (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, theorem
10.3). The entries of B are rounded, too, so that n + 16 is taken for n + 2.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import dissected
from unilateral.fem.p1 import from_elements, gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh, refine, unstructured

KAPPA = 0.19
"""||w||_{0,T} <= KAPPA d_T |w|_{1,T} if w has the mean 0 on each edge of T; d_T is its longest edge.

Proved with Proposition S1 in supplement.md; the computation in its proof is tests/unit/fem/test_kappa.py.
No constant below 0.189 is enough for equilateral triangles.
"""
FEW = 250
"""The mesh is halved until it has so many nodes. A coarser one has a larger constant."""
LESS = 1 - 1e-6
"""mu is this part of the eigenvalue that was computed."""
HIDDEN = 0.01
"""Rounding of an eigenvalue in units of the inverse squared diameter may be as large as this."""


def friedrichs(mesh: Mesh, clamped: tuple[int, ...], known: float = math.inf) -> float:
    """The constant for the `clamped` sides of the mesh's polygon, or one that is `known` if it is smaller.

    Where the mesh, or the one it was refined from, is so fine that rounding hides the eigenvalue, and none is
    known, gmsh makes another one. Raises InputError where it is missing, or where rounding hides the
    eigenvalue even so.
    """
    given, polygon = mesh.coarse or mesh, mesh.polygon
    for coarse in (lambda: given, lambda: unstructured(polygon, polygon.diameter / 8)):
        found = min(mesh.growth * _on(coarse(), clamped), known)
        if found < math.inf:
            return found
    raise InputError(
        f"polygon '{polygon.name}' is too thin for Friedrichs' inequality, whose constant c = 0 needs"
    )


def _on(mesh: Mesh, clamped: tuple[int, ...]) -> float:
    """The constant by that mesh, or halves of it; infinite if rounding hides it."""
    while mesh.n_nodes < FEW:
        mesh = refine(mesh)
    B = _without(crouzeix_raviart(mesh)[0], mesh.triangulation.boundary[Form(0.0, clamped).edges(mesh)])
    rounding = (B.shape[0] + 16) * EPS * float(B.diagonal().sum())
    discrete = _least(B) - rounding if rounding * mesh.polygon.diameter**2 < HIDDEN else 0.0
    if not discrete > 0:
        return math.inf
    return mesh.growth * math.sqrt(1 / discrete + (KAPPA * mesh.diameter) ** 2)


def crouzeix_raviart(mesh: Mesh) -> tuple[sp.csr_array, Array]:
    """The least quotients |v|_1^2 / ||v||_0^2 of functions that are linear on triangles, with means on edges.

    Returns (n, n) B = M^{-1/2} K M^{-1/2} on the n edges and (n,) the diagonal of M^{1/2}: K is the stiffness
    matrix, and M the mass matrix, which is diagonal.
    """
    edges, of = mesh.opposite_edges, mesh.triangulation
    slopes = -2 * gradients(mesh)
    stiffness = mesh.areas[:, None, None] * (slopes @ slopes.transpose(0, 2, 1))
    mass = np.bincount(edges.ravel(), np.repeat(mesh.areas / 3, 3), len(of.ends))
    root = sp.diags_array(1 / np.sqrt(mass))
    return (root @ from_elements(edges, stiffness, len(of.ends)) @ root).tocsr(), np.sqrt(mass)


def _without(B: sp.csr_array, clamped: Index) -> sp.csr_array:
    """B without the rows and columns of clamped edges."""
    free = np.ones(B.shape[0], dtype=bool)
    free[clamped] = False
    return B[free][:, free].tocsr()


def _least(B: sp.csr_array) -> float:
    """A number that no eigenvalue of B (n, n) is below, but for rounding; 0 if it is found to be none."""
    found = eigsh(B, k=1, sigma=0.0, v0=np.ones(B.shape[0]), return_eigenvectors=False)
    mu = LESS * float(found[0])
    pivots = dissected((B - mu * sp.eye_array(B.shape[0])).tocsr()).lu.U.diagonal()
    return mu if pivots.min() > 0 else 0.0
