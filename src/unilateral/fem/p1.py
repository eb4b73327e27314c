"""P1: matrices, loads and norms, the paper's (u, v)_1 and (f, v)_0 on V_h, and the pairing <mu_H, v_h>."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.errors import InputError
from unilateral.fem.form import H1, Form
from unilateral.fem.quadrature import triangle_rules
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.geometry.plane import corner_coordinates

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution


MESH_BLOCK_TRIANGLES = 1 << 16
"""This many triangles are treated together: such a part of a mesh takes some 10 MB."""


def gradients(mesh: Mesh) -> Array:
    """Gradients (m, 3, 2) of the barycentric functions of each triangle."""
    # grad psi_i is the opposite edge, turned by 90 degrees, over 2 |T|
    corners = mesh.points[mesh.triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return np.asarray(turned / (2 * mesh.areas)[:, None, None])


def stiffness_and_mass(mesh: Mesh) -> tuple[sp.csr_array, sp.csr_array]:
    """Stiffness K and mass M (n, n); K + M is the matrix of the paper's (., .)_1."""
    hat_gradients = gradients(mesh)
    areas = mesh.areas
    # |T| grad psi_i . grad psi_j, and |T| (1 + delta_ij) / 12
    stiffness = areas[:, None, None] * (hat_gradients @ hat_gradients.transpose(0, 2, 1))
    mass = areas[:, None, None] * ((np.ones((3, 3)) + np.eye(3)) / 12)
    n = mesh.n_nodes
    return assemble_matrix(mesh.triangles, stiffness, n), assemble_matrix(mesh.triangles, mass, n)


def assemble_matrix(unknowns: Index, entries: Array, n: int) -> sp.csr_array:
    """The sum of element matrices, each added at its unknowns; shape (n, n)."""
    k = unknowns.shape[1]
    rows = np.repeat(unknowns, k, axis=1).ravel()
    columns = np.tile(unknowns, (1, k)).ravel()
    return sp.coo_array((entries.ravel(), (rows, columns)), shape=(n, n)).tocsr()


def load_vector(mesh: Mesh, moments: Array) -> Array:
    """The load (f, phi_i), from the moments of f against each triangle's hats; shape (n,)."""
    load = np.zeros(mesh.n_nodes)
    add_moments(load, mesh.triangles, moments)
    return load


def add_moments(load: Array, triangles: Index, moments: Array) -> None:
    """Add the moments (k, 3) of some triangles (k, 3) to the load (n,), in place."""
    for nodes, nodal_moments in zip(triangles.T, moments.T, strict=True):
        np.add.at(load, nodes, nodal_moments)


def mesh_blocks(mesh: Mesh) -> Iterator[Mesh]:
    """The mesh in blocks, each with all nodes and some of the triangles."""
    for block in row_blocks(len(mesh.triangles), MESH_BLOCK_TRIANGLES):
        yield mesh.select_triangles(np.arange(block.start, block.stop))


def assemble_load_by_blocks(mesh: Mesh, moments: Callable[[Mesh], Array]) -> Array:
    """The load (f, phi_i), from the moments of f on one block of triangles after another; shape (n,)."""
    values = np.zeros(mesh.n_nodes)
    for block in mesh_blocks(mesh):
        add_moments(values, block.triangles, moments(block))
    return values


