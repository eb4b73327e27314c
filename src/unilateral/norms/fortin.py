"""A guaranteed lower bound on beta of (3.4), by a Fortin operator and without an eigenvalue problem.

Let I v have the means of v over all edges and be linear on each triangle, after Crouzeix and Raviart. On a
triangle T grad I v is the mean of grad v, so |v|_1^2 = |I v|_1^2 + |v - I v|_1^2. Let A be the averages of
`nodal_averages`. On cell i let W_i in V_h have as its trace a hat at a node inside the cell, which falls to 0
at the next of these nodes, or at an end of the cell that is a node. With y such that the integrals over all
cells agree,

    P v = A I v + sum_i y_i W_i,   <mu, P v> = <mu, v> for all mu in P0(T_H),

so beta >= 1 / ||P||. The proposition is in supplement.md, "A computed lower bound on beta".

Everything is linear in the numbers |T|^{1/2} grad I v, and in |v - I v|_{1,T} for the triangles T at an edge
that an end of a cell cuts. `Majorant` has their coefficients without signs. For a matrix M of numbers >= 0,
||M||^2 is the spectral radius of M M^T, so it is at most max_i (M M^T x)_i / x_i for every x > 0 (Collatz).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from unilateral.arrays import Array, Index
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import coupling, gradients
from unilateral.fem.poincare import KAPPA
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.nodal_averages import deviation_matrix
from unilateral.norms.oscillation import trace_constants
from unilateral.norms.resolution import CELL_ROUND_OFF, innermost_nodes

COLLATZ_STEPS = 8
"""So often x is replaced by M M^T x. More steps change rho by about a per cent; for n one is enough."""
COLLATZ_SHIFT = 1e-2
"""Each step adds this part of x, so that x stays positive."""
MIN_FORTIN_DELTA = 1e-4
MAX_FORTIN_ASPECT = 1e5
FORTIN_ROUNDING_FACTOR = 1 + 1e-7
"""This covers rounding where delta is not smaller, and no d_T^2/|T| larger, than these.

