"""Which algorithm iterates, and when it stops."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

from unilateral.errors import InputError, meant

ALGORITHMS = ("auto", "uzawa", "nesterov", "barzilai_borwein", "newton", "active_set", "multigrid")


@dataclass(frozen=True)
class Stop:
    """When and how the iteration ends.

    `fraction` is the share of the discretisation error that the algebraic error may have; an absolute
    `tolerance` takes its place. `rho` None is 1.9 / lambda_max(S) for plain Uzawa and 1 / lambda_max(S) for
    the others. The `algorithm` "auto" is multigrid on large meshes, the active set where S is singular,
    Nesterov where no rho is given and more than `max_steps` plain steps are predicted, else plain Uzawa.
    Raises InputError for what is not a number, for an unknown algorithm, and for a rho that has no use.
    """

    fraction: float = 0.01
    tolerance: float | None = None
    max_steps: int = 200_000
    algorithm: str = "auto"
    rho: float | None = None

    def __post_init__(self) -> None:
        for name in ("fraction", "tolerance", "max_steps", "rho"):
            given = getattr(self, name)
            if given is not None and not isinstance(given, Real):
                raise InputError(f"{name} is {given!r}; it has to be a number")
        if self.algorithm not in ALGORITHMS:
            known = ", ".join(ALGORITHMS)
            raise InputError(
                f"the algorithm '{self.algorithm}' is unknown; the known ones are {known}"
                + meant(self.algorithm, ALGORITHMS)
            )
        if self.algorithm in ("active_set", "multigrid") and self.rho is not None:
            raise InputError(
                f"the algorithm {self.algorithm} has no step rho; leave rho out, or take uzawa or nesterov"
            )
