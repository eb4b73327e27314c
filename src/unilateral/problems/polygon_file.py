"""Polygons from files: their vertices, a row of a CSV file each, or the outline of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, pluralise
from unilateral.geometry.files import read_mesh
from unilateral.geometry.polygon import Polygon
from unilateral.system.columns import read_columns

COLUMN_SUFFIXES = (".csv", ".txt", ".dat")
"""The endings of files with columns of numbers; any other file is one of a mesh."""


def read_polygon(path: str | PathLike[str], name: str, where: str, side_names: Mapping[str, Any]) -> Polygon:
    """The polygon of that name in a file: columns x and y, whose last row may be the first one again.

    Of a mesh it is the outline, whose sides have the names of the mesh's curves, too. Raises InputError, with
    the file and the line, for what is no simple polygon, listed anticlockwise.
    """
    if Path(path).suffix.lower() not in COLUMN_SUFFIXES:
        try:
            outline = read_mesh(path).polygon
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        return Polygon(outline.vertices, name, {**outline.side_names, **side_names})
    vertices, lines = read_columns(path, where, "x and y")
    if len(vertices) > 1 and np.all(vertices[-1] == vertices[0]):
        vertices = vertices[:-1]
    if len(vertices) < 3:
        raise InputError(f"{path}: it has {pluralise(len(vertices), 'vertex', 'vertices')}; three are needed")
    try:
        return Polygon(vertices + 0.0, name, side_names)  # no -0.0
    except InputError as error:
        raise InputError(f"{path}: {error} (vertex 0 is in line {lines[0]})") from None
