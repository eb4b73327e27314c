"""What is asked of the loop, and what may be spent on it. It imports little, for the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from unilateral.errors import InputError, quote_input
from unilateral.solvers.stop import Stop

ERROR_NORMS = ("h1", "hm12")
"""The norms of errors that have bounds: that of u in H1, and that of lambda in H^{-1/2}."""
GOAL_NORMS = (*ERROR_NORMS, "force")
"""What an accuracy may be one of: these norms, and the force over some sides."""
DEFAULT_ACCURACY = 0.05
"""The relative error to reach where neither sizes nor an accuracy are given."""
DEFAULT_MAX_SECONDS = 600.0
"""The seconds for all levels together, where no limit is given."""


@dataclass(frozen=True)
class Goal:
    """An accuracy, what may be spent on it, and how it is to be reached.

    Parameters
    ----------
    accuracy
        The error to reach: relative to the norm of the solution, unless it is `absolute`.
    norm
        "h1" of u, "hm12" of lambda, or "force", the half-width of the interval of the force over the `sides`.
    max_unknowns, max_seconds, max_memory : optional
        Limits: unknowns of the finest mesh, seconds in all, MB of the process. A limit that is given is used
        up. If none is, the loop ends as soon as the accuracy is out of reach.
    sharp
        Takes the sharp bound, without which the bound on lambda is far above its error.
    kind
        "structured" or "unstructured" uniform meshes; "" leaves the choice to the loop.
    stop
        The algorithm of each level, and the limit of its steps.
    sides
        The sides whose force an accuracy of a force is for.

    Raises
    ------
    InputError
        For a norm that is none, an accuracy that cannot be reached, and a limit that is not above 0.
    """

    accuracy: float
    norm: str = "h1"
    max_unknowns: float | None = None
    max_seconds: float | None = None
    max_memory: float | None = None
    sharp: bool = False
    absolute: bool = False
    kind: str = ""
    stop: Stop = field(default_factory=Stop)
    sides: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.norm, str) or self.norm not in GOAL_NORMS:
            raise InputError(f"the norm '{quote_input(self.norm)}' is none of {', '.join(GOAL_NORMS)}")
        if not 0 < self.accuracy < math.inf:
            raise InputError(f"the accuracy {self.accuracy:g} must be a positive number, such as 1e-2")
        if self.accuracy >= 1 and not self.absolute:
            wrong = f"the accuracy {self.accuracy:g} is relative"
            raise InputError(f"{wrong} and must be below 1, or made absolute (absolute=)")
        for name, limit in self.limits.items():
            if limit is not None and not limit > 0:
                raise InputError(f"{name} is {limit:g}; it has to be above 0")

    @property
    def limits(self) -> dict[str, float | None]:
        """The limits by their names; None where none was given."""
        return {
            "max_unknowns": self.max_unknowns,
            "max_seconds": self.max_seconds,
            "max_memory": self.max_memory,
        }

    @property
    def has_limits(self) -> bool:
        """Whether a limit was given, which is then used up."""
        return any(limit is not None for limit in self.limits.values())

    @property
    def can_adapt(self) -> bool:
        """Whether meshes need not be uniform: no kind and no algorithm was asked for."""
        return not self.kind and self.stop.algorithm == "auto" and self.stop.rho is None
