"""The names of arrays' types; docstrings give their shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.signedinteger[Any]]
Int32 = NDArray[np.int32]
Int16 = NDArray[np.int16]
Mask = NDArray[np.bool_]
