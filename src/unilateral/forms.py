"""P1 matrices and loads: the paper's (u, v)_1 and (f, v)_0 on V_h."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from unilateral.mesh import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.intp]


def gradients(mesh: Mesh) -> tuple[Array, Array]:
    """Gradients (m, 3, 2) of the barycentric functions of each triangle, and the areas (m,)."""
    corners = mesh.points[mesh.triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    first, second = opposite[:, 1], opposite[:, 2]
    twice_area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return turned / twice_area[:, None, None], 0.5 * twice_area


def stiffness_and_mass(mesh: Mesh) -> tuple[sp.csr_array, sp.csr_array]:
    """Stiffness K and mass M (n, n); K + M is the matrix of the paper's (., .)_1."""
    slopes, areas = gradients(mesh)
    stiffness = areas[:, None, None] * (slopes @ slopes.transpose(0, 2, 1))
    mass = areas[:, None, None] * ((np.ones((3, 3)) + np.eye(3)) / 12)
    return _assemble(mesh, stiffness), _assemble(mesh, mass)


def load(mesh: Mesh, triangle: Ints, barycentric: Array, weighted_values: Array) -> Array:
    """(n,) sums over quadrature points q of w_q f(x_q) phi_i(x_q).

    Point q lies in `triangle` (Q,) at `barycentric` (Q, 3); `weighted_values` (Q,) are w_q f(x_q).
    """
    return _scatter(mesh, triangle, barycentric * weighted_values[:, None])


def h1_load(
    mesh: Mesh, triangle: Ints, barycentric: Array, weighted_values: Array, weighted_gradients: Array
) -> Array:
    """(n,) values of (u, phi_i)_1 by quadrature; `weighted_gradients` (Q, 2), the rest as in `load`."""
    slopes, _ = gradients(mesh)
    of_gradients = np.einsum("qid,qd->qi", slopes[triangle], weighted_gradients)
    return _scatter(mesh, triangle, of_gradients + barycentric * weighted_values[:, None])


def _assemble(mesh: Mesh, blocks: Array) -> sp.csr_array:
    rows = np.repeat(mesh.triangles, 3, axis=1).ravel()
    columns = np.tile(mesh.triangles, (1, 3)).ravel()
    n = len(mesh.points)
    return sp.coo_array((blocks.ravel(), (rows, columns)), shape=(n, n)).tocsr()


def _scatter(mesh: Mesh, triangle: Ints, contributions: Array) -> Array:
    nodes = mesh.triangles[triangle].ravel()
    sums = np.bincount(nodes, weights=contributions.ravel(), minlength=len(mesh.points))
    return sums.astype(float, copy=False)
