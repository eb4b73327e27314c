"""f, g, u and q as values at the nodes of a mesh: linear on its triangles and on its boundary edges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from unilateral.arrays import Array, Index, nodal_values
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS, Model, constant, number
from unilateral.geometry.curves import Singular
from unilateral.geometry.mesh import Mesh

SLOPE = 16 * EPS
"""A slope, and what is made of it on an edge, is rounded by at most this part of the values at its ends."""


@dataclass(frozen=True, eq=False)
class NodalTrace:
    """A function on a side: its `values` (k,) at the places t (k,), from 0 to 1 in side lengths."""

    t: Array
    values: Array

    def model(self, t: Model) -> Model:
        """The function on intervals of the side, each of which lies on one edge but for rounding."""
        edge = self._edges(t)
        start = self.values[edge]
        end = self.values[edge + 1]
        slope = (end - start) / (self.t[edge + 1] - self.t[edge])
        doubt = SLOPE * (np.abs(start) + np.abs(end))
        linear = number(t, start) + number(t, slope) * (t + number(t, -self.t[edge]))
        return linear + constant(t.basis, (-doubt, doubt))

    def slope_model(self, t: Model) -> Model:
        """The derivative by t on intervals as those of `model`."""
        edge = self._edges(t)
        rise = np.diff(self.values)[edge]
        run = np.diff(self.t)[edge]
        doubt = SLOPE * (np.abs(self.values[edge]) + np.abs(self.values[edge + 1])) / run
        return number(t, rise / run) + constant(t.basis, (-doubt, doubt))

    def _edges(self, t: Model) -> Index:
        """The edge on which each interval lies."""
        middle = 0.5 * (t.range[0] + t.range[1])
        return np.clip(np.searchsorted(self.t, middle, side="right") - 1, 0, len(self.t) - 2)

    @property
    def cuts(self) -> Array:
        """The places inside the side at which it is not smooth."""
        return self.t[1:-1]


def cuts(sides: Iterable[object]) -> list[Singular]:
    """The nodes inside the sides on which there is a trace, of what is given on the sides in their order."""
    traces = [(side, trace) for side, trace in enumerate(sides) if isinstance(trace, NodalTrace)]
    return [Singular(side, t, 1) for side, trace in traces for t in trace.cuts.tolist()]


def is_array(given: object) -> TypeGuard[Array]:
    """Whether values at nodes are given: an array that is no single number."""
    return hasattr(given, "__array__") and np.ndim(given) > 0  # type: ignore[arg-type]


def at_nodes(mesh: Mesh | None, given: Array, where: str, read: Index | None = None) -> Array:
    """(n,) the values that are given at the nodes of a mesh; `read` are the nodes that count, by default all.

    Raises InputError, beginning with `where`, for another shape, for what is no finite real number, and as
    `nodal_values`.
    """
    if mesh is None:
        raise InputError(
            f"{where}: an array has a value for each node of a mesh; give the mesh in place of the polygon, "
            "as in ul.Problem(mesh, f, g)"
        )
    values = nodal_values(given, where)
    if values.shape != (mesh.n_nodes,):
        raise InputError(
            f"{where}: the array has the shape {values.shape}; it has to be ({mesh.n_nodes},), a value for "
            "each of mesh.points"
        )
    wrong = np.flatnonzero(~np.isfinite(values if read is None else values[read]))
    if wrong.size:
        node = int(wrong[0] if read is None else read[wrong[0]])
        x, y = mesh.points[node]
        raise InputError(
            f"{where}: the array is {values[node]} at node {node} ({x:.6g}, {y:.6g}); it has to be finite"
        )
    return values


def trace(mesh: Mesh | None, given: Array, side: int, where: str) -> NodalTrace:
    """The values on a side; those at other nodes are not read. Raises InputError as `at_nodes`."""
    if mesh is None:
        at_nodes(None, given, where)
    assert mesh is not None
    nodes, t = side_nodes(mesh, side)
    return NodalTrace(t, at_nodes(mesh, given, where, nodes)[nodes])


def side_nodes(mesh: Mesh, side: int) -> tuple[Index, Array]:
    """(k,) the nodes on a side in their order, and (k,) their places, from 0 to 1 in side lengths."""
    edges = np.flatnonzero(mesh.side == side)
    nodes = np.append(mesh.boundary[edges], mesh.boundary[(edges[-1] + 1) % len(mesh.boundary)])
    polygon = mesh.polygon
    t = np.append((mesh.s[edges] - polygon.starts[side]) / polygon.lengths[side], 1.0)
    return nodes, t
