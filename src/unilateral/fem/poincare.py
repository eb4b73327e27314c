"""Constants in the inequalities of Poincare, on triangles, and of Friedrichs, on a polygon.

Friedrichs' constant is a guaranteed C with ||v||_0 <= C |v|_1 for all v in H^1 that vanish on some sides.
C^{-2} is the least eigenvalue lambda of -Delta with v = 0 there. The space of Crouzeix and Raviart has
functions that are linear on each triangle, with one mean on each edge, 0 on clamped edges. With its least
eigenvalue lambda_h and h the longest edge,

    lambda >= lambda_h / (1 + KAPPA^2 h^2 lambda_h)

(C. Carstensen and J. Gedicke, Math. Comp. 83, 2014, 2605-2629, with a larger KAPPA). Proof: let v be an
eigenfunction with ||v||_0 = 1, and I v the function with its means. Then |v|_1^2 = |I v|_1^2 + |v - I v|_1^2
and ||v - I v||_0 <= KAPPA h |v - I v|_1. With t = |v - I v|_1,

    lambda^{1/2} = |v|_1,     lambda - t^2 = |I v|_1^2 >= lambda_h (1 - KAPPA h t)^2,

so lambda is at least the least value of t^2 + lambda_h (1 - KAPPA h t)^2, which is the right-hand side.

lambda_h is the least eigenvalue of a matrix B with the diagonal D and the half bandwidth b. If Cholesky's
algorithm finds a factor R of A = B - shift D - mu, then R^T R = A + E is positive definite. An entry of R^T R
is a sum of at most b + 1 products, so that

    |E_ij| <= (b + 2) EPS/2 (D_ii D_jj)^{1/2}

(N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, theorem 10.3; the entries of |R^T| |R|
are bounded by Cauchy and Schwarz), with b + 4 in place of b + 2 if quotients are products with rounded
reciprocals. The entries of B are rounded likewise, by less than 20 EPS/2, and then the diagonal of A by 4
EPS/2. The rounding of areas, which is large on flat triangles, belongs to `Mesh.exact_mesh_factor`. There are
at most 2 b + 1 entries in a row. By Gershgorin's theorem for D^{-1/2} E D^{-1/2}, B >= mu if

    shift = (b + 28) (b + 1) EPS.

However small the least triangles are, v . shift D v is small where v is smooth, for D has the squares of
gradients. Where triangles are flat, it grows with the square of their length over their height.
B, D and R are those of this proof, not the coupling and the dual operator of `spaces`.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.p1 import assemble_matrix, gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh, refine_uniformly, triangulate_from_boundary
from unilateral.geometry.partition import balance_cells, make_uniform_partition

KAPPA = 0.19
"""||w||_{0,T} <= KAPPA d_T |w|_{1,T} if w has the mean 0 on each edge of T; d_T is its longest edge.

