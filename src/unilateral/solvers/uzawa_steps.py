"""Steps of `uzawa`'s loop from y, with its scaled gap F = S y + b and its residual R = min(y, rho F).

Without a given rho a step has `rho_factor` / lambda_max(S). All minimise y.Sy/2 + b.y over y >= 0, whose
gradient is F. Each costs one application of S, the loop's own: F is affine, so it is known on the line
through two points where it is known.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from unilateral.arrays import Array

UZAWA_STEP_FACTOR = 1.9
"""Uzawa's rho, if none is given, in units of 1 / lambda_max(S); steps are contractions below 2 (5.2)."""


class Uzawa:
    """The steps (5.2), (5.3) themselves: y - rho F, with negative values set to 0."""

    rho_factor = UZAWA_STEP_FACTOR

    def __init__(self, S: Array, b: Array, rho: float, y: Array) -> None:
        pass

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Replace y (m,) by the next iterate."""
        np.subtract(y, R, out=y)


class Nesterov:
    """Momentum with adaptive restart: B. O'Donoghue, E. Candes, Found. Comput. Math. 15 (2015) 715-732."""

    rho_factor = 1.0

    def __init__(self, S: Array, b: Array, rho: float, y: Array) -> None:
        self.rho = rho
        self.t = 1.0
        self.previous_y = y.copy()
        self.previous_F = np.zeros_like(y)

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Replace y (m,) by the next iterate."""
        # the step from z = y + momentum (y - y before), whose F is on the line through the two known ones
        t = 0.5 * (1 + math.sqrt(1 + 4 * self.t**2))
        momentum = (self.t - 1) / t
        z = _extrapolate(y, self.previous_y, momentum)
        slope = _extrapolate(F, self.previous_F, momentum)
        slope *= self.rho
        new = np.subtract(z, slope, out=slope)
        np.maximum(new, 0, out=new)
        z -= new
        self.previous_y[:] = y
        self.previous_F[:] = F
        y[:] = new
        new -= self.previous_y
        # z - new is rho times a gradient: where new - y goes uphill the momentum starts again
        self.t = 1.0 if z @ new > 0 else t


def _extrapolate(current: Array, previous: Array, momentum: float) -> Array:
    """The values current + momentum (current - previous); shape (m,)."""
    ahead = current - previous
    ahead *= momentum
    ahead += current
    return ahead


class BarzilaiBorwein:
    """Projected gradients with steps s.s/s.Ss: Y.-H. Dai, R. Fletcher, Numer. Math. 100 (2005) 21-47.

    Their safeguard is included, without which such steps may cycle: where the objective exceeds a reference,
    the step is cut to the minimum along it. The reference is the largest of a run of `patience` values that
    brought no new best one. Values are relative to the best one, so that their differences survive rounding.
    They are in units of the data (a power of 2, which rounds nothing), because the square of a huge number
    would be infinite.
    """

    rho_factor = 1.0
    patience = 10

    def __init__(self, S: Array, b: Array, rho: float, y: Array) -> None:
        self.unit = 2.0 ** (math.frexp(max(np.max(np.abs(b)), np.max(np.abs(y))))[1] - 1)
        self.step_length = rho
        self.previous_y = y.copy()
        self.previous_F = np.zeros_like(y)
        self.value = 0.0
        self.reference = math.inf
        self.candidate = 0.0
        self.values_since_best = 0

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Replace y (m,) by the next iterate."""
        # the step s has changed the objective by slope + curvature / 2, slope = s . F, curvature = s . S s
        s = (y - self.previous_y) / self.unit
        change = (F - self.previous_F) / self.unit
        curvature = float(s @ change)
        if curvature > 0:
            slope = float(s @ (self.previous_F / self.unit))
            self.step_length = float(s @ s) / curvature
            if self.value + slope + 0.5 * curvature > self.reference:
                cut = -slope / curvature
                reach = cut * self.unit
                y[:] = self.previous_y + reach * s
                F = self.previous_F + reach * change
                slope = cut * slope
                curvature = cut**2 * curvature
            self._update_reference(self.value + slope + 0.5 * curvature)
        self.previous_y = y.copy()
        self.previous_F = F.copy()
        y[:] = np.maximum(0, y - self.step_length * F)

    def _update_reference(self, value: float) -> None:
        """Take note of a value of the objective, relative to the best one so far."""
        if value < 0:
            self.reference -= value
            self.value = 0.0
            self.candidate = 0.0
            self.values_since_best = 0
            return
        self.value = value
        self.candidate = max(self.candidate, value)
        self.values_since_best = self.values_since_best + 1
        if self.values_since_best == self.patience:
            self.reference = self.candidate
            self.candidate = value
            self.values_since_best = 0


class Newton:
    """The primal-dual active set: S y = -b on the cells where y > rho F, 0 elsewhere, then y < 0 set to 0.

    A semismooth Newton method: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002) 865-888. It
    ends when the set repeats; that it does is not proved for this S, but observed. S has to be regular.
    """

    rho_factor = 1.0

    def __init__(self, S: Array, b: Array, rho: float, y: Array) -> None:
        self.S = S
        self.b = b
        self.rho = rho

    def __call__(self, y: Array, F: Array, R: Array) -> None:
        """Replace y (m,) by the next iterate."""
        contact = np.flatnonzero(y > self.rho * F)
        y[:] = 0
        if len(contact):
            factor = cho_factor(self.S[np.ix_(contact, contact)], check_finite=False)
            y[contact] = np.maximum(0, cho_solve(factor, -self.b[contact], check_finite=False))


UzawaStep = Uzawa | Nesterov | BarzilaiBorwein | Newton
STEP_METHODS: dict[str, type[UzawaStep]] = {
    "uzawa": Uzawa,
    "nesterov": Nesterov,
    "barzilai_borwein": BarzilaiBorwein,
    "newton": Newton,
}
