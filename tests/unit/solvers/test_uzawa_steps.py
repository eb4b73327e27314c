"""Steps other than Uzawa's own against their algorithms as published, in the objective and its gradient."""

import math
from itertools import islice

import numpy as np
import pytest

from unilateral.solvers.uzawa_steps import BarzilaiBorwein, Nesterov, Newton

RANDOM = np.random.default_rng(24)
AXES = np.linalg.qr(RANDOM.standard_normal((3, 3)))[0]
S = AXES @ np.diag([1e-5, 10**-2.5, 1]) @ AXES.T
B = RANDOM.standard_normal(3)
START = np.ones(3)
"""Conditioned so badly that momentum restarts and the safeguard cuts, each more than once."""


def objective(y):
    return float(0.5 * y @ S @ y + B @ y)


def iterates(step, count):
    """(count, 3) of the loop, which tells F = S y + b only."""
    y = START.copy()
    vectors = []
    for _ in range(count):
        F = S @ y + B
        step(y, F, np.minimum(y, F))
        vectors.append(y.copy())
    return np.array(vectors)


def momentum(restarts, rho):
    """O'Donoghue and Candes (2015): t from 1, and again where the step turns against the gradient at z."""
    x = old = START
    t = 1.0
    k = 0
    while True:
        t_next = (1 + math.sqrt(1 + 4 * t**2)) / 2
        z = x + (t - 1) / t_next * (x - old)
        old = x
        x = np.maximum(0, z - rho * (S @ z + B))
        t = t_next
        if (z - x) @ (x - old) > 0:
            t = 1.0
            restarts.append(k)
        k += 1
        yield x


def test_momentum_with_restarts_is_as_published():
    """Equal but for rounding, for whose growth over the steps there is room."""
    restarts = []
    expected = np.array(list(islice(momentum(restarts, 0.9), 400)))
    assert len(restarts) > 1
    computed = iterates(Nesterov(S, B, 0.9, START), 400)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def dai_fletcher(cuts, rho):
    """Section 4 of Dai and Fletcher (2005) with L = 10 and values of the objective themselves."""
    x = START
    best = objective(START)
    candidate = best
    reference = math.inf
    waited = 0
    k = 0
    step = rho
    y = np.maximum(0, START - rho * (S @ START + B))
    while True:
        yield y
        s = y - x
        step = (s @ s) / (s @ S @ s)
        if objective(y) > reference:
            cuts.append(k)
            y = x - (s @ (S @ x + B)) / (s @ S @ s) * s
        value = objective(y)
        if value < best:
            best = value
            candidate = value
            waited = 0
        else:
            candidate = max(candidate, value)
            waited = waited + 1
            if waited == 10:
                reference = candidate
                candidate = value
                waited = 0
        x = y
        y = np.maximum(0, y - step * (S @ y + B))
        k = k + 1


def test_barzilai_and_borwein_s_steps_have_the_published_safeguard():
    """Equal but for rounding, for whose growth over the steps there is room."""
    cuts = []
    expected = np.array(list(islice(dai_fletcher(cuts, 0.9), 50)))
    assert len(cuts) > 1
    computed = iterates(BarzilaiBorwein(S, B, 0.9, START), 50)
    np.testing.assert_allclose(computed, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_the_reference_is_the_largest_of_ten_values_without_a_new_best_one():
    """By hand; values are relative to the best one, and so is the reference when that changes."""
    step = BarzilaiBorwein(S, B, 0.9, START)
    for value in (5.0, 7.0, -2.0, 4.0, 9.0, 3.0, 2.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        step._update_reference(value)
        assert step.reference == math.inf
    step._update_reference(6.0)
    assert step.reference == 9
    step._update_reference(-2.0)
    assert step.reference == 11


@pytest.mark.parametrize(
    ("start", "expected"),
    [([1.0, 1.0], [0.91 / 0.19, 0.0]), ([1.0, 0.0], [1.0, 0.0]), ([0.0, 1.0], [0.0, 0.1])],
)
def test_a_newton_step_is_that_by_hand(start, expected):
    """S = [[1, 0.9], [0.9, 1]] and b = (-1, -0.1), with what is positive at the start taken for contact.

    There S y = -b, (0.91, -0.8)/0.19 on both, and 0 elsewhere, and in the place of what is negative.
    """
    matrix = np.array([[1, 0.9], [0.9, 1]])
    b = np.array([-1.0, -0.1])
    y = np.array(start)
    rho = 1e-3
    F = np.where(y > 0, matrix @ y + b, 1.0)
    Newton(matrix, b, rho, y)(y, F, np.minimum(y, rho * F))
    np.testing.assert_allclose(y, expected, rtol=1e-14)
