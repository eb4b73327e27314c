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

from unilateral.arrays import Array, Int32, Mask, blocks
from unilateral.fem.form import H1, Form
from unilateral.geometry.refinement import Triangulation

ROWS = 1 << 17
"""This many rows of a matrix are made at a time: with their triangles they take some 90 MB."""


def elements(points: Array, nodes: Int32) -> tuple[Array, Array]:
    """The products (T, 3) that belong to the edges opposite to the `nodes` (T, 3), and the areas (T,)."""
    stiffness = np.empty(nodes.shape)
    area = np.empty(len(nodes))
    for of in blocks(len(nodes)):
        (x, y) = points.T[:, nodes[of].T]
        e = x[[2, 0, 1]] - x[[1, 2, 0]]
        f = y[[2, 0, 1]] - y[[1, 2, 0]]
        area[of] = 0.5 * (e[2] * f[0] - f[2] * e[0])
        product = e[[1, 2, 0]] * e[[2, 0, 1]] + f[[1, 2, 0]] * f[[2, 0, 1]]
        stiffness[of] = (0.25 * product / area[of]).T
    return stiffness, area


def _entries(form: Form, stiffness: Array, area: Array) -> Array:
    """(T, 3) the parts of triangles in the entries of their edges."""
    return form.k * stiffness + (form.c * area / 12)[:, None]


def matrix(
    tri: Triangulation, points: Array, form: Form = H1, fixed: Mask | None = None
) -> tuple[sp.csr_array, Array, Array]:
    """The matrix A of those triangles and of a form, in which some nodes (n,) may be `fixed`.

    A (n, n) has rows that begin with the diagonal. With it come the sums (n,) of its rows, and the lumped
    mass (n,).
    """
    n = tri.n
    mass = np.zeros(tri.n)
    beside = np.zeros(len(tri.ends))
    for of in blocks(len(tri.nodes)):
        stiffness, area = elements(points, tri.nodes[of])
        np.add.at(mass, tri.nodes[of].ravel(), np.repeat(area / 3, 3))
        np.add.at(beside, tri.edges[of].ravel(), _entries(form, stiffness, area).ravel())
    sums = form.c * mass
    diagonal = sums.copy()
    for end in tri.ends.T:
        np.subtract.at(diagonal, end, beside)
    if fixed is not None and fixed.any():
        cut = fixed[tri.ends].any(axis=1)
        for end in tri.ends[cut].T:
            np.subtract.at(sums, end, beside[cut])
        sums[fixed] = diagonal[fixed]
        beside[cut] = 0.0
    every = np.arange(n, dtype=np.int32)
    (a, b) = tri.ends.T
    places = np.concatenate([every, a, b]), np.concatenate([every, b, a])
    return _once(np.concatenate([diagonal, beside, beside]), *places, (n, n)), sums, mass


def some_rows(points: Array, nodes: Int32, chosen: Int32, n: int, form: Form, fixed: Mask) -> sp.csr_array:
    """(k, n) the rows of the nodes (k,) alone, from the triangles with those nodes (T, 3); see `matrix`."""
    parts = [_rows(points, nodes, chosen[of], n, form, fixed) for of in blocks(len(chosen), ROWS)]
    return sp.vstack(parts, format="csr") if parts else sp.csr_array((0, n))


def _rows(points: Array, nodes: Int32, chosen: Int32, n: int, form: Form, fixed: Mask) -> sp.csr_array:
    """(k, n) the rows of some nodes (k,), as in `some_rows`.

    Each edge from an inner node leads to the next node of one triangle and to the last node of another.
    """
    place = np.full(n, -1, dtype=np.int32)
    place[chosen] = np.arange(len(chosen), dtype=np.int32)
    some = np.flatnonzero((place[nodes] >= 0).any(axis=1))
    (stiffness, area) = elements(points, nodes[some])
    corners = nodes[some].T
    beside = _entries(form, stiffness, area).T
    row = place[corners]
    at = [np.flatnonzero(each >= 0) for each in row]
    rows = np.concatenate([each[here] for each, here in zip(row, at, strict=True)])
    diagonal = np.zeros(len(chosen))
    shape = (len(chosen), n)
    np.add.at(diagonal, rows, form.c * np.concatenate([area[here] for here in at]) / 3)
    off_diagonal = sp.csr_array(shape)
    for to, opposite in ((1, 2), (2, 1)):
        columns = np.concatenate([corners[(i + to) % 3][here] for i, here in enumerate(at)])
        values = np.concatenate([beside[(i + opposite) % 3][here] for i, here in enumerate(at)])
        np.subtract.at(diagonal, rows, values)
        values = np.where(fixed[columns] | fixed[chosen[rows]], 0.0, values)
        off_diagonal = off_diagonal + _once(values, rows, columns, shape)
    return off_diagonal + _once(diagonal, np.arange(len(chosen), dtype=np.int32), chosen, shape)


def _once(values: Array, rows: Int32, columns: Int32, shape: tuple[int, int]) -> sp.csr_array:
    """The matrix with these entries. No two of them are in one place, and none such are looked for."""
    entries = sp.coo_array((values, (rows, columns)), shape=shape)
    entries.has_canonical_format = True
    return entries.tocsr()
