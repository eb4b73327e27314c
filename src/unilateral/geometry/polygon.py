"""Polygonal domains and their sides; the boundary is measured by arc length from vertex 0."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import resources
from typing import Any

import numpy as np

from unilateral.arrays import Array, Index, Mask, make_read_only, read_floats
from unilateral.errors import InputError, quote_input, suggest_name
from unilateral.formulas.taylor import EPS
from unilateral.geometry.plane import cross, first_crossing
from unilateral.system.declarations import read_stored_yaml

MAX_VERTICES = 1000
"""Polygons with more vertices are taken for a mistake, such as curves that are drawn by points."""
TOO_MANY_VERTICES = f"it has {{}} vertices; at most {MAX_VERTICES} are read"

MIN_POLYGON_EXTENT = 1e-75
MAX_COORDINATE = 1e75
"""The limits of lengths and coordinates, so that squares of areas are normal numbers."""
MAX_BOUNDARY_PIECES = 10_000_000
"""The boundary may be divided into this many pieces; their numbers alone take 80 MB."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """A simple polygon, not necessarily convex: the paper's Omega.

    Side i runs from vertex i to vertex i + 1, and the arc length s along the boundary grows from 0 at vertex
    0 to `perimeter`.

    Parameters
    ----------
    vertices : array_like of float (n, 2)
        They are listed anticlockwise.
    name : str
        How messages call it.
    side_names : mapping, optional
        Names of sides, each with the number of a side or with a list of numbers.

    Raises
    ------
    InputError
        If the vertices are fewer than three or more than MAX_VERTICES, not finite, clockwise, too far apart
        or too near, if a side is lost beside the perimeter by rounding, or if two sides touch elsewhere than
        in their common vertex; and for names of sides that do not exist.

    Examples
    --------
    >>> import unilateral as ul
    >>> triangle = ul.Polygon([(0, 0), (3, 0), (0, 4)], "triangle")
    >>> triangle.n_sides, triangle.lengths.tolist(), triangle.area
    (3, [3.0, 5.0, 4.0], 6.0)
    """

    vertices: Array
    name: str = field(default="polygon")
    side_names: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        pairs = "its vertices have to be pairs (x, y), such as [(0, 0), (1, 0), (0, 1)]"
        vertices = make_read_only(read_floats(self.vertices, f"polygon '{self.name}'", pairs))
        object.__setattr__(self, "vertices", vertices)
        _check_vertices(vertices, self.name)
        names = {name: _read_named_sides(name, sides, self) for name, sides in self.side_names.items()}
        object.__setattr__(self, "side_names", names)

    def __repr__(self) -> str:
        return f"Polygon '{self.name}': {self.n_sides} sides, area {self.area:.4g}"

    @cached_property
    def largest(self) -> float:
        """The largest absolute value of a vertex's coordinate; the rounding of points grows with it."""
        return float(np.abs(self.vertices).max())

    @property
    def n_sides(self) -> int:
        """The number of sides."""
        return len(self.vertices)

    @cached_property
    def edges(self) -> Array:
        """The vectors from vertex i to vertex i + 1, one for each side, (n, 2)."""
        return make_read_only(np.roll(self.vertices, -1, axis=0) - self.vertices)

    @cached_property
    def lengths(self) -> Array:
        """Lengths of the sides, (n,)."""
        return make_read_only(np.hypot(*self.edges.T))

    @cached_property
    def starts(self) -> Array:
        """Arc lengths of the vertices, the perimeter last, (n + 1,)."""
        return make_read_only(np.concatenate([[0.0], np.cumsum(self.lengths)]))

    @cached_property
    def stretch(self) -> Array:
        """Bounds on how far starts[i + 1] - starts[i] is from the length of side i, relative to it, (n,)."""
        # kappa of Proposition S14: the sums of lengths in `starts` are rounded as the perimeter is
        return make_read_only(np.spacing(self.perimeter) / self.lengths + 4 * EPS)

    @property
    def perimeter(self) -> float:
        """The length of the boundary."""
        return float(self.starts[-1])

    @cached_property
    def tangents(self) -> Array:
        """Unit vectors along the sides, (n, 2)."""
        return make_read_only(self.edges / self.lengths[:, None])

    @cached_property
    def normals(self) -> Array:
        """Outward unit normals of the sides, (n, 2)."""
        return make_read_only(np.column_stack([self.tangents[:, 1], -self.tangents[:, 0]]))

    @cached_property
    def angles(self) -> Array:
        """Interior angles at the vertices, in radians, (n,)."""
        # The turn from the side before a vertex to the one after it is pi minus the angle
        before = np.roll(self.tangents, 1, axis=0)
        turn = np.arctan2(cross(before, self.tangents), np.sum(before * self.tangents, axis=1))
        return make_read_only(np.pi - turn)

    @cached_property
    def area(self) -> float:
        """The area of Omega."""
        # Half the sum of x_i x x_(i+1), from vertex 0, so that nothing cancels far from the origin
        offsets = self.vertices - self.vertices[0]
        return 0.5 * float(np.sum(cross(offsets, np.roll(offsets, -1, axis=0))))

    @cached_property
    def diameter(self) -> float:
        """The largest distance of two vertices."""
        return max(float(np.max(np.hypot(*(self.vertices - vertex).T))) for vertex in self.vertices)

    def label_side(self, side: int) -> str:
        """The number of a side, with its names in brackets."""
        names = [name for name, sides in self.side_names.items() if side in sides]
        return f"{side} ({', '.join(names)})" if names else str(side)

    def sides_of(self, s: Array) -> Index:
        """The sides on which arc lengths s of the perimeter lie, at a vertex the later one, (k,)."""
        return np.searchsorted(self.starts, s, side="right") - 1

    def contains(self, points: Array) -> Mask:
        """Whether each point (..., 2) is inside: a ray to the right crosses an odd number of sides, (...)."""
        (x0, y0) = self.vertices.T
        (x1, y1) = np.roll(self.vertices, -1, axis=0).T
        x = points[..., :1]
        y = points[..., 1:]
        # Horizontal sides are crossed by no ray: y0 > y and y1 > y agree, whatever the quotient is
        with np.errstate(all="ignore"):
            crossed = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return np.asarray(crossed.sum(axis=-1) % 2 == 1)

    def point(self, side: int, t: float) -> Array:
        """The point that lies t side lengths along a side, (2,)."""
        return self.at(np.array([side]), np.array([t * self.lengths[side]]))[0]

    def arc_length(self, side: int, t: float) -> float:
        """The arc length of the point that lies t side lengths along a side; exact at the side's ends."""
        return float(self.starts[side + 1] if t == 1 else self.starts[side] + t * self.lengths[side])

    def at(self, side: Index, t: Array) -> Array:
        """The points on the sides `side` (k,) at the distances t (k,) from the sides' first vertices, (k, 2).

        Here t is a length; in `point` and `arc_length` its unit is the length of the side.
        """
        return self.vertices[side] + t[:, None] * self.tangents[side]

    def counts(self, size: float) -> Index:
        """For each side the least number of equal pieces that are no longer than `size`, (n,).

        A quotient that misses an integer by round-off, such as 1 / (1 / 49), counts as that integer.
        """
        if not (np.isfinite(size) and size > 0):
            raise InputError(
                f"polygon '{self.name}' cannot be divided into pieces of size {size}; give a positive number"
            )
        if size < self.perimeter / MAX_BOUNDARY_PIECES:
            raise InputError(
                f"polygon '{self.name}' cannot be divided into pieces of size {size:g}: these would be more "
                f"than {MAX_BOUNDARY_PIECES:g} pieces; give a larger size"
            )
        return np.maximum(1, np.ceil(self.lengths / size * (1 - 1e-12))).astype(np.intp)

    def divided(self, counts: Index) -> Array:
        """Arc lengths of the points that cut each side i into counts[i] equal pieces, (sum(counts) + 1,).

        They begin with 0, at vertex 0, include all vertices, and end with the perimeter.
        """
        side = np.repeat(np.arange(self.n_sides), counts)
        index = np.arange(len(side)) - (np.cumsum(counts) - counts)[side]
        return np.append(self.starts[side] + self.lengths[side] * index / counts[side], self.perimeter)


