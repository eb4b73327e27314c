"""The polygon that the boundary of triangles forms, and which of the boundary's nodes are its corners.

Coordinates are rounded, to the digits that a file has or to those of a double. So a node at which the
boundary turns is a corner only if rounding cannot explain the turn, and where it might, the polygon is asked
for.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.errors import InputError, pluralise
from unilateral.geometry import coordinate_rounding
from unilateral.geometry.plane import cross
from unilateral.geometry.polygon import MAX_VERTICES, Polygon
from unilateral.geometry.triangulation_checks import (
    check_arrays,
    check_distinct_nodes,
    describe_node,
    find_boundary_edges,
    orient_anticlockwise,
)

MIN_CORNER_RADIANS = np.radians(0.1)
"""No corner of a larger turn is missed: where rounding might hide one, the mesh is refused."""
CORNER_PER_ROUNDING = 2.0
"""A turn of more than this times the largest one by rounding is a corner. Cut instead of rounded numbers are
off by a unit, twice as far; their turns are neither rounding nor corners."""
SLIGHT_TURN_RADIANS = np.radians(1.0)
"""Smaller turns are looked at twice: they may come from a rounding that the numbers do not show any more, as
those of a mesh that was turned afterwards. Short numbers that a person wrote do not make such corners."""
POLYGON_ADVICE = "give the polygon, by polygon="


TurnKinds = tuple[Mask, Mask, Mask]
"""Masks (n,) of the nodes at corners, of those at turns by rounding, and of those that may be either."""


class Outline(NamedTuple):
    """The polygon of a boundary, and what was taken for rounding.

    `rounded_nodes` (k,) are the nodes at which the boundary turns by rounding, by at most `max_rounding_turn`
    radians.
    """

    polygon: Polygon
    rounded_nodes: Index
    max_rounding_turn: float


def find_outline(
    points: Array, triangles: Index, where: str, named_edges: Mapping[str, Index] = MappingProxyType({})
) -> Outline:
    """The polygon that the triangles' boundary forms, anticlockwise, from the first of its corners on.

    The sides have the names of which `named_edges` has their edges, pairs of nodes (k, 2). A side ends where
    the names change, without a corner, too. Raises InputError for a boundary that is not one closed line, and
    where rounding leaves its corners open.
    """
    line = order_boundary_nodes(points, triangles, where)
    places = points[line]
    turns = _boundary_turns(places)
    # Where places may be off by round-off in another program, and by that and by rounded digits
    arithmetic_errors = np.full(len(line), coordinate_rounding.arithmetic_error(places))
    point_errors = arithmetic_errors + coordinate_rounding.rounding_errors_of_points(places)
    corners, rounded, unclear = _classify_turns(places, turns, arithmetic_errors, point_errors)
    # A side ends where the names change, whatever the turn is
    has_names = _find_named_edges(line, named_edges)
    ends = _find_name_changes(has_names, len(line))
    corners |= ends
    rounded &= ~ends
    unclear &= ~ends
    if unclear.any():
        worst = int(np.where(unclear, np.abs(turns), -1.0).argmax())
        raise InputError(
            f"{where}: the boundary turns by {np.degrees(abs(turns[worst])):.2g} degrees at node "
            f"{describe_node(points, line[worst])}, where coordinates are rounded by up to "
            f"{point_errors[worst]:.1g}; it is not clear whether there is a corner; {POLYGON_ADVICE}"
        )
    if np.count_nonzero(corners) > MAX_VERTICES:
        raise InputError(
            f"{where}: the boundary turns at {np.count_nonzero(corners)} nodes, and a polygon has at most "
            f"{MAX_VERTICES} vertices; take a coarser mesh, and halvings=1 or more"
        )
    _check_straightness(points, line, corners, point_errors, where)
    max_rounding_turn = float(np.abs(turns[rounded]).max(initial=0.0))
    side_names = {name: np.flatnonzero(mask[corners]) for name, mask in has_names.items()}
    return Outline(Polygon(places[corners], Path(where).stem, side_names), line[rounded], max_rounding_turn)


def _find_name_changes(has_names: Mapping[str, Mask], n: int) -> Mask:
    """The nodes of a closed line, (n,), at which edges with a name begin or end, from the edges' masks."""
    changes = np.zeros(n, dtype=bool)
    for mask in has_names.values():
        changes |= mask != np.roll(mask, 1)
    return changes


