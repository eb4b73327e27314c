"""Polygons from files: their vertices, a row of a CSV file each."""

from __future__ import annotations

from fractions import Fraction
from os import PathLike
from typing import NamedTuple

import numpy as np

from unilateral.errors import InputError, pluralise
from unilateral.formulas.expression import Expression
from unilateral.formulas.expression import rational_expression as exact
from unilateral.geometry.polygon import Polygon
from unilateral.system.columns import read_columns


class Domain(NamedTuple):
    """A polygon, and the exact coordinates of its vertices, of which it has the rounded ones."""

    polygon: Polygon
    exact_vertices: list[list[Expression]]


def read_domain(path: str | PathLike[str], name: str, where: str) -> Domain:
    """The polygon of that name in a file: columns x and y, whose last row may be the first one again.

    Raises InputError, with the file and the line, for what is no simple polygon, listed anticlockwise.
    """
    rows = read_columns(path, where, "x and y")
    vertices = [[Fraction(row.first), Fraction(row.second)] for row in rows]
    if len(vertices) > 1 and vertices[-1] == vertices[0]:
        vertices.pop()
    if len(vertices) < 3:
        raise InputError(f"{path}: it has {pluralise(len(vertices), 'vertex', 'vertices')}; three are needed")
    rounded = np.array([[float(row.first), float(row.second)] for row in rows[: len(vertices)]])
    try:
        polygon = Polygon(rounded + 0.0, name)  # no -0.0
    except InputError as error:
        raise InputError(f"{path}: {error} (vertex 0 is in line {rows[0].line})") from None
    return Domain(polygon, [[exact(x) for x in vertex] for vertex in vertices])
