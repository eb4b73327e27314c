"""The polar atoms of cases: at a point inside a side, and at a vertex."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import sympy

from unilateral.errors import InputError
from unilateral.formulas.grammar import MAX_DENOMINATOR
from unilateral.geometry.polygon import Polygon
from unilateral.problems.atoms import ON_SIDE
from unilateral.problems.polar import Polar


def harmonic(
    polygon: Polygon,
    side: int,
    t: sympy.Expr,
    alpha: sympy.Expr,
    cutoff: sympy.Expr | None = None,
    times: sympy.Expr = sympy.S.One,
) -> Polar:
    """The atom with flux times * s_+^alpha on its side: C rho^(1+alpha) cos((1+alpha)(pi - theta)).

    C = 1 / ((1 + alpha) sin(alpha pi)), alpha > -1 not an integer. Raises InputError for other alpha,
    and where it has no cutoff and Omega reaches behind its side, so that theta would not be unique.
    """
    if alpha.is_integer or alpha <= -1:
        raise InputError(f"a harmonic atom needs alpha > -1 that is not an integer, not {alpha}")
    factor = times / ((1 + alpha) * sympy.sin(alpha * sympy.pi))
    atom = Polar(polygon, side, float(t), 1 + alpha, sympy.pi, factor, cutoff)
    if cutoff is None and np.any(atom.local(polygon.vertices)[1] < -ON_SIDE):
        raise InputError(f"a harmonic atom on side {side} of '{polygon.name}' needs a cutoff")
    return atom


def corner(
    polygon: Polygon,
    side: int,
    kind: str,
    alpha: sympy.Expr | None = None,
    cutoff: sympy.Expr | None = None,
    times: sympy.Expr = sympy.S.One,
) -> Polar:
    """An atom at the vertex of angle omega at which the side begins, by its kind.

    `free`: rho^(pi/omega) cos(pi theta/omega), without flux on both sides. `held`:
    -rho^(pi/omega) sin(pi theta/omega), without trace, lambda = (pi/omega) rho^(pi/omega - 1) on both.
    `transition`: lambda = rho^alpha on the side that begins there and 0 on the one before.
    Raises InputError where omega is no simple fraction of pi, or the transition would need a logarithm.
    """
    share = sympy.Rational(Fraction(polygon.angles[side] / np.pi).limit_denominator(MAX_DENOMINATOR))
    if abs(float(share) * np.pi - polygon.angles[side]) > ON_SIDE:
        raise InputError(
            f"the angle at vertex {side} of '{polygon.name}' is no fraction of pi with a denominator of at "
            f"most {MAX_DENOMINATOR}, as an atom there needs"
        )
    omega = share * sympy.pi
    if kind != "transition":
        beta, theta_0, factor = (1 / share, sympy.S.Zero, 1) if kind == "free" else (1 / share, omega / 2, -1)
    elif alpha is None or ((1 + alpha) * share).is_integer or alpha <= -1:
        raise InputError(
            f"a transition at a vertex needs alpha > -1, (1 + alpha) omega/pi no integer, not {alpha}"
        )
    else:
        beta, theta_0, factor = 1 + alpha, omega, -1 / ((1 + alpha) * sympy.sin(omega * (1 + alpha)))
    return Polar(polygon, side, 0.0, beta, theta_0, times * factor, cutoff, omega)