def _classify_turns(places: Array, turns: Array, arithmetic_errors: Array, point_errors: Array) -> TurnKinds:
    """The kinds of the turns (n,) of a closed line through places (n, 2).

    Places are off by up to `point_errors` (n,), and by up to `arithmetic_errors` (n,) by round-off alone.
    """
    rounding_turns = largest_turns(places, point_errors)
    # Nodes that turn by round-off alone
    straight = np.abs(turns) <= largest_turns(places, arithmetic_errors)
    if not coordinate_rounding.has_typed_digits(places):
        return _classify_computed(turns, straight, rounding_turns)
    half_units = 0.5 * np.hypot(*coordinate_rounding.rounding_units(places).T)
    digit_turns = largest_turns(places, arithmetic_errors + half_units)
    return _classify_typed(turns, straight, rounding_turns, digit_turns)


def _find_named_edges(line: Index, named_edges: Mapping[str, Index]) -> dict[str, Mask]:
    """Masks (n,) of the edges that have each name, of those from each node of a closed line to the next."""
    # An edge is known by its two nodes, the smaller number first
    n = int(line.max()) + 1
    edges = np.sort(np.column_stack([line, np.roll(line, -1)]), axis=1) @ [n, 1]
    masks = {
        name: np.isin(edges, np.sort(pairs, axis=1)[pairs.max(axis=1, initial=0) < n] @ [n, 1])
        for name, pairs in named_edges.items()
    }
    return {name: mask for name, mask in masks.items() if mask.any()}


def _classify_typed(turns: Array, straight: Mask, rounding_turns: Array, digit_turns: Array) -> TurnKinds:
    """The kinds of the turns (n,) where coordinates were typed, and count as exact in `rounding_turns` (n,).

    If they were rounded to their few digits nevertheless, straight lines turn by up to `digit_turns` (n,).
    """
    slight = np.abs(turns) <= np.minimum(SLIGHT_TURN_RADIANS, CORNER_PER_ROUNDING * digit_turns)
    rounded = ~straight & (np.abs(turns) <= rounding_turns)
    unclear = ~straight & ~rounded & slight
    return ~straight & ~rounded & ~unclear, rounded, unclear


def _classify_computed(turns: Array, straight: Mask, rounding_turns: Array) -> TurnKinds:
    """The kinds of the turns (n,) where coordinates were computed: digits explain `rounding_turns` (n,)."""
    corners = ~straight & (np.abs(turns) > CORNER_PER_ROUNDING * rounding_turns)
    # The true turn is at most |turn| + rounding_turns
    hidden = np.abs(turns) + rounding_turns >= MIN_CORNER_RADIANS
    rounded = ~straight & (np.abs(turns) <= rounding_turns) & ~hidden
    unclear = ~straight & ~corners & ~rounded
    # Only where numbers are seen to be rounded may nodes in line hide a corner
    unclear |= straight & hidden & np.any(rounded | unclear)
    # Corners may come from a rounding that the digits do not show, if they are slight and in its pattern
    slight_corners = np.where(corners & (np.abs(turns) < SLIGHT_TURN_RADIANS), turns, 0.0)
    unclear |= _find_rounding_patterns(slight_corners, ~hidden)
    return corners, rounded, unclear


def _boundary_turns(points: Array) -> Array:
    """The turns at the nodes of a closed line, from the edge before each to the next, in radians, (n,)."""
    after = np.roll(points, -1, axis=0) - points
    before = np.roll(after, 1, axis=0)
    return np.arctan2(cross(before, after), np.sum(before * after, axis=1))


def largest_turns(points: Array, errors: Array) -> Array:
    """The largest turn, in radians, that rounding explains at each node of a closed line, (n,).

    An edge whose ends move by r and s turns by at most arcsin((r + s) / length), or by any angle.
    """
    lengths = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    share = (errors + np.roll(errors, -1)) / lengths
    turned = np.where(share < 1, np.arcsin(np.minimum(share, 1.0)), np.pi)
    return turned + np.roll(turned, 1)


