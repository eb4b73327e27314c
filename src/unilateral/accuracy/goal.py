"""What is wanted of a search, and what may be spent on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

NORMS = ("h1", "hm12")
"""Of u in H1, and of lambda in H^{-1/2}."""
MAX_SECONDS = 600.0
"""For all levels together, unless somebody says otherwise."""


@dataclass(frozen=True)
class Goal:
    """An accuracy in a norm, "h1" of u or "hm12" of lambda, and what may be spent on it.

    It is relative to the solution's norm, unless it is `absolute`. Limits are unknowns on
    the finest mesh, seconds in all, and MB, in any case no more than are free. `sharp` asks for the sharp
    bound, without which that of lambda is far above its error.
    """

    accuracy: float
    norm: str = "h1"
    max_unknowns: float = math.inf
    max_seconds: float = MAX_SECONDS
    max_memory: float = math.inf
    sharp: bool = False
    absolute: bool = False

    @property
    def limited(self) -> bool:
        """Whether somebody set a limit, and means it to be spent."""
        unlimited = math.isinf(self.max_unknowns) and math.isinf(self.max_memory)
        return not unlimited or self.max_seconds != MAX_SECONDS