Proved with Proposition S1 in supplement.md; the computation in its proof is tests/unit/fem/test_kappa.py.
No constant below 0.189 is enough for equilateral triangles.
"""
MIN_FRIEDRICHS_NODES = 250
"""A mesh is halved until it has so many nodes. A coarser one has a larger constant."""
MAX_FRIEDRICHS_NODES = 10_000
"""A mesh with more nodes is not used. Another one has almost the same constant, and takes less time."""
EIGENVALUE_SHARE = 1 - 1e-6
"""mu is this fraction of the computed eigenvalue less what the shift takes."""
MAX_EDGE_RATIO = 4.0
"""An edge beside a clamped side is at most this times the last edge on it, or C would be needlessly large."""
MIN_EDGES_PER_DIAMETER = 8
"""No boundary edge of the graded mesh is above the diameter over this, or above twice its neighbours."""
GRADED_MESH_GROWTH = 0.4
"""Triangles of the graded mesh grow by this times their distance from the boundary."""


def friedrichs_constant(mesh: Mesh, clamped: tuple[int, ...]) -> float:
    """A C with ||v||_0 <= C |v|_1, on this mesh and the exact one, for v that are 0 on the `clamped` sides.

    It is computed on the mesh, or on the one that it was refined from. If that is large, or too coarse beside
    clamped sides, or rounding hides C there, gmsh makes another one, graded to short sides. At least one side
    is clamped. Raises InputError where rounding hides C on both meshes, or the first one does not do and gmsh
    makes no other.
    """
    coarse = mesh.coarse or mesh
    polygon = mesh.polygon
    # norms on this mesh's exact mesh may be larger by its factor
    constant = math.inf
    if coarse.n_nodes <= MAX_FRIEDRICHS_NODES:
        constant = mesh.exact_mesh_factor * crouzeix_raviart_constant(coarse, clamped)
    if constant < math.inf and _is_fine_beside_clamped(coarse, clamped):
        return constant
    needed = f"polygon '{polygon.name}': c = 0 needs Friedrichs' constant for the clamped sides {[*clamped]}"
    try:
        edges = balance_cells(make_uniform_partition(polygon, polygon.diameter / MIN_EDGES_PER_DIAMETER))
        graded = triangulate_from_boundary(polygon, edges.points[:-1], GRADED_MESH_GROWTH)
    except InputError as error:
        if constant < math.inf:
            return constant
        nodes = f"this mesh of {coarse.n_nodes} nodes"
        raise InputError(f"{needed}, which {nodes} does not yield; {error}") from error
    constant = min(constant, mesh.exact_mesh_factor * crouzeix_raviart_constant(graded, clamped))
    if constant == math.inf:
        height = float((2 * graded.areas / graded.longest_edges).min()) / polygon.diameter
        raise InputError(
            f"{needed}, which rounding hides, because triangles have heights down to {height:.1g} of the "
            "diameter; make the polygon thicker or its short sides longer, or take c near k/diameter^2"
        )
    return constant


def _is_fine_beside_clamped(mesh: Mesh, clamped: tuple[int, ...]) -> bool:
    """Whether no edge beside the end of a clamped side is above MAX_EDGE_RATIO times the last edge on it."""
    # at an end of a clamped side: the length of the boundary edge off it over that of the edge on it
    lengths = np.diff(mesh.s)
    is_clamped = np.isin(mesh.side, clamped)
    at_end = is_clamped != np.roll(is_clamped, -1)
    ratios = (np.roll(lengths, -1) / lengths) ** np.where(is_clamped, 1, -1)
    return bool(np.all(ratios[at_end] <= MAX_EDGE_RATIO))


def crouzeix_raviart_constant(mesh: Mesh, clamped: tuple[int, ...]) -> float:
    """The least constant C by a mesh and its refinements; infinite where rounding hides all of them.

    C^{-2} = lambda_h / (1 + KAPPA^2 h^2 lambda_h), h the longest edge (Proposition S15).
    """
    constant = math.inf
    while True:
        B, _ = crouzeix_raviart_matrix(mesh)
        is_free = np.ones(B.shape[0], dtype=bool)
        is_free[mesh.triangulation.boundary_edges[np.isin(mesh.side, clamped)]] = False
        mu = bound_eigenvalue(B[is_free][:, is_free])
        if mu > 0:
            # C^2 = 1 / mu + KAPPA^2 h^2 for mu <= lambda_h; on the exact domain it is larger by the factor
            constant = min(
                constant, mesh.exact_mesh_factor * math.sqrt(1 / mu + (KAPPA * mesh.diameter) ** 2)
            )
        if mesh.n_nodes >= MIN_FRIEDRICHS_NODES:
            return constant
        try:
            mesh = refine_uniformly(mesh)
        except InputError:  # edges as short as rounding
            return constant


def crouzeix_raviart_matrix(mesh: Mesh) -> tuple[sp.csr_array, Array]:
    """B = M^{-1/2} K M^{-1/2} (n, n) of the space of Crouzeix and Raviart, and the diagonal (n,) of M^{1/2}.

    K is the stiffness matrix on the n edges, and M the mass matrix, which is diagonal. Eigenvalues of B are
    those of |v|_1^2 over ||v||_0^2.
    """
    edges = mesh.opposite_edges
    n = len(mesh.triangulation.ends)
    # the function of edge i is 1 - 2 psi_i, i the opposite node; the midpoint rule is exact for its square
    function_gradients = -2 * gradients(mesh)
    stiffness = mesh.areas[:, None, None] * (function_gradients @ function_gradients.transpose(0, 2, 1))
    mass = np.bincount(edges.ravel(), np.repeat(mesh.areas / 3, 3), n)
    scaling = sp.diags_array(1 / np.sqrt(mass))
    return (scaling @ assemble_matrix(edges, stiffness, n) @ scaling).tocsr(), np.sqrt(mass)


def bound_eigenvalue(B: sp.csr_array) -> float:
    """A number mu that no eigenvalue of the symmetric B (n, n) is below; 0 if rounding hides it, or n < 2."""
    # `eigsh` needs two unknowns
    if B.shape[0] < 2:
        return 0.0
    order = reverse_cuthill_mckee(sp.csr_matrix(B), symmetric_mode=True)
    B = B[order][:, order]
    D = B.diagonal()
    # entries (b + 1, n) of B on and below its diagonal, as LAPACK stores them
    entries = sp.coo_array(sp.tril(B))
    below = entries.row - entries.col
    b = int(below.max(initial=0))
    band = np.zeros((b + 1, len(D)))
    band[below, entries.col] = entries.data
    # what rounding may do to A = B - shift D - mu (Higham, theorem 10.3, and Gershgorin, as above)
    shift = (b + 28) * (b + 1) * EPS
    try:
        factor = cholesky_banded(band, lower=True)
        inverse = LinearOperator(B.shape, lambda rhs: cho_solve_banded((factor, True), rhs))
        # an error of 1e-8 in x is one of 1e-16 in the eigenvalue; twenty vectors would take twice as long
        eigenvalue, x = eigsh(
            B, k=1, sigma=0.0, OPinv=inverse, v0=np.ones(len(D)), ncv=min(10, len(D)), tol=1e-8
        )
        # v . shift D v counts twice, for what it takes is of second order, too
        mu = EIGENVALUE_SHARE * float(eigenvalue[0] - 2 * shift * (D @ x[:, 0] ** 2))
        # that Cholesky's algorithm ends proves B >= mu
        band[0] -= mu + shift * D
        cholesky_banded(band, lower=True)
    except (LinAlgError, ArpackError):  # no factor, or the iteration for the eigenvalue does not end
        return 0.0
    return max(mu, 0.0)
