"""What is wanted of a search, and what may be spent on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

NORMS = ("h1", "hm12")
"""Of u in H1, and of lambda in H^{-1/2}."""
MAX_SECONDS = 600.0
"""For all levels together, where no limit is given."""


@dataclass(frozen=True)
class Goal:
    """An accuracy in a norm, "h1" of u or "hm12" of lambda, and what may be spent on it.

    It is relative to the solution's norm, unless it is `absolute`. Limits are unknowns on
    the finest mesh, seconds in all, and MB, in any case no more than are free; None where none is given.
    `sharp` asks for the sharp bound, without which that of lambda is far above its error.
    """

    accuracy: float
    norm: str = "h1"
    max_unknowns: float | None = None
    max_seconds: float | None = None
    max_memory: float | None = None
    sharp: bool = False
    absolute: bool = False

    @property
    def limited(self) -> bool:
        """Whether a limit was given; then the search goes on until it is reached."""
        return any(each is not None for each in (self.max_unknowns, self.max_seconds, self.max_memory))

    @property
    def unknowns(self) -> float:
        """At most, on the finest mesh."""
        return math.inf if self.max_unknowns is None else self.max_unknowns

    @property
    def seconds(self) -> tuple[str, float]:
        """The limit as messages call it, and its value."""
        if self.max_seconds is None:
            return f"max_seconds={MAX_SECONDS:g} by default", MAX_SECONDS
        return f"max_seconds={self.max_seconds:g}", self.max_seconds

    def memory(self, most: float) -> tuple[str, float]:
        """The same for the MB, of which the machine has so many at `most`."""
        if self.max_memory is None or most < self.max_memory:
            return f"{most:.0f} MB of this machine's memory", most
        return f"max_memory={self.max_memory:g}", self.max_memory