def _read_named_sides(name: object, sides: object, polygon: Polygon) -> tuple[int, ...]:
    """The sides of a name. Raises InputError if there are none, or if the name can be taken for a number."""
    where = f"polygon '{polygon.name}'"
    word = name.strip("+- ") if isinstance(name, str) else ""
    if not word or word.isdecimal():
        raise InputError(f"{where}: {quote_input(repr(name))} is no name of sides; take a word")
    numbers = tuple(np.atleast_1d(np.asarray(sides)).tolist())
    if not numbers or any(type(side) is not int or not 0 <= side < polygon.n_sides for side in numbers):
        raise InputError(
            f"{where}: the name '{quote_input(word)}' stands for {quote_input(repr(sides))}; it has to be "
            f"one or several of the sides 0 to {polygon.n_sides - 1}, such as 0 or [1, 2]"
        )
    return numbers


def polygon_names() -> list[str]:
    """The names of the polygons that have one."""
    return list(_read_named_vertices())


@cache
def find_polygon(name: str) -> Polygon:
    """The polygon of that name in polygons.yaml. Raises InputError, with the known names, for others."""
    if name not in _read_named_vertices():
        names = ", ".join(polygon_names())
        near = suggest_name(name, polygon_names())
        raise InputError(f"polygon {quote_input(repr(name))} is unknown; the named ones are {names}{near}")
    return Polygon(np.array(_read_named_vertices()[name]), name)


