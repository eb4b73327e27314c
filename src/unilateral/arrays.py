"""Names for the types of arrays, whose shapes docstrings give, and blocks of long arrays."""

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
"""Long arrays are worked on this many rows at a time, whose numbers fit into a processor's cache."""


def blocks(count: int, size: int = 0) -> Iterator[slice]:
    """Slices of so many rows, by default BLOCK at a time."""
    for begin in range(0, count, size or BLOCK):
        yield slice(begin, min(begin + (size or BLOCK), count))
