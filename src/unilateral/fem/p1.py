"""P1: matrices, loads and norms, the paper's (u, v)_1 and (f, v)_0 on V_h, and the pairing <mu_H, v_h>."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Mask, blocks
from unilateral.errors import InputError
from unilateral.fem.form import H1, Form
from unilateral.fem.quadrature import triangle_rules
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution

SAMPLED = 8
"""The degree of the rule on triangles for an f that is known in points only."""

PART = 1 << 16
"""This many triangles are treated together: such a part of a mesh takes some 10 MB."""


def gradients(mesh: Mesh) -> Array:
    """Gradients (m, 3, 2) of the barycentric functions of each triangle."""
    corners = mesh.points[mesh.triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return np.asarray(turned / (2 * mesh.areas)[:, None, None])


def stiffness_and_mass(mesh: Mesh) -> tuple[sp.csr_array, sp.csr_array]:
    """Stiffness K and mass M (n, n); K + M is the matrix of the paper's (., .)_1."""
    slopes = gradients(mesh)
    areas = mesh.areas
    stiffness = areas[:, None, None] * (slopes @ slopes.transpose(0, 2, 1))
    mass = areas[:, None, None] * ((np.ones((3, 3)) + np.eye(3)) / 12)
    n = mesh.n_nodes
    return from_elements(mesh.triangles, stiffness, n), from_elements(mesh.triangles, mass, n)


def from_elements(unknowns: Index, entries: Array, n: int) -> sp.csr_array:
    """(n, n) the sum of matrices `entries` (m, k, k), which belong to the `unknowns` (m, k)."""
    k = unknowns.shape[1]
    rows = np.repeat(unknowns, k, axis=1).ravel()
    columns = np.tile(unknowns, (1, k)).ravel()
    return sp.coo_array((entries.ravel(), (rows, columns)), shape=(n, n)).tocsr()


def load_vector(mesh: Mesh, moments: Array) -> Array:
    """(n,) values of (f, phi_i), from the moments (m, 3) of f against each triangle's hats."""
    return np.bincount(mesh.triangles.ravel(), moments.ravel(), len(mesh.points)).astype(float)


def parts(mesh: Mesh) -> Iterator[Mesh]:
    """The mesh in blocks, each with all nodes and some of the triangles."""
    for of in blocks(len(mesh.triangles), PART):
        yield mesh.part(np.arange(of.start, of.stop))


def by_parts(mesh: Mesh, moments: Callable[[Mesh], Array]) -> Array:
    """(n,) values of (f, phi_i), from the moments (m, 3) on each part, in little memory."""
    values = np.zeros(mesh.n_nodes)
    for part in parts(mesh):
        np.add.at(values, part.triangles, moments(part))
    return values


