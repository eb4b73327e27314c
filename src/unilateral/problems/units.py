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

from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ONE, ZERO, Expression

HALF = Fraction(1, 2)


@dataclass(frozen=True)
class Units:
    """What 1 in the paper's equation is in the user's units, for exact k and c, each rounded once.

    `length`, `value`, `load`, `flux` and `force` are the units of lengths, of u and g, of f, of lambda and of
    the integral of lambda. `reaction` is what u is multiplied by in (1.1), and `per_area` is k over the
    squared unit of length. Units are `trivial` where the problem is (1.1) as it is.
    """

    k: Expression
    c: Expression
    trivial: bool
    reaction: float
    per_area: Expression
    length: float
    value: float
    load: float
    flux: float
    force: float

    def __repr__(self) -> str:
        return f"Units: k = {rounded(self.k):.6g}, c = {rounded(self.c):.6g}"


def make_units(k: Expression = ONE, c: Expression = ONE) -> Units:
    """The units that come from k and c."""
    per_area = k if c == ZERO else c
    return Units(
        k=k,
        c=c,
        trivial=k == ONE and c in (ZERO, ONE),
        reaction=0.0 if c == ZERO else 1.0,
        per_area=per_area,
        length=rounded((k / per_area) ** HALF),
        value=rounded(k**-HALF),
        load=rounded(per_area * k**-HALF),
        flux=rounded(per_area**HALF),
        force=rounded(k**HALF),
    )