With eps the unit round-off, that of `pairing` is about eps/delta, and that of `gradients` at most 1000 eps
times d_T^2/|T|. All other sums are of numbers >= 0.
"""


def beta_lower_bound(mesh: Mesh, partition: Partition, form: Form = H1) -> float:
    """A guaranteed lower bound on beta for the functions, the norm and the multipliers of the form.

    P v vanishes on clamped sides, as v does. The bound is 0, which says nothing, where a cell has no node
    well inside or a triangle is too thin.
    """
    cells = np.flatnonzero(form.has_multiplier(partition.side))
    if not len(cells):
        return 1.0
    delta = innermost_nodes(mesh.s, partition)[1][cells].min()
    aspect = mesh.longest_edges**2 / mesh.areas
    if delta < MIN_FORTIN_DELTA or aspect.max() > MAX_FORTIN_ASPECT:
        return 0.0
    # beta >= 1 / ||P|| (Proposition S1), for |P v|_1 <= rho |v|_1 and, for c > 0, ||v - P v||_0 <= n |v|_1
    majorant = build_majorant(mesh, partition, cells, form)
    P_norm = collatz_norm(majorant, majorant.gradients, majorant.W_gradients)
    if form.c:
        n = collatz_norm(majorant, majorant.values, majorant.W_values, steps=1) + KAPPA * mesh.diameter
        P_norm = operator_norm_bound(P_norm, math.sqrt(form.c / form.k) * n)
    return 1 / (FORTIN_ROUNDING_FACTOR * mesh.exact_mesh_factor**2 * P_norm)


def operator_norm_bound(rho: float, n: float) -> float:
    """A bound on ||P|| if |P v|_1 <= rho |v|_1 and (c/k)^{1/2} ||v - P v||_0 <= n |v|_1 for all v."""
    # for a = k^{1/2} |v|_1, b = c^{1/2} ||v||_0 ||P v||^2 is at most rho^2 a^2 + (b + n a)^2, a form in a, b;
    # its largest eigenvalue is the bound's square, as ||v||^2 = a^2 + b^2
    return math.sqrt(float(np.linalg.eigvalsh([[rho**2 + n**2, n], [n, 1.0]])[-1]))


class Majorant(NamedTuple):
    """The coefficients of P v in the numbers g (2m,), |T|^{1/2} grad I v, and t (k,), |v - I v|_{1,T}.

    All are without signs. `gradients` (2m, 2m) give |T|^{1/2} grad A I v from g, and `values` (3m, 2m) give
    |T|^{1/2} / 3^{1/2} times A I v - I v at corners, whose Euclidean norm is at least the one in L2.
    `W_gradients` (2m, cells) and `W_values` (3m, cells) are the same for the W_i. With the means of v - A I v
    over cells from `means` (cells, 2m) g and `cut_terms` (cells, k) t, `pairing` (cells, cells) y is at most
    these; its inverse has no negative entries.
    """

    gradients: sp.csr_array
    values: sp.csr_array
    W_gradients: sp.csr_array
    W_values: sp.csr_array
    means: sp.csr_array
    cut_terms: sp.csr_array
    pairing: sp.csc_array


def build_majorant(mesh: Mesh, partition: Partition, cells: Index, form: Form = H1) -> Majorant:
    """The majorant of the Fortin operator P for the multipliers on some cells, each with a node inside."""
    innermost, deltas = innermost_nodes(mesh.s, partition)
    # knots: the innermost node of each cell, and the nodes that are ends of cells
    nodes = mesh.s[:-1]
    points = partition.points
    nearest = points[np.searchsorted(0.5 * (points[1:] + points[:-1]), nodes)]
    ends = nodes[np.abs(nodes - nearest) <= CELL_ROUND_OFF * partition.lengths.min()]
    knots = np.unique(np.concatenate([innermost[deltas > 0], ends]))
    # W_i, a hat at the innermost node of cell i between the next of the knots
    W = extend_hats(mesh, knots)[:, np.searchsorted(knots, innermost[cells])]
    W_at_corners = W[mesh.triangles.ravel()]
    # the integrals of W_j over cell i, with a minus off the diagonal: an M-matrix
    pairing = (coupling(mesh, partition)[cells] @ W[mesh.boundary]).tocsc()
    pairing = 2 * sp.diags_array(pairing.diagonal()) - pairing
    # A I v - I v at corners, and its integrals over cells
    deviations = deviation_matrix(mesh, form)
    means = _cell_integral_matrix(mesh, partition)[cells] @ deviations
    # grad A I v = grad I v + grad (A I v - I v)
    to_gradients = _gradient_matrix(mesh)
    averaged = to_gradients @ deviations
    averaged.setdiag(averaged.diagonal() + 1)
    # drop_signs changes its argument, so it comes after the products
    scale = np.repeat(np.sqrt(mesh.areas / 3), 3)
    return Majorant(
        gradients=drop_signs(averaged),
        values=drop_signs(deviations, scale),
        W_gradients=drop_signs(to_gradients @ W_at_corners),
        W_values=drop_signs(W_at_corners, scale),
        means=drop_signs(means),
        cut_terms=_cut_term_matrix(mesh, partition)[cells],
        pairing=pairing.tocsc(),
    )


def drop_signs(matrix: sp.csr_array, scale: Array | None = None) -> sp.csr_array:
    """The matrix without its signs, each row times its `scale` (rows,) > 0; in its own memory."""
    np.abs(matrix.data, out=matrix.data)
    if scale is not None:
        matrix.data *= np.repeat(scale, np.diff(matrix.indptr))
    return matrix


def _gradient_matrix(mesh: Mesh) -> sp.csr_array:
    """The matrix from values at the corners of triangles to |T|^{1/2} times the gradient, (2m, 3m)."""
    m = len(mesh.triangles)
    entries = (gradients(mesh) * np.sqrt(mesh.areas)[:, None, None]).transpose(0, 2, 1)
    columns = np.repeat(np.arange(3 * m).reshape(m, 3), 2, axis=0)
    return sp.csr_array((entries.ravel(), columns.ravel(), np.arange(0, 6 * m + 1, 3)), shape=(2 * m, 3 * m))


def _cell_integral_matrix(mesh: Mesh, partition: Partition) -> sp.csr_array:
    """The matrix from the values of A I v - I v at corners to minus its integrals over cells, (cells, 3m)."""
    # each part between ends of cells and nodes is a share of its edge; its middle is at x, from 0 to 1
    points, cell, edge = overlay(partition.points, mesh.s)
    lengths = np.diff(mesh.s)[edge]
    shares = np.diff(points) / lengths
    x = (0.5 * (points[1:] + points[:-1]) - mesh.s[edge]) / lengths
    triangle = mesh.boundary_triangles[edge]
    first = np.argmax(mesh.triangles[triangle] == mesh.boundary[edge][:, None], axis=1)
    corners = np.concatenate([3 * triangle + first, 3 * triangle + (first + 1) % 3])
    # the integral of a linear function over a part is its length times the value in the middle
    values = -np.concatenate([lengths * shares * (1 - x), lengths * shares * x])
    shape = (partition.n_cells, 3 * len(mesh.triangles))
    return sp.coo_array((values, (np.tile(cell, 2), corners)), shape=shape).tocsr()


def _cut_term_matrix(mesh: Mesh, partition: Partition) -> sp.csr_array:
    """The matrix (cells, k) from |v - I v|_{1,T}, T at cut edges, to bounds on the integrals of v - I v."""
    # with w = v - I v and a part of an edge e that is the share p of it, the integral of w over the part is
    # at most (|e| p (1 - p))^{1/2} ||w||_{0,e}, as its integral over e is 0, and ||w||_{0,e}^2 is at most
    # |e|/|T| (KAPPA^2 d^2 + a KAPPA d) |w|_{1,T}^2 (`oscillation`)
    points, cell, edge = overlay(partition.points, mesh.s)
    lengths = np.diff(mesh.s)[edge]
    p = np.diff(points) / lengths
    cut = np.flatnonzero(p < 1)
    bounds = np.sqrt(lengths * p * (1 - p))[cut] * np.sqrt(trace_constants(mesh, KAPPA))[edge[cut]]
    _, column = np.unique(mesh.boundary_triangles[edge[cut]], return_inverse=True)
    return sp.coo_array((bounds, (cell[cut], column)), shape=(partition.n_cells, max(len(cut), 1))).tocsr()


def collatz_norm(
    majorant: Majorant, rows: sp.csr_array, W_rows: sp.csr_array, steps: int = COLLATZ_STEPS
) -> float:
    """The norm of v -> rows g + W_rows y by Collatz's bound."""
    # M = (rows + W_rows pairing^{-1} means, W_rows pairing^{-1} cut_terms), applied as M M^T
    solve = splu(majorant.pairing)
    x = np.ones(rows.shape[0])
    for _ in range(steps):
        x = x / x.max()
        y = solve.solve(W_rows.T @ x, trans="T")
        image = rows.T @ x + majorant.means.T @ y, majorant.cut_terms.T @ y
        means = majorant.means @ image[0] + majorant.cut_terms @ image[1]
        square = rows @ image[0] + W_rows @ solve.solve(means)
        # Collatz: the spectral radius of M M^T is at most max (M M^T x)_i / x_i
        quotient = float((square / x).max())
        x = square + COLLATZ_SHIFT * x
    return math.sqrt(quotient)


