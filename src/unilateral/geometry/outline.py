"""The polygon that the boundary of triangles forms, and which of the boundary's nodes are its corners.

Coordinates are rounded, to the digits that a file has or to those of a double. So a node at which the
boundary turns is a corner only if rounding cannot explain the turn, and where it might, the polygon is asked
for.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.errors import InputError, counted
from unilateral.geometry import rounding
from unilateral.geometry.plane import cross
from unilateral.geometry.polygon import MAX_VERTICES, Polygon
from unilateral.geometry.triangulation_checks import (
    anticlockwise,
    boundary_edges,
    check_arrays,
    check_distinct,
    node,
)

SMALLEST_TURN = np.radians(0.1)
"""No corner of a larger turn is missed: where rounding might hide one, the mesh is refused."""
CLEAR = 2.0
"""A turn of more than this times the largest one by rounding is a corner. Cut instead of rounded numbers are
off by a unit, twice as far; their turns are neither rounding nor corners."""
SLIGHT = np.radians(1.0)
"""Smaller turns are looked at twice: they may come from a rounding that the numbers do not show any more, as
those of a mesh that was turned afterwards. Short numbers that a person wrote do not make such corners."""
GIVE_IT = "give the polygon, by polygon="


class Outline(NamedTuple):
    """The polygon of a boundary, and what was taken for rounding.

    `rounded` (k,) are the nodes at which the boundary turns by rounding, by at most `turn` radians.
    """

    polygon: Polygon
    rounded: Index
    turn: float


def outline(points: Array, triangles: Index, where: str) -> Outline:
    """The polygon that the triangles' boundary forms, anticlockwise, from the first of its corners on.

    Raises InputError for a boundary that is not one closed line, and where rounding leaves its corners open.
    """
    line = closed_line(points, triangles, where)
    places = points[line]
    before = places - np.roll(places, 1, axis=0)
    after = np.roll(places, -1, axis=0) - places
    turns = np.arctan2(cross(before, after), np.sum(before * after, axis=1))
    by_arithmetic = np.full(len(line), rounding.arithmetic(places))
    by_digits = by_arithmetic + rounding.radii(places)
    straight = np.abs(turns) <= largest_turns(places, by_arithmetic)
    by_rounding = largest_turns(places, by_digits)
    if rounding.as_typed(places):
        by_units = largest_turns(places, by_arithmetic + 0.5 * np.hypot(*rounding.units(places).T))
        rounded = ~straight & (np.abs(turns) <= by_rounding)
        unclear = ~straight & ~rounded & (np.abs(turns) <= np.minimum(SLIGHT, CLEAR * by_units))
        corners = ~straight & ~rounded & ~unclear
    else:
        corners = ~straight & (np.abs(turns) > CLEAR * by_rounding)
        # The true turn is at most |turn| + by_rounding.
        hidden = np.abs(turns) + by_rounding >= SMALLEST_TURN
        rounded = ~straight & (np.abs(turns) <= by_rounding) & ~hidden
        unclear = ~straight & ~corners & ~rounded
        # Only where numbers are seen to be rounded may nodes in line hide a corner.
        unclear |= straight & hidden & np.any(rounded | unclear)
        unclear |= _restless(np.where(corners & (np.abs(turns) < SLIGHT), turns, 0.0), ~hidden)
    if unclear.any():
        worst = int(np.where(unclear, np.abs(turns), -1.0).argmax())
        raise InputError(
            f"{where}: the boundary turns by {np.degrees(abs(turns[worst])):.2g} degrees at node "
            f"{node(points, line[worst])}, where coordinates are rounded by up to {by_digits[worst]:.1g}; "
            f"it is not clear whether there is a corner; {GIVE_IT}"
        )
    if np.count_nonzero(corners) > MAX_VERTICES:
        raise InputError(
            f"{where}: the boundary turns at {np.count_nonzero(corners)} nodes, and a polygon has at most "
            f"{MAX_VERTICES} vertices; take a coarser mesh, and halvings=1 or more"
        )
    _check_runs(points, line, corners, by_digits, where)
    turn = float(np.abs(turns[rounded]).max(initial=0.0))
    return Outline(Polygon(places[corners], Path(where).stem), line[rounded], turn)


def largest_turns(places: Array, radii: Array) -> Array:
    """(n,) the largest turn by rounding at each node of a closed line, with places (n, 2) within `radii`.

    An edge whose ends move by r and s turns by at most arcsin((r + s) / length), or by any angle.
    """
    lengths = np.hypot(*(np.roll(places, -1, axis=0) - places).T)
    share = (radii + np.roll(radii, -1)) / lengths
    turned = np.where(share < 1, np.arcsin(np.minimum(share, 1.0)), np.pi)
    return turned + np.roll(turned, 1)


def _restless(turns: Array, smallest: Mask) -> Mask:
    """(n,) the nodes whose slight `turns` tell of another rounding; other turns are given as 0.

    Those are the second of four in a row that alternate in sign, and one of the `smallest` without a
    neighbour that turns the same way, as each node of an arc has.
    """
    after = turns * np.roll(turns, -1)
    before = turns * np.roll(turns, 1)
    alternating = (before < 0) & (after < 0) & (np.roll(after, -1) < 0)
    lone = smallest & (turns != 0) & (before <= 0) & (after <= 0)
    return alternating | lone


def _check_runs(points: Array, line: Index, corners: Mask, radii: Array, where: str) -> None:
    """Raises InputError unless all nodes between two corners are within their `radii` (n,) of the chord.

    The ends of the chord may be off, too, and the chord between them is off by no more. Many turns, each as
    small as rounding, are no straight side.
    """
    ends = np.flatnonzero(corners)
    if len(ends) < 3:
        raise InputError(
            f"{where}: the boundary has {counted(len(ends), 'corner')} that rounding does not explain, and a "
            f"polygon has three; {GIVE_IT}"
        )
    run = np.searchsorted(ends, np.arange(len(line)), side="right") - 1
    a = ends[run]
    b = ends[(run + 1) % len(ends)]
    chord = points[line[b]] - points[line[a]]
    places = points[line]
    away = np.abs(cross(chord, places - points[line[a]])) / np.hypot(*chord.T)
    bent = ~corners & (away > radii + np.maximum(radii[a], radii[b]))
    if bent.any():
        worst = int(np.where(bent, away, 0.0).argmax())
        raise InputError(
            f"{where}: the boundary bends between node {node(points, line[a[worst]])} and node "
            f"{node(points, line[b[worst]])}, by {away[worst]:.2g} at node {node(points, line[worst])}, in "
            f"turns that are each as small as rounding; {GIVE_IT}"
        )


def closed_line(points: Array, triangles: Index, where: str) -> Index:
    """(nb,) the nodes along the triangles' boundary, anticlockwise, from the one of least number on.

    Raises InputError for a boundary that is not one closed line.
    """
    check_arrays(points, triangles, where)
    check_distinct(float(np.hypot(*np.ptp(points, axis=0))), points, where)
    edges = boundary_edges(points, anticlockwise(points, triangles), where)
    after = np.full(len(points), -1)
    after[edges[:, 0]] = edges[:, 1]
    line = [int(edges[:, 0].min())]
    while after[line[-1]] >= 0 and after[line[-1]] != line[0] and len(line) < len(edges):
        line.append(int(after[line[-1]]))
    if len(line) < len(edges):
        why = _why_no_line(points, triangles, edges)
        raise InputError(f"{where}: the triangles' boundary must be one closed line; {why}")
    return np.array(line)


def _why_no_line(points: Array, triangles: Index, edges: Index) -> str:
    """What is wrong with triangles whose boundary edges (nb, 2) are not one closed line."""
    parts = _connected(len(points), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    if parts > 1:
        return f"they are {parts} separate parts, of which one may be given"
    twice = np.flatnonzero(np.bincount(edges[:, 0]) > 1)
    if twice.size:
        return f"it meets itself at node {node(points, twice[0])}"
    lines = _connected(len(points), edges) - (len(points) - len(np.unique(edges)))
    return f"it has {lines} such lines, and there may be no holes"


def _connected(n: int, edges: Index) -> int:
    """The number of parts of a graph with n nodes."""
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    graph = sp.coo_array((np.ones(len(edges)), edges.T), shape=(n, n))
    return int(connected_components(graph, directed=False, return_labels=False))