def square() -> Polygon:
    """The unit square; sides bottom, right, top, left."""
    return find_polygon("square")


@cache
def _read_named_vertices() -> dict[str, list[list[float]]]:
    path = resources.files("unilateral.geometry") / "polygons.yaml"
    vertices: dict[str, list[list[float]]] = read_stored_yaml(path)
    return vertices


def _check_vertices(vertices: Array, name: str) -> None:
    """Raises InputError unless they are those of a simple polygon, anticlockwise and within the limits."""
    if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3:
        raise InputError(f"polygon '{name}' needs at least three vertices, each a pair x, y")
    if len(vertices) > MAX_VERTICES:
        raise InputError(f"polygon '{name}': {TOO_MANY_VERTICES.format(len(vertices))}")
    if not np.all(np.isfinite(vertices)):
        raise InputError(f"polygon '{name}' has a vertex that is not finite")
    repeated = np.flatnonzero(np.all(vertices == np.roll(vertices, -1, axis=0), axis=1))
    if repeated.size:
        vertex = tuple(vertices[repeated[0]].tolist())
        is_last = repeated[0] == len(vertices) - 1
        advice = "; it is the first one again: leave the last one out" if is_last else ""
        raise InputError(f"polygon '{name}' repeats its vertex {repeated[0]} {vertex}{advice}")
    if np.abs(vertices).max() > MAX_COORDINATE or np.ptp(vertices, axis=0).max() < MIN_POLYGON_EXTENT:
        raise InputError(
            f"polygon '{name}' is too large or too small: squares of areas leave the range of double "
            f"precision; make it at least {MIN_POLYGON_EXTENT:g} wide or high, with coordinates of at most "
            f"{MAX_COORDINATE:g}"
        )
    lengths = np.hypot(*(np.roll(vertices, -1, axis=0) - vertices).T)
    short = int(lengths.argmin())
    perimeter = float(lengths.sum())
    if lengths[short] <= np.spacing(perimeter):
        raise InputError(
            f"polygon '{name}': its side {short} is {lengths[short]:.2g} long, which is lost in "
            f"rounding beside the perimeter, {perimeter:.6g}; leave one of its vertices out"
        )
    crossing = first_crossing(vertices)
    if crossing is not None:
        raise InputError(f"polygon '{name}' is not simple: its sides {crossing[0]} and {crossing[1]} meet")
    # Twice the area; of a simple polygon it has the sign of the order
    offsets = vertices - vertices[0]
    if np.sum(cross(offsets, np.roll(offsets, -1, axis=0))) <= 0:
        raise InputError(f"polygon '{name}' is listed clockwise; list its vertices anticlockwise")
