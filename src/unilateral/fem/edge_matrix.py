"""The matrix of a form (`form`) from the edges of a triangulation, without sorting entries.

An off-diagonal entry belongs to an edge: the sum over the triangles T at it of c |T| / 12, from the mass, and
of k times the product of the gradients of its ends' hats, from the stiffness, which is

    (e_j . e_k) / (4 |T|)      for the edge opposite to node i, e_j and e_k the other two edges.

The stiffness maps constants to 0, so the rows add up to those of the mass, c thirds of the area around the
node. That gives the diagonal. Then entries off the diagonal that belong to `fixed` nodes become 0.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Int32, Mask, row_blocks
from unilateral.fem.form import H1, Form
from unilateral.geometry.plane import corner_coordinates
from unilateral.geometry.refinement import CYCLIC_CORNERS, Triangulation

MATRIX_ROWS_PER_BLOCK = 1 << 17
"""This many rows of a matrix are made at a time: with their triangles they take some 90 MB."""


def edge_stiffness_and_areas(points: Array, triangles: Int32) -> tuple[Array, Array]:
    """The products of the hats' gradients (3, T), by edges, and the areas (T,) of the `triangles` (T, 3).

    Product i is (e_j . e_k) / (4 |T|), of the hats at the ends of the edge opposite to node i.
    """
    stiffness = np.empty(triangles.T.shape)
    area = np.empty(len(triangles))
    for block in row_blocks(len(triangles)):
        x, y = corner_coordinates(points, triangles[block])
        # (e_i, f_i) is the edge opposite to node i: |T| = e_2 x e_0 / 2, and e_j . e_k / (4 |T|)
        e = [x[k] - x[j] for _, j, k in CYCLIC_CORNERS]
        f = [y[k] - y[j] for _, j, k in CYCLIC_CORNERS]
        twice_area = e[2] * f[0] - f[2] * e[0]
        area[block] = 0.5 * twice_area
        for i, j, k in CYCLIC_CORNERS:
            np.divide(e[j] * e[k] + f[j] * f[k], 2 * twice_area, out=stiffness[i, block])
    return stiffness, area


def _edge_entries(points: Array, triangles: Int32, form: Form) -> tuple[Array, Array]:
    """Each triangle's contributions (3, T) to the matrix entries of its edges, and the areas (T,)."""
    stiffness, area = edge_stiffness_and_areas(points, triangles)
    return form.k * stiffness + form.c / 12 * area, area


def assemble_by_edges(
    triangulation: Triangulation, points: Array, form: Form = H1, fixed: Mask | None = None
) -> tuple[sp.csr_array, Array, Array]:
    """The matrix A of a form on a triangulation, the sums (n,) of its rows, and the lumped mass (n,).

    Rows of A (n, n) begin with the diagonal. Nodes that are `fixed` (n,) are decoupled from the others.
    """
    n = triangulation.n_nodes
    mass = np.zeros(triangulation.n_nodes)
    edge_values = np.zeros(len(triangulation.ends))
    for block in row_blocks(len(triangulation.nodes)):
        entries, area = _edge_entries(points, triangulation.nodes[block], form)
        for corner in range(3):
            np.add.at(mass, triangulation.nodes[block, corner], area / 3)
            np.add.at(edge_values, triangulation.edges[block, corner], entries[corner])
    # rows of the stiffness add up to 0: what the diagonal has is c (1, phi_i)_0 less the entries beside it
    sums = form.c * mass
    diagonal = sums.copy()
    for end in triangulation.ends.T:
        np.subtract.at(diagonal, end, edge_values)
    if fixed is not None and fixed.any():
        # entries between a fixed node and another one become 0, and the sums of rows follow
        fixed_edges = fixed[triangulation.ends].any(axis=1)
        for end in triangulation.ends[fixed_edges].T:
            np.subtract.at(sums, end, edge_values[fixed_edges])
        sums[fixed] = diagonal[fixed]
        edge_values[fixed_edges] = 0.0
    # the diagonal comes first, so that rows begin with it
    nodes = np.arange(n, dtype=np.int32)
    (a, b) = triangulation.ends.T
    A = _csr_from_distinct_entries(
        np.concatenate([diagonal, edge_values, edge_values]),
        rows=np.concatenate([nodes, a, b]),
        columns=np.concatenate([nodes, b, a]),
        shape=(n, n),
    )
    return A, sums, mass


def assemble_rows(
    points: Array, triangles: Int32, row_nodes: Int32, n: int, form: Form, fixed: Mask
) -> sp.csr_array:
    """The rows (k, n) of the matrix of a form that belong to some nodes, the diagonal among the others.

    `triangles` has all at these nodes. Nodes that are `fixed` (n,) are decoupled from the others.
    """
    blocks = [
        _assemble_row_block(points, triangles, row_nodes[block], n, form, fixed)
        for block in row_blocks(len(row_nodes), MATRIX_ROWS_PER_BLOCK)
    ]
    return sp.vstack(blocks, format="csr") if blocks else sp.csr_array((0, n))


def _assemble_row_block(
    points: Array, triangles: Int32, row_nodes: Int32, n: int, form: Form, fixed: Mask
) -> sp.csr_array:
    """The rows (k, n) that belong to some nodes, assembled at once.

    Corners of triangles stand anticlockwise. So an edge from a node leads to the next corner in at most one
    triangle, and to the last corner in at most one. Two matrices with distinct entries, one for each, then
    add up to the part off the diagonal.
    """
    row_number = np.full(n, -1, dtype=np.int32)
    row_number[row_nodes] = np.arange(len(row_nodes), dtype=np.int32)
    triangles = triangles[(row_number[triangles] >= 0).any(axis=1)]
    edge_values, area = _edge_entries(points, triangles, form)
    # every corner of a triangle that is one of the row nodes
    corner, triangle = np.nonzero(row_number[triangles.T] >= 0)
    rows = row_number[triangles[triangle, corner]]
    diagonal = np.zeros(len(row_nodes))
    # as in `assemble_by_edges`: a row adds up to c thirds of the area around its node
    np.add.at(diagonal, rows, form.c * area[triangle] / 3)
    shape = (len(row_nodes), n)
    off_diagonal = sp.csr_array(shape)
    # the next corner i + 1 lies on the edge opposite to i + 2, the last one i + 2 on that opposite to i + 1
    for step, opposite in ((1, 2), (2, 1)):
        columns = triangles[triangle, (corner + step) % 3]
        values = edge_values[(corner + opposite) % 3, triangle]
        np.subtract.at(diagonal, rows, values)
        values = np.where(fixed[columns] | fixed[row_nodes[rows]], 0.0, values)
        off_diagonal = off_diagonal + _csr_from_distinct_entries(values, rows, columns, shape)
    return off_diagonal + _csr_from_distinct_entries(
        diagonal, np.arange(len(row_nodes), dtype=np.int32), row_nodes, shape
    )


def _csr_from_distinct_entries(
    values: Array, rows: Int32, columns: Int32, shape: tuple[int, int]
) -> sp.csr_array:
    """The matrix with these entries, of which no two may be in one place."""
    entries = sp.coo_array((values, (rows, columns)), shape=shape)
    # said to be free of double entries, so that SciPy neither looks for any nor sorts rows
    entries.has_canonical_format = True
    return entries.tocsr()
