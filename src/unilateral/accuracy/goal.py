"""What is wanted of a search, and what may be spent on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

NORMS = ("h1", "hm12")
"""The norms of an accuracy: that of u in H1, and that of lambda in H^{-1/2}."""
ACCURACY = 0.05
"""The relative error to reach where neither sizes nor an accuracy are given."""
MAX_SECONDS = 600.0
"""The seconds for all levels together, where no limit is given."""


@dataclass(frozen=True)
class Goal:
    """An accuracy in a norm, "h1" of u or "hm12" of lambda, and what may be spent on it.

    It is relative to the solution's norm, unless it is `absolute`. The limits are unknowns on the finest
    mesh, seconds in all, and MB, in any case no more than are free; a limit that is not given is None.
    `sharp` asks for the sharp bound, without which the bound on lambda is far above its error.
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
        """The largest number of unknowns that the finest mesh may have."""
        return math.inf if self.max_unknowns is None else self.max_unknowns

    @property
    def seconds(self) -> tuple[str, float]:
        """The limit on the seconds: its name in messages, and its value."""
        if self.max_seconds is None:
            return f"max_seconds={MAX_SECONDS:g} by default", MAX_SECONDS
        return f"max_seconds={self.max_seconds:g}", self.max_seconds

    def memory(self, most: float) -> tuple[str, float]:
        """The limit on the MB: its name in messages, and its value; the machine has `most`."""
        if self.max_memory is None or most < self.max_memory:
            return f"{most:.0f} MB of this machine's memory", most
        return f"max_memory={self.max_memory:g}", self.max_memory
