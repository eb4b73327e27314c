"""f, g, u and q as values at nodes of a mesh, or g, u and q at the rows of a table: linear in between."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeGuard

import numpy as np

from unilateral.arrays import Array, Index, read_nodal_values
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS, TaylorModel, number_model, range_model
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.mesh import Mesh

SLOPE_ROUNDING = 16 * EPS
"""A slope, and what is made of it on an edge, is rounded by at most this part of the values at its ends."""


@dataclass(frozen=True, eq=False)
class NodalTrace:
    """A function on a side: its `values` (k,) at the places t (k,), from 0 to 1 in side lengths.

    The places are exact, or known up to `place_rounding`.
    """

    t: Array
    values: Array
    place_rounding: float = 0.0

    @cached_property
    def _steepest_slopes(self) -> Array:
        """The largest slope on each edge and those beside it, on which a rounded place may lie, (k - 1,)."""
        slopes = np.abs(np.diff(self.values) / np.diff(self.t))
        beside = np.maximum(np.append(slopes[1:], 0.0), np.append(0.0, slopes[:-1]))
        return np.maximum(slopes, beside)

    def value_model(self, t: TaylorModel) -> TaylorModel:
        """The function on intervals of the side, each of which lies on one edge but for rounding."""
        # v(t) = v_i + (t - t_i) (v_(i + 1) - v_i) / (t_(i + 1) - t_i), and the rounding of these numbers
        edge = self._find_edges(t)
        start = self.values[edge]
        end = self.values[edge + 1]
        slope = (end - start) / (self.t[edge + 1] - self.t[edge])
        # With nodes that move by r the function is v(t + d), where |d| <= r
        moved = 2 * self.place_rounding * self._steepest_slopes[edge] if self.place_rounding else 0.0
        rounding = SLOPE_ROUNDING * (np.abs(start) + np.abs(end)) + moved
        linear = number_model(t, start) + number_model(t, slope) * (t + number_model(t, -self.t[edge]))
        return linear + range_model(t.basis, (-rounding, rounding))

    def slope_model(self, t: TaylorModel) -> TaylorModel:
        """The derivative by t on intervals as those of `value_model`."""
        edge = self._find_edges(t)
        rise = np.diff(self.values)[edge]
        run = np.diff(self.t)[edge]
        rounding = SLOPE_ROUNDING * (np.abs(self.values[edge]) + np.abs(self.values[edge + 1])) / run
        # With nodes that move by r a run is longer or shorter by 2 r
        rounding += 4 * self.place_rounding * np.abs(rise) / run**2
        return number_model(t, rise / run) + range_model(t.basis, (-rounding, rounding))

    def _find_edges(self, t: TaylorModel) -> Index:
        """The edge on which each interval lies."""
        # The middle is inside, while ends may be rounded beyond a node
        middle = 0.5 * (t.range[0] + t.range[1])
        return np.clip(np.searchsorted(self.t, middle, side="right") - 1, 0, len(self.t) - 2)

    @property
    def breakpoints(self) -> Array:
        """The places inside the side at which it is not smooth."""
        return self.t[1:-1]


def trace_breakpoints(data: Iterable[object]) -> list[SingularPoint]:
    """The nodes inside the sides on which there is a trace, of what is given on the sides in their order."""
    traces = [(side, trace) for side, trace in enumerate(data) if isinstance(trace, NodalTrace)]
    return [SingularPoint(side, t, 1) for side, trace in traces for t in trace.breakpoints.tolist()]


def is_nodal_array(data: object) -> TypeGuard[Array]:
    """Whether values at nodes are given: an array that is no single number."""
    return hasattr(data, "__array__") and np.ndim(data) > 0  # type: ignore[arg-type]


def check_nodal_values(mesh: Mesh | None, array: Array, where: str, nodes: Index | None = None) -> Array:
    """The values that are given at the nodes of a mesh, (n,), finite at the nodes that count.

    Raises InputError, beginning with `where`, without a mesh, for another shape, for what is no finite real
    number, and as `read_nodal_values`.
    """
    mesh = _require_mesh(mesh, where)
    values = read_nodal_values(array, where)
    if values.shape != (mesh.n_nodes,):
        raise InputError(
            f"{where}: the array has the shape {values.shape}; it has to be ({mesh.n_nodes},), a value for "
            "each of mesh.points"
        )
    wrong = np.flatnonzero(~np.isfinite(values if nodes is None else values[nodes]))
    if wrong.size:
        node = int(wrong[0] if nodes is None else nodes[wrong[0]])
        x, y = mesh.points[node]
        raise InputError(
            f"{where}: the array is {values[node]} at node {node} ({x:.6g}, {y:.6g}); it has to be finite"
        )
    return values


def _require_mesh(mesh: Mesh | None, where: str) -> Mesh:
    """The mesh at whose nodes an array has values. Raises InputError for None, where a polygon was given."""
    if mesh is None:
        raise InputError(
            f"{where}: an array has a value for each node of a mesh; give the mesh in place of the polygon, "
            "as in ul.Problem(mesh, f, g)"
        )
    return mesh


def make_trace(mesh: Mesh | None, values: Array, side: int, where: str) -> NodalTrace:
    """The values on a side; those at other nodes are not read. Raises InputError as `check_nodal_values`."""
    mesh = _require_mesh(mesh, where)
    nodes, t = side_nodes(mesh, side)
    return NodalTrace(t, check_nodal_values(mesh, values, where, nodes)[nodes])


def side_nodes(mesh: Mesh, side: int) -> tuple[Index, Array]:
    """The nodes on a side in their order, and their positions t from 0 to 1 in side lengths, (k,) each."""
    edges = np.flatnonzero(mesh.side == side)
    nodes = np.append(mesh.boundary[edges], mesh.boundary[(edges[-1] + 1) % len(mesh.boundary)])
    polygon = mesh.polygon
    t = np.append((mesh.s[edges] - polygon.starts[side]) / polygon.lengths[side], 1.0)
    return nodes, t
