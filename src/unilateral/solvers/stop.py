"""Which algorithm iterates, and when it stops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real

from unilateral.errors import InputError, quote_input, suggest_name

ALGORITHMS = ("auto", "uzawa", "nesterov", "barzilai_borwein", "newton", "active_set", "multigrid")


@dataclass(frozen=True)
class Stop:
    """When and how the iteration ends.

    `fraction` is the share of the discretisation error that the algebraic error may have; an absolute
    `tolerance` takes its place. `rho` None is 1.9 / lambda_max(S) for plain Uzawa and 1 / lambda_max(S) for
    the others. The `algorithm` "auto" is multigrid on large meshes, the active set where S is singular,
    Nesterov where no rho is given and more than `max_steps` plain steps are predicted, else plain Uzawa.
    Raises InputError for a number that is none, for an unknown algorithm, and for a rho that has no use.

    >>> import unilateral as ul
    >>> s = ul.solve("natural", h=1 / 16, H=1 / 8, stop=ul.Stop(algorithm="uzawa", tolerance=1e-6))
    >>> s.solved.result.algorithm, s.solved.result.bound <= 1e-6
    ('uzawa', True)
    """

    fraction: float = 0.01
    tolerance: float | None = None
    max_steps: int = 200_000
    algorithm: str = "auto"
    rho: float | None = None

    def __post_init__(self) -> None:
        for name in ("fraction", "tolerance", "max_steps", "rho"):
            value = getattr(self, name)
            if value is None and name in ("tolerance", "rho"):
                continue
            if not isinstance(value, Real) or isinstance(value, bool):
                raise InputError(f"{name} is {quote_input(repr(value))}; it has to be a number")
            may_be_0 = name in ("tolerance", "max_steps")
            if not (0 < float(value) < math.inf or (may_be_0 and value == 0)):
                raise InputError(f"{name} is {value}; it has to be a positive number")
        if not isinstance(self.max_steps, Integral):
            raise InputError(f"max_steps is {self.max_steps}; it has to be a whole number")
        if not isinstance(self.algorithm, str) or self.algorithm not in ALGORITHMS:
            names = ", ".join(ALGORITHMS)
            raise InputError(
                f"the algorithm '{self.algorithm}' is unknown; the known ones are {names}"
                + suggest_name(str(self.algorithm), ALGORITHMS)
            )
        if self.algorithm in ("active_set", "multigrid") and self.rho is not None:
            raise InputError(
                f"the algorithm {self.algorithm} has no step rho; leave rho out, or take uzawa or nesterov"
            )
