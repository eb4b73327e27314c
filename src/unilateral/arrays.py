"""The names of arrays' types, whose docstrings give their shapes, and blocks of long ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.signedinteger[Any]]
Int32 = NDArray[np.int32]
Int16 = NDArray[np.int16]
Mask = NDArray[np.bool_]

BLOCK = 1 << 13
"""Rows at a time, the numbers of which fit into a processor's cache."""


def blocks(count: int, size: int = 0) -> Iterator[slice]:
    """Of so many rows, by default BLOCK at a time."""
    for begin in range(0, count, size or BLOCK):
        yield slice(begin, min(begin + (size or BLOCK), count))
