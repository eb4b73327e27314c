"""lambda_H as a flux through the boundary edges of a mesh, and where it says that there is contact."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.bounds.constraint import Constraint
from unilateral.errors import InputError
from unilateral.geometry import exact_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import MEAN_FREE_ON_SQUARE, ON_SQUARE

PUSH = 0.5
"""u_h counts as in contact where it is less than this times H_i lambda_i above g.

Only the sharpness of the bounds depends on it.
"""
SUMS = 1e-9
"""At most this fraction of a sum of squares is rounding."""


class EdgeFlux(NamedTuple):
    """lambda_H on the boundary edges.

    `ends` (nb, 2) are the values of its linear part at the edges' ends, >= 0 since the slope is limited.
    `rest` (nb,) is the squared L2 norm of what is left, and `constant` (nb,) is what `oscillation` needs to
    bound that in ||.||_{-1/2}. `push` (nb,) is the largest H_i lambda_i of a cell there.
    """

    ends: Array
    rest: Array
    constant: Array
    push: Array


def edge_flux(mesh: Mesh, cells: Partition, lambda_H: Array) -> EdgeFlux:
    """The flux of lambda_H (m,), which is constant on the cells."""
    lengths, nb = np.diff(mesh.s), len(mesh.boundary)
    points, cell, edge = overlay(cells.points, mesh.s)
    middle = 0.5 * (points[1:] + points[:-1])
    share, arm = np.diff(points) / lengths[edge], 2 * (middle - mesh.s[edge]) / lengths[edge] - 1
    value = lambda_H[cell]
    mean = np.bincount(edge, share * value, nb)
    slope = 3 * np.bincount(edge, share * arm * value, nb)
    limited = np.clip(slope, -mean, mean)
    squares = np.bincount(edge, share * (value - mean[edge]) ** 2, nb)
    rest = np.maximum(squares + (limited - 2 * slope) * limited / 3, 0.0)
    push = np.zeros(nb)
    np.maximum.at(push, edge, (cells.lengths * lambda_H)[cell])
    return EdgeFlux(
        np.column_stack([mean - limited, mean + limited]),
        rest=lengths * rest,
        constant=np.where(limited == slope, ON_SQUARE, MEAN_FREE_ON_SQUARE),
        push=push,
    )


def in_contact(g: Constraint, u_h: Array, push: Array) -> Mask:
    """(n,) P2's unknowns in contact: u_h - g is below PUSH H_i lambda_i of a cell there."""
    largest = np.zeros(len(u_h))
    np.maximum.at(largest, g.unknowns, push[:, None])
    return u_h - g.at_unknowns < PUSH * largest


def check(mesh: Mesh, cells: Partition, u_h: Array, lambda_H: Array, free: Collection[int]) -> None:
    """Raises InputError unless u_h is in V_h, lambda_H in Lambda_H, lambda_H >= 0, and 0 on the `free` sides.

    It is raised, too, where the mesh is too far from the exact one.
    """
    if not np.array_equal(mesh.polygon.vertices, cells.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    exact_mesh.check(mesh.polygon, mesh.points, mesh.triangles, mesh.distortion)
    for name, values, n in (("u_h", u_h, mesh.n_nodes), ("lambda_H", lambda_H, cells.n_cells)):
        if np.shape(values) != (n,) or not np.all(np.isfinite(values)):
            raise InputError(f"{name} must hold {n} finite numbers; it has the shape {np.shape(values)}")
    if np.min(lambda_H) < 0:
        raise InputError(f"lambda_H has the value {np.min(lambda_H):.4g}; it must not be negative")
    loaded = np.flatnonzero(np.isin(cells.side, [*free]) & (lambda_H > 0))
    if loaded.size:
        raise InputError(f"lambda_H is not 0 on side {cells.side[loaded[0]]}, which is free; it must be")
