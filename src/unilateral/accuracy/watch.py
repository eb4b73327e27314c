"""Watches a search while it works: how far its level is, and whether the limits are kept."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from unilateral.accuracy.goal import Goal
from unilateral.system.memory import forget_peak, peak_mb

ENCLOSING = "f enclosed"
"""The phase of a level whose time hardly depends on its size."""


class OutOfBudget(BaseException):
    """A limit of the goal was reached in the midst of a level. Like an interrupt it is no Exception."""


@dataclass
class Watch:
    """The watch over a search, from the time `begin` on.

    While the search works there is a `goal`, and it may take `most_mb`. The level's mesh has so many
    `unknowns`, 0 while that is not known. `expected` are the level's seconds in all, and `seconds` those of
    its phases so far. Limits, and whether an interrupt was `asked` for, are checked between phases and
    whenever `look` is called. What is `raised` then is raised again at the next phase, because libraries that
    call back may lose it.
    """

    begin: float = field(default_factory=time.perf_counter)
    goal: Goal | None = None
    most_mb: float = math.inf
    asked: bool = False
    raised: BaseException | None = None
    phase: str = ""
    unknowns: int = 0
    expected: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)
    since: float = 0.0

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self.begin

    @property
    def level_seconds(self) -> float:
        """The seconds of the level so far."""
        return sum(self.seconds.values()) + self.elapsed - self.since

    def begin_level(self) -> None:
        """A new level begins, with its first phase, the mesh."""
        forget_peak()
        self.phase, self.unknowns, self.expected, self.seconds = "", 0, 0.0, {}
        self.at("mesh")

    def at(self, phase: str, unknowns: int = 0) -> None:
        """The level comes to this phase."""
        if self.raised:
            raise self.raised
        self.look()
        self._next(phase)
        self.unknowns = unknowns or self.unknowns

    def end_level(self) -> dict[str, float]:
        """Ends the level; the seconds of its phases."""
        self._next("")
        return self.seconds

    def look(self) -> None:
        """Raises OutOfBudget or KeyboardInterrupt, once while a search works."""
        if self.goal is None:
            return
        spent = (self.goal.seconds, self.elapsed), (self.goal.memory(self.most_mb), peak_mb())
        reached = ", ".join(name for (name, most), so_far in spent if so_far > most)
        if self.asked or reached:
            self.goal = None
            self.raised = KeyboardInterrupt() if self.asked else OutOfBudget(reached)
            raise self.raised

    def rest(self) -> None:
        """The search is over: nothing is raised any more."""
        self.goal, self.phase = None, ""

    def resume(self, goal: Goal, phase: str) -> None:
        """Another phase after a search: raises at once what would have ended that."""
        self.goal, self.expected, self.seconds = goal, 0.0, {}
        self.look()
        self._next(phase)

    def interrupt(self) -> None:
        """Raises KeyboardInterrupt if a search works, else before the next one does."""
        self.asked = True
        self.look()

    def _next(self, phase: str) -> None:
        now = self.elapsed
        if self.phase:
            self.seconds[self.phase] = now - self.since
        self.phase, self.since = phase, now
