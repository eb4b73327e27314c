"""The names of arrays' types; docstrings give their shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]