def _find_rounding_patterns(turns: Array, below_min_turn: Mask) -> Mask:
    """Mask (n,) of the nodes whose slight turns alternate, or stand alone, as on a side once rounded.

    `turns` are 0 where they are not slight. A node is in the mask if it is the second of four in a row whose
    turns alternate in sign, or one of the `below_min_turn` without a neighbour that turns the same way, as
    each node of an arc has.
    """
    after = turns * np.roll(turns, -1)
    before = turns * np.roll(turns, 1)
    alternating = (before < 0) & (after < 0) & (np.roll(after, -1) < 0)
    lone = below_min_turn & (turns != 0) & (before <= 0) & (after <= 0)
    return alternating | lone


def _check_straightness(points: Array, line: Index, corners: Mask, errors: Array, where: str) -> None:
    """Raises InputError unless all nodes between two corners are within their `errors` (n,) of the chord.

    Many turns, each as small as rounding, are no straight side. The ends of the chord may be off, too, and
    the chord between them is off by no more than the larger one of their errors.
    """
    ends = np.flatnonzero(corners)
    if len(ends) < 3:
        raise InputError(
            f"{where}: the boundary has {pluralise(len(ends), 'corner')} that rounding does not explain, and "
            f"a polygon has three; {POLYGON_ADVICE}"
        )
    # The corners a before and b after each node, cyclically, and its distance |(b - a) x (p - a)| / |b - a|
    run = np.searchsorted(ends, np.arange(len(line)), side="right") - 1
    a = ends[run]
    b = ends[(run + 1) % len(ends)]
    places = points[line]
    chord = places[b] - places[a]
    away = np.abs(cross(chord, places - places[a])) / np.hypot(*chord.T)
    bent = ~corners & (away > errors + np.maximum(errors[a], errors[b]))
    if bent.any():
        worst = int(np.where(bent, away, 0.0).argmax())
        raise InputError(
            f"{where}: the boundary bends between node {describe_node(points, line[a[worst]])} and node "
            f"{describe_node(points, line[b[worst]])}, by {away[worst]:.2g} at node "
            f"{describe_node(points, line[worst])}, in turns that are each as small as rounding; "
            f"{POLYGON_ADVICE}"
        )


def order_boundary_nodes(points: Array, triangles: Index, where: str) -> Index:
    """The nodes along the triangles' boundary, anticlockwise, from the one of least number on, (nb,).

    Raises InputError for a boundary that is not one closed line.
    """
    check_arrays(points, triangles, where)
    check_distinct_nodes(float(np.hypot(*np.ptp(points, axis=0))), points, where)
    edges = find_boundary_edges(points, orient_anticlockwise(points, triangles), where)
    after = np.full(len(points), -1)
    after[edges[:, 0]] = edges[:, 1]
    line = [int(edges[:, 0].min())]
    # As many nodes as edges are enough: a line that meets itself may never come back to its first node
    while after[line[-1]] >= 0 and after[line[-1]] != line[0] and len(line) < len(edges):
        line.append(int(after[line[-1]]))
    if len(line) < len(edges):
        why = _explain_boundary_fault(points, triangles, edges)
        raise InputError(f"{where}: the triangles' boundary must be one closed line; {why}")
    return np.array(line)


def _explain_boundary_fault(points: Array, triangles: Index, edges: Index) -> str:
    """The reason why boundary edges are not one closed line, as words for a message."""
    components = _count_components(len(points), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    if components > 1:
        return f"the triangles form {components} separate parts; give one of them"
    twice = np.flatnonzero(np.bincount(edges[:, 0]) > 1)
    if twice.size:
        return f"it meets itself at node {describe_node(points, twice[0])}"
    # Nodes inside, which no boundary edge has, are components of their own
    lines = _count_components(len(points), edges) - (len(points) - len(np.unique(edges)))
    return f"it has {lines} such lines, and there may be no holes"


def _count_components(n: int, edges: Index) -> int:
    """The number of parts of a graph with n nodes."""
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    graph = sp.coo_array((np.ones(len(edges)), edges.T), shape=(n, n))
    return int(connected_components(graph, directed=False, return_labels=False))
