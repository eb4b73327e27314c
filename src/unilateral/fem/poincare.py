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

lambda_h is the least eigenvalue of a matrix B with the diagonal D. Let L and U be the factors that are
computed of B - shift D - mu, and P > 0 their pivots. U is P L^T up to rounding, W = U - P L^T, and

    L P L^T = B - shift D - mu + E - L W,     |E_ij| <= (r + 2) EPS/2 (D_ii D_jj)^{1/2},

for at most r numbers in a row of L (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002,
theorem 9.3, and for the root Cauchy and Schwarz as in theorem 10.3), and E_ij = 0 where L + L^T has no place.
The entries of B are rounded likewise, by less than 20 EPS/2. With at most w numbers in a row of L + L^T,
E <= (r + 22) w EPS/2 D by Gershgorin's theorem for D^{-1/2} E D^{-1/2}. With

    shift = (r + 16) w EPS

that is at most 3/4 shift D, as r >= 1. That W leaves a quarter is seen once L and U are known. So B >= mu if
the pivots are positive. However small the least triangles are, v . shift D v is small where v is smooth, for
D has the squares of gradients.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import dissected, factorise
from unilateral.fem.p1 import from_elements, gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh, refine, with_boundary
from unilateral.geometry.partition import balanced, uniform

KAPPA = 0.19
"""||w||_{0,T} <= KAPPA d_T |w|_{1,T} if w has the mean 0 on each edge of T; d_T is its longest edge.

Proved with Proposition S1 in supplement.md; the computation in its proof is tests/unit/fem/test_kappa.py.
No constant below 0.189 is enough for equilateral triangles.
"""
FEW = 250
"""The mesh is halved until it has so many nodes. A coarser one has a larger constant."""
LESS = 1 - 1e-6
"""mu is this part of what is left of the eigenvalue that was computed."""
EVEN = 4.0
"""A mesh whose boundary edges at a clamped side are longer by this than their neighbours is too coarse there.

Only the size of the constant depends on it.
"""
PARTS, GROWTH = 8, 0.4
"""The graded mesh has boundary edges of at most the PARTS-th of the diameter; for GROWTH see `with_boundary`.

They are at most twice as long as their neighbours.
"""


def friedrichs(mesh: Mesh, clamped: tuple[int, ...], known: float = math.inf) -> float:
    """The constant for the `clamped` sides of the mesh's polygon, or one that is `known` if it is smaller.

    Where none is known, and rounding hides the eigenvalue on the mesh or the one it was refined from, or that
    is too coarse at a clamped side, gmsh makes another one, graded to short sides. Raises InputError where
    rounding hides the eigenvalue even so, or gmsh is missing then.
    """
    given, polygon = mesh.coarse or mesh, mesh.polygon
    constant = min(mesh.growth * _on(given, clamped), known)
    if constant < math.inf and (known < math.inf or not _is_coarse_at(given, clamped)):
        return constant
    try:
        graded = balanced(uniform(polygon, polygon.diameter / PARTS))
        finer = with_boundary(polygon, graded.points[:-1], GROWTH)
        constant = min(constant, mesh.growth * _on(finer, clamped))
    except InputError:
        if constant == math.inf:
            raise
    if constant == math.inf:
        lengths = polygon.lengths
        raise InputError(
            f"polygon '{polygon.name}': rounding hides the least eigenvalue of -Delta for functions that are "
            f"0 on the clamped sides {[*clamped]}, which c = 0 needs; sides have lengths from "
            f"{lengths.min():.3g} to {lengths.max():.3g}; clamp a longer side, or give a c above 0"
        )
    return constant


def _is_coarse_at(mesh: Mesh, clamped: tuple[int, ...]) -> bool:
    """Whether an edge next to a clamped side is much longer than the edge there."""
    lengths, on = np.diff(mesh.s), Form(clamped=clamped).edges(mesh)
    ratio = np.roll(lengths, -1) / lengths
    after = on & ~np.roll(on, -1) & (ratio > EVEN)
    before = ~on & np.roll(on, -1) & (ratio < 1 / EVEN)
    return bool(np.any(after | before))


def _on(mesh: Mesh, clamped: tuple[int, ...]) -> float:
    """The constant by that mesh, or halves of it; infinite if rounding hides it."""
    while mesh.n_nodes < FEW:
        mesh = refine(mesh)
    clamped_edges = mesh.triangulation.boundary[Form(clamped=clamped).edges(mesh)]
    mu = _least(_without(crouzeix_raviart(mesh)[0], clamped_edges))
    return mesh.growth * math.sqrt(1 / mu + (KAPPA * mesh.diameter) ** 2) if mu > 0 else math.inf


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
    """A number that no eigenvalue of B (n, n) is below; 0 if rounding hides the least one."""
    D = B.diagonal()
    try:
        factor = dissected(B)
        solve = LinearOperator(B.shape, factor.solve)
        found, x = eigsh(B, k=1, sigma=0.0, OPinv=solve, v0=np.ones(len(D)))
        # shift = (r + 16) w EPS; v . shift D v counts twice, for what it takes is of second order, too
        r, w = _most_in_rows(B, factor.order)
        shift = (r + 16) * w * EPS
        mu = LESS * float(found[0] - 2 * shift * (D @ x[:, 0] ** 2))
        # B - shift D - mu has positive pivots, with places for as many numbers in L
        shifted = factorise((B - sp.diags_array(mu + shift * D)).tocsr(), factor.order)
    except RuntimeError:  # a pivot is 0, or the iteration for the eigenvalue does not end
        return 0.0
    positive = np.array_equal(shifted.perm_r, shifted.perm_c) and shifted.U.diagonal().min() > 0
    return mu if mu > 0 and positive and _skew(shifted, D[factor.order]) <= shift / 4 else 0.0


def _most_in_rows(B: sp.csr_array, order: Index) -> tuple[int, int]:
    """The most places for numbers in a row of the factor L of B (n, n), and in one of L + L^T.

    SuperLU leaves out numbers that cancel to 0. Nothing cancels in a matrix with the same places whose
    numbers beside the diagonal are negative; this one is a graph's Laplacian, plus 1/n.
    """
    n, places = B.shape[0], B.copy()
    places.data[:] = -1.0
    places.setdiag(np.diff(B.indptr) - 1 + 1 / n)
    L = factorise(places, order).L
    in_rows, in_columns = np.bincount(L.indices), np.diff(L.indptr)
    return int(in_rows.max()), int((in_rows + in_columns).max())


def _skew(factors: SuperLU, D: Array) -> float:
    """A number s with |v . L W v| <= s v . D v, for W = U - P L^T, by Gershgorin's theorem."""
    root = np.empty(len(D))
    root[factors.perm_c] = np.sqrt(D)
    L, U = factors.L, factors.U
    W = abs(U - sp.diags_array(U.diagonal()) @ L.T)
    rows = abs(L) @ (W @ (1 / root)) / root
    columns = W.T @ (abs(L).T @ (1 / root)) / root
    return float(np.max(rows + columns) / 2)
