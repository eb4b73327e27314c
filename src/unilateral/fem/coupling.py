"""The pairing <mu_H, v_h>, exact over the common refinement of T_H and the boundary edges."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition


def coupling(mesh: Mesh, partition: Partition) -> sp.csr_array:
    """B (cells, boundary nodes): B[i, j] is the integral of the boundary node j's hat over cell i.

    So <mu_H, v_h> = mu . B v on the boundary values v of v_h, and B v / H_i are v_h's cell means.
    Raises InputError if the partition belongs to another polygon than the mesh.
    """
    if not np.array_equal(mesh.polygon.vertices, partition.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    points = np.union1d(partition.points, mesh.s)
    left, right = points[:-1], points[1:]
    cell = np.clip(np.searchsorted(partition.points, left, side="right") - 1, 0, partition.n_cells - 1)
    nb = len(mesh.boundary)
    edge = np.clip(np.searchsorted(mesh.s, left, side="right") - 1, 0, nb - 1)
    length = right - left
    position = (0.5 * (left + right) - mesh.s[edge]) / np.diff(mesh.s)[edge]
    values = np.concatenate([length * (1 - position), length * position])
    columns = np.concatenate([edge, (edge + 1) % nb])
    return sp.coo_array((values, (np.tile(cell, 2), columns)), shape=(partition.n_cells, nb)).tocsr()


def boundary_mass(mesh: Mesh) -> sp.csr_array:
    """(nb, nb) mass matrix of the boundary hats: the L2 product of traces on the boundary."""
    nb = len(mesh.boundary)
    start = np.arange(nb)
    end = (start + 1) % nb
    sixth = np.diff(mesh.s) / 6
    values = np.concatenate([2 * sixth, 2 * sixth, sixth, sixth])
    rows, columns = np.concatenate([start, end, start, end]), np.concatenate([start, end, end, start])
    return sp.coo_array((values, (rows, columns)), shape=(nb, nb)).tocsr()
