"""Partitions of the boundary in CSV files."""

from __future__ import annotations

import os

import numpy as np
import pandas as pd

from unilateral.errors import InputError
from unilateral.geometry.partition import Partition, from_points
from unilateral.geometry.polygon import Polygon

SAME = 1e-9
"""Arc lengths that differ by at most this part of the perimeter are the same."""


def read(path: str | os.PathLike[str], polygon: Polygon) -> Partition:
    """The cells of a CSV file: the columns `start` and `end`, arc lengths anticlockwise from vertex 0.

    Raises InputError, with the file, for what cannot be read, cells that do not join, and as `from_points`.
    """
    try:
        table = pd.read_csv(path, skipinitialspace=True)
        start, end = (table[name].to_numpy(dtype=float) for name in ("start", "end"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError) as error:
        raise InputError(f"{path}: the columns start and end are needed, a row per cell ({error})") from None
    order = np.argsort(start)
    start, end = start[order], end[order]
    apart = np.flatnonzero(~(np.abs(start[1:] - end[:-1]) <= SAME * polygon.perimeter))
    if apart.size:
        first = apart[0]
        raise InputError(
            f"{path}: a cell ends at s = {end[first]:g}, the next begins at {start[first + 1]:g}; cells have "
            "to follow one another"
        )
    try:
        return from_points(polygon, np.append(start, end[-1:]))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