def case_moments(case: ExactSolution, mesh: Mesh) -> Array:
    """The moments (m, 3) of a case's source, by a quadrature that sees its singular points and kinks."""
    moments = np.zeros((len(mesh.triangles), 3))
    for rule in triangle_rules(mesh, case):
        f = case.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(moments, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
    return moments


def linear_moments(areas: Array, f: Array) -> Array:
    """The moments (m, 3) of a function that is linear on each triangle, from its values at the corners.

    (f, psi_i)_T = |T| / 12 (f_i + f_1 + f_2 + f_3).
    """
    return areas[:, None] / 12 * (f + f.sum(axis=1, keepdims=True))


def lumped_mass(mesh: Mesh) -> Array:
    """A third of the area around each node, which is (1, phi_i); shape (n,)."""
    return load_vector(mesh, np.repeat(mesh.areas[:, None] / 3, 3, axis=1))


def edge_load(mesh: Mesh, values: Array) -> Array:
    """The load <sigma, phi_i> (n,) of a sigma that is linear on boundary edges, from its values at the ends.

    On an edge e the hat of its end a has the part |e| / 6 (2 sigma_a + sigma_b).
    """
    at_ends = np.diff(mesh.s)[:, None] / 6 * (values + values.sum(axis=1, keepdims=True))
    total = np.zeros(mesh.n_nodes)
    total[mesh.boundary] = at_ends[:, 0] + np.roll(at_ends[:, 1], 1)
    return total


def project_to_linear(mesh: Mesh, edge: Index, x: Array, weight: Array, values: Array) -> Array:
    """The L2 projection of a function to linear ones on boundary edges, by its values (nb, 2) at the ends.

    The function has the `values` (K, Q) at the points x in [0, 1] of K rules, which lie on the edges `edge`
    (K,) and have the weights `weight` (K, Q).
    """
    first = np.bincount(edge, np.sum(weight * values * (1 - x), axis=1), len(mesh.boundary))
    second = np.bincount(edge, np.sum(weight * values * x, axis=1), len(mesh.boundary))
    # the inverse of |e| / 6 (2 1; 1 2) is 2 / |e| (2 -1; -1 2)
    ends = np.column_stack([2 * first - second, 2 * second - first])
    return np.asarray(2 * ends / np.diff(mesh.s)[:, None])


def h1_load(mesh: Mesh, hat_gradients: Array, moments: Array, gradient_integrals: Array) -> Array:
    """The load (u, phi_i)_1, from the moments of u and the integrals of its gradient; shape (n,)."""
    return load_vector(mesh, moments + np.einsum("tid,td->ti", hat_gradients, gradient_integrals))


def coupling(mesh: Mesh, partition: Partition) -> sp.csr_array:
    """B (cells, boundary nodes): B[i, j] is the integral of the boundary node j's hat over cell i.

    So <mu_H, v_h> = mu . B v on the boundary values v of v_h, and B v / H_i are v_h's cell means.
    Raises InputError if the partition belongs to another polygon than the mesh.
    """
    if not np.array_equal(mesh.polygon.vertices, partition.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    points, cell, edge = overlay(partition.points, mesh.s)
    nb = len(mesh.boundary)
    length = np.diff(points)
    # on a piece of an edge the hats of its ends have the integrals |piece| (1 - x), |piece| x, x its middle
    position = (0.5 * (points[1:] + points[:-1]) - mesh.s[edge]) / np.diff(mesh.s)[edge]
    values = np.concatenate([length * (1 - position), length * position])
    columns = np.concatenate([edge, (edge + 1) % nb])
    return sp.coo_array((values, (np.tile(cell, 2), columns)), shape=(partition.n_cells, nb)).tocsr()


def subtract_lift_from_load(mesh: Mesh, form: Form, load: Array, dirichlet_lift: Array) -> Array:
    """The load (n,) for v - u_D, from the load for v, u_D being the Dirichlet lift; 0 at clamped nodes."""

    def form_moments(block: Mesh) -> Array:
        """k (grad u_D, grad psi_i) + c (u_D, psi_i) on each triangle."""
        hat_gradients = gradients(block)
        values = dirichlet_lift[block.triangles]
        along = np.einsum("tid,tjd,tj->ti", hat_gradients, hat_gradients, values)
        return form.k * block.areas[:, None] * along + form.c * linear_moments(block.areas, values)

    near = mesh.select_triangles(np.flatnonzero(dirichlet_lift[mesh.triangles].any(axis=1)))
    return np.where(form.clamped_nodes(mesh), 0.0, load - assemble_load_by_blocks(near, form_moments))


def boundary_mass(mesh: Mesh, edges: Mask | None = None) -> sp.csr_array:
    """The mass matrix of the boundary hats, on the whole boundary or on some of its edges; shape (nb, nb)."""
    nb = len(mesh.boundary)
    sixth = np.diff(mesh.s) / 6 * (1 if edges is None else edges)
    start = np.arange(nb)
    ends = np.column_stack([start, (start + 1) % nb])
    return assemble_matrix(ends, sixth[:, None, None] * np.array([[2, 1], [1, 2]]), nb)


def energy_norm(mesh: Mesh, v: Array, form: Form = H1) -> float:
    """||v|| = (k |v|_1^2 + c ||v||_0^2)^{1/2} of v (n,), triangle by triangle.

    In v . A v the gradient of a constant would not cancel. The norm is computed in units of the largest
    value, for squares of tiny and of huge ones vanish or overflow.
    """
    unit = float(np.abs(v).max(initial=0.0))
    if not 0 < unit < math.inf:
        return unit
    square = 0.0
    for block in row_blocks(len(mesh.triangles)):
        nodal = v.take(mesh.triangles[block].T) / unit
        x, y = corner_coordinates(mesh.points, mesh.triangles[block])
        # 2 |T| grad v, turned, from differences to the first node; and the mean of v^2 over T
        rise_1 = nodal[1] - nodal[0]
        rise_2 = nodal[2] - nodal[0]
        along_x = rise_1 * (x[2] - x[0]) - rise_2 * (x[1] - x[0])
        along_y = rise_1 * (y[2] - y[0]) - rise_2 * (y[1] - y[0])
        gradient_squares = 0.25 * (along_x**2 + along_y**2) / mesh.areas[block]
        mean_squares = (nodal.sum(axis=0) ** 2 + (nodal**2).sum(axis=0)) / 12
        square += form.k * float(np.sum(gradient_squares))
        square += form.c * float(mesh.areas[block] @ mean_squares)
    return unit * math.sqrt(square)