def case_moments(case: ExactSolution, mesh: Mesh) -> Array:
    """(m, 3) the moments of a case's f, by a quadrature that sees the case's singular points and kinks."""
    moments = np.zeros((len(mesh.triangles), 3))
    for rule in triangle_rules(mesh, case):
        f = case.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(moments, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
    return moments


def linear_moments(areas: Array, f: Array) -> Array:
    """(m, 3) the moments of a function that is linear on triangles, with the values f (m, 3) at vertices."""
    return areas[:, None] / 12 * (f + f.sum(axis=1, keepdims=True))


def lumped_mass(mesh: Mesh) -> Array:
    """(n,) a third of the area around each node: values of (1, phi_i), and the sums of the rows of K + M."""
    return load_vector(mesh, np.repeat(mesh.areas[:, None] / 3, 3, axis=1))


def edge_load(mesh: Mesh, values: Array) -> Array:
    """(n,) values <sigma, phi_i> for sigma linear on boundary edges, with `values` (nb, 2) at their ends."""
    at_ends = np.diff(mesh.s)[:, None] / 6 * (values + values.sum(axis=1, keepdims=True))
    total = np.zeros(mesh.n_nodes)
    total[mesh.boundary] = at_ends[:, 0] + np.roll(at_ends[:, 1], 1)
    return total


def linear_parts(mesh: Mesh, edge: Index, x: Array, weight: Array, values: Array) -> Array:
    """(nb, 2) the L2 projection onto linear functions on each boundary edge, by its values at the ends.

    It is that of a function with the `values` (K, Q) at the points x in [0, 1] of K rules, which lie on the
    edges `edge` (K,) and have the weights `weight` (K, Q).
    """
    first = np.bincount(edge, np.sum(weight * values * (1 - x), axis=1), len(mesh.boundary))
    second = np.bincount(edge, np.sum(weight * values * x, axis=1), len(mesh.boundary))
    ends = np.column_stack([2 * first - second, 2 * second - first])
    return np.asarray(2 * ends / np.diff(mesh.s)[:, None])


def h1_load(mesh: Mesh, slopes: Array, moments: Array, gradient_integrals: Array) -> Array:
    """(n,) values of (u, phi_i)_1, from the mesh's `gradients`, moments of u, integrals (m, 2) of grad u."""
    return load_vector(mesh, moments + np.einsum("tid,td->ti", slopes, gradient_integrals))


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
    position = (0.5 * (points[1:] + points[:-1]) - mesh.s[edge]) / np.diff(mesh.s)[edge]
    values = np.concatenate([length * (1 - position), length * position])
    columns = np.concatenate([edge, (edge + 1) % nb])
    return sp.coo_array((values, (np.tile(cell, 2), columns)), shape=(partition.n_cells, nb)).tocsr()


def of_rest(mesh: Mesh, form: Form, load: Array, held: Array) -> Array:
    """(n,) the load for v - held, if that (n,) is for v: both are `held` (n,) at the fixed nodes.

    v - held vanishes there, and so does its load, see `form`.
    """

    def moments(part: Mesh) -> Array:
        slopes = gradients(part)
        values = held[part.triangles]
        along = np.einsum("tid,tjd,tj->ti", slopes, slopes, values)
        return form.k * part.areas[:, None] * along + form.c * linear_moments(part.areas, values)

    near = mesh.part(np.flatnonzero(held[mesh.triangles].any(axis=1)))
    return np.where(form.fixed(mesh), 0.0, load - by_parts(near, moments))


def boundary_mass(mesh: Mesh, edges: Mask | None = None) -> sp.csr_array:
    """(nb, nb) mass matrix of the boundary hats: the L2 product on the boundary, or on those edges."""
    nb = len(mesh.boundary)
    sixth = np.diff(mesh.s) / 6 * (1 if edges is None else edges)
    start = np.arange(nb)
    ends = np.column_stack([start, (start + 1) % nb])
    return from_elements(ends, sixth[:, None, None] * np.array([[2, 1], [1, 2]]), nb)


def energy_norm(mesh: Mesh, v: Array, form: Form = H1) -> float:
    """||v|| = (k |v|_1^2 + c ||v||_0^2)^{1/2} of v (n,), triangle by triangle.

    In v . A v the gradient of a constant would not cancel. The norm is computed in units of the largest
    value, for squares of tiny and of huge ones vanish or overflow.
    """
    unit = float(np.abs(v).max(initial=0.0))
    if not 0 < unit < math.inf:
        return unit
    square = 0.0
    for of in blocks(len(mesh.triangles)):
        nodal = v.take(mesh.triangles[of].T) / unit
        (x, y) = mesh.points.T[:, mesh.triangles[of].T]
        along = [np.sum(nodal * (z[[2, 0, 1]] - z[[1, 2, 0]]), axis=0) for z in (x, y)]
        of_value = (nodal.sum(axis=0) ** 2 + (nodal**2).sum(axis=0)) / 12
        square += form.k * float(np.sum(0.25 * (along[0] ** 2 + along[1] ** 2) / mesh.areas[of]))
        square += form.c * float(mesh.areas[of] @ of_value)
    return unit * math.sqrt(square)
