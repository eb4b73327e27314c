"""The norm of a residual, from what it is made of on each triangle (supplement, F.1).

Let q be a flux with the normal flux of the residual R on the boundary, and rho = f + div q - c v, so that

    R(z) = (f, z) + <q.n, z> - k (grad v, grad z) - c (v, z) = (q - k grad v, grad z) + (rho, z).

On a triangle T with the longest edge d let m = ||q - k grad v||_T, let r be the norm of a part of rho that is
constant, o that of one with mean 0, and E that of the rest. With j = 3.83.., the first zero of the Bessel
function J_1, ||z - mean z||_T <= d/j |z|_{1,T}: this is the optimal constant in Poincare's inequality for
triangles of that diameter (Laugesen and Siudeja, J. Differential Equations 249, 2010).

(i) All of the mean-free part may count by the gradient of z or by z itself. So for every theta in [0, 1] the
part of T in R is at most s ||z||_T, the energy norm on T, with

    s^2 = (m + theta d/j o)^2 / k + ((r^2 + (1 - theta)^2 o^2)^{1/2} + E)^2 / c.

If E = 0 the best theta is (o - m d/j c/k) / (o (1 + (d/j)^2 c/k)), or the nearest end of [0, 1]. Where
(k/c)^{1/2} is below the size of T and v is linear, integration by parts on T may bound that part by a
smaller s' (`flux_residuals`). S_1 = (sum min(s, s')^2)^{1/2} bounds R on all of H^1.

(ii) Where ||z||_0 <= C |z|_1, let M^2 = sum (m + d/j o)^2 and N^2 = sum (r + E)^2. R is at most M |z|_1
+ N ||z||_0. If k N >= c C M, the largest value of that for energy norms of 1 is

    S_2 = (M + C N) / (k + c C^2)^{1/2},

and else it is that of (i) for theta = 1. Then R is at most S = min(S_1, S_2). As c tends to 0, S tends to its
value for c = 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, row_blocks
from unilateral.fem.form import Form
from unilateral.geometry.mesh import Mesh

BESSEL_ZERO = 3.8317
"""The first zero of the Bessel function J_1, 3.83170597.., rounded down."""
SQUARES_ROUNDING = 1e-9
"""At most this fraction of a sum of squares is rounding."""
UNDERFLOW = 1e-150
QUOTIENT_UNDERFLOW = 1e-156
"""What squares that underflow take from the root of a sum, at most.

It is UNDERFLOW times the sum of 1 and the squared perimeter, plus, where squares are divided by areas,
QUOTIENT_UNDERFLOW over the root of the least area. There are fewer than 10^9 triangles with fewer than 20
squares each, and each square is off by 2^-1074 at most. Squares are multiplied by areas and squares of
lengths, or divided by areas.
"""


def underflow_allowance(mesh: Mesh, form: Form) -> float:
    """A bound on what underflow takes from the energy norms of functions and from dual norms of residuals."""
    sizes = math.sqrt(form.k + form.c + 1 / form.k + 1 / form.coercivity)
    divided = QUOTIENT_UNDERFLOW / math.sqrt(float(mesh.areas.min()))
    return sizes * (UNDERFLOW * (1 + mesh.polygon.perimeter**2) + divided)


class ResidualParts(NamedTuple):
    """Norms of the parts of a residual on the triangles of a mesh, (m,) each, which include their rounding.

    `misfit` is that of q - k grad v; `mean`, `oscillation` and `remainder` are those of the parts of rho that
    are constant, have mean 0, and may have any mean. `s_prime` is s', infinite where it is not computed.
    `form` has the norm in which R is bounded.
    """

    mesh: Mesh
    form: Form
    misfit: Array
    oscillation: Array
    mean: Array
    remainder: Array
    s_prime: Array

    def squares(self) -> Array:
        """The square of min(s, s') on each triangle, (m,)."""
        squares = np.empty_like(self.misfit)
        for block in row_blocks(len(squares)):
            squares[block] = self.squares_on(block)
        return squares

    def dual_norms(self, squares: Array | None = None) -> tuple[float, float]:
        """S_1 and S: bounds on R(z) over the energy norm of z, for all z, and for z = 0 on clamped sides.

        S_1 is infinite for c = 0. If the `squares` (m,) of this residual are known, they serve again.
        """
        S_1 = _root_with_rounding(float((self.squares() if squares is None else squares).sum()))
        k = self.form.k
        c = self.form.c
        C = self.form.friedrichs
        if math.isinf(C):
            return S_1, S_1

        # (ii): S_2, where the largest value is not that of (i) for theta = 1
        gradient_squares = value_squares = 0.0
        for block in row_blocks(len(self.misfit)):
            m = self.misfit[block] + self.mesh.longest_edges[block] / BESSEL_ZERO * self.oscillation[block]
            r = self.mean[block] + self.remainder[block]
            gradient_squares += float(m @ m)
            value_squares += float(r @ r)
        M = _root_with_rounding(gradient_squares)
        N = _root_with_rounding(value_squares)
        if k * N < c * C * M:
            return S_1, S_1
        return S_1, min(S_1, (M + C * N) / math.hypot(math.sqrt(k), math.sqrt(c) * C))

    def shares(self, squares: Array) -> Array:
        """The triangles' parts (m,) of S^2: but for rounding their sum is at most that and at least half.

        They are the `squares` (m,) of this residual unless S_2 is smaller than S_1.
        """
        k = self.form.k
        c = self.form.c
        C = self.form.friedrichs
        S_1, S = self.dual_norms(squares) if math.isfinite(C) else (0.0, 0.0)
        if S == S_1:
            return squares
        # S_2^2 <= 2 sum (m^2 + r^2) / (k + c C^2), with C times (r + E) for r
        m = self.misfit + self.mesh.longest_edges / BESSEL_ZERO * self.oscillation
        r = C * (self.mean + self.remainder)
        return np.asarray((m**2 + r**2) / (k + c * C**2))

    def squares_on(self, triangles: slice | Index) -> Array:
        """The square of min(s, s') on each of some triangles, (k,)."""
        k = self.form.k
        c = self.form.c
        m = self.misfit[triangles]
        o = self.oscillation[triangles]
        r = self.mean[triangles]
        E = self.remainder[triangles]
        if not c:
            return np.full_like(m, math.inf)
        poincare = self.mesh.longest_edges[triangles] / BESSEL_ZERO
        ratio = c / k

        # (i): theta is best for E = 0, and any number where o = 0
        with np.errstate(divide="ignore", invalid="ignore"):
            theta = (o - ratio * poincare * m) / (o + ratio * poincare**2 * o)
        theta = np.fmin(np.fmax(theta, 0.0), 1.0)
        gradient_term = (m + theta * poincare * o) / math.sqrt(k)
        value_term = (np.hypot(r, (1 - theta) * o) + E) / math.sqrt(c)
        return np.asarray(np.minimum(gradient_term**2 + value_term**2, self.s_prime[triangles] ** 2))


def _root_with_rounding(squares: float) -> float:
    """The root of a sum of squares, with its rounding."""
    return (1 + SQUARES_ROUNDING) * math.sqrt(squares) + UNDERFLOW
