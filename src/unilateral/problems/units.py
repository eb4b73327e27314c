"""Constant coefficients: -k lap u + c u = f is (1.1) in other units of length, u and flux.

If c = 0 the unit of length stays, and the term u is missing in (1.1). Let now c > 0.

Let v(X) = k^{1/2} u(x) for X = (c/k)^{1/2} x. Then -lap v + v = k^{1/2} f / c, and u >= g is v >= k^{1/2} g.
With lambda = k du/dn, dv/dN is c^{-1/2} lambda, as a given flux is c^{-1/2} q. For v and w made of u and z

    (v, w)_1 = k (grad u, grad z)_0 + c (u, z)_0,   <dv/dN, w> = <lambda, z>,

so that ||v||_1 is the energy norm (k |u|_1^2 + c ||u||_0^2)^{1/2}, and ||dv/dN||_{-1/2} the norm of lambda
that is dual to it. Errors, bounds and accuracies are therefore the same numbers for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ONE, ZERO, Expression

HALF = Fraction(1, 2)


@dataclass(frozen=True)
class Units:
    """What 1 in the paper's equation is in the user's units, for exact k and c, each rounded once."""

    k: Expression = ONE
    c: Expression = ONE

    def __repr__(self) -> str:
        return f"Units: k = {rounded(self.k):.6g}, c = {rounded(self.c):.6g}"

    @property
    def trivial(self) -> bool:
        return self.k == ONE and self.c in (ZERO, ONE)

    @property
    def reaction(self) -> float:
        """What u is multiplied by in (1.1)."""
        return 0.0 if self.c == ZERO else 1.0

    @property
    def per_area(self) -> Expression:
        """k over the squared unit of length."""
        return self.c if self.reaction else self.k

    @cached_property
    def length(self) -> float:
        return rounded((self.k / self.per_area) ** HALF)

    @cached_property
    def value(self) -> float:
        """The unit of u and g."""
        return rounded(self.k**-HALF)

    @cached_property
    def load(self) -> float:
        """The unit of f."""
        return rounded(self.per_area * self.k**-HALF)

    @cached_property
    def flux(self) -> float:
        """The unit of lambda."""
        return rounded(self.per_area**HALF)

    @cached_property
    def force(self) -> float:
        """The unit of the integral of lambda."""
        return rounded(self.k**HALF)