def extend_hats(mesh: Mesh, knots: Array) -> sp.csr_array:
    """W (n, k): nodal values of functions in V_h whose traces are hats at the boundary nodes (k,) of these s.

    Each falls to 0 at the next of them. Inside values fall along edges, from one layer of nodes to the next,
    by 1 over the shorter half of the hat's support.
    """
    widths = np.diff(knots, append=knots[0] + mesh.polygon.perimeter)
    W = _boundary_hats(mesh, knots, widths)
    reach = np.minimum(widths, np.roll(widths, 1))
    ends = mesh.triangulation.ends
    start, end = np.concatenate([ends, ends[:, ::-1]]).astype(np.intp).T
    has_value = np.isin(np.arange(mesh.n_nodes), mesh.boundary)
    while True:
        onward = np.flatnonzero(has_value[start] & ~has_value[end])
        layer = _values_of_next_layer(mesh, W, start[onward], end[onward], reach)
        W = W + layer
        if not layer.nnz:
            return W
        has_value[end[onward]] = True


def _boundary_hats(mesh: Mesh, knots: Array, widths: Array) -> sp.csr_array:
    """The values (n, k) of the hats at boundary nodes; `widths` (k,) are the distances to the next knots."""
    # each node has the values of two hats, at the knots before and after it
    before = (np.searchsorted(knots, mesh.s[:-1], side="right") - 1) % len(knots)
    t = (mesh.s[:-1] - knots[before]) % mesh.polygon.perimeter / widths[before]
    nodes = np.tile(mesh.boundary, 2)
    hats = np.concatenate([before, (before + 1) % len(knots)])
    values = np.concatenate([1 - t, t])
    return sp.coo_array((values, (nodes, hats)), shape=(mesh.n_nodes, len(knots))).tocsr()


def _values_of_next_layer(
    mesh: Mesh, W: sp.csr_array, start: Index, end: Index, reach: Array
) -> sp.csr_array:
    """The values (n, k) > 0 at the nodes `end` of edges from nodes `start`, which have their values in W.

    They are the largest of the neighbours' values, less the edges' lengths over the `reach` (k,) of the hats.
    """
    lengths = np.linalg.norm(mesh.points[start] - mesh.points[end], axis=1)
    near = W[start].tocoo()
    edges, hats = near.coords
    lowered = near.data - lengths[edges] / reach[hats]
    # a node and a hat are one place; several edges may lead there
    places, place_numbers = np.unique((end[edges] * W.shape[1] + hats)[lowered > 0], return_inverse=True)
    values = np.zeros(len(places))
    np.maximum.at(values, place_numbers, lowered[lowered > 0])
    return sp.coo_array((values, np.divmod(places, W.shape[1])), shape=W.shape).tocsr()
