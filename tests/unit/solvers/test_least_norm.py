"""The least of l . v + |v|_S: conditions of optimality, and values that are known."""

import numpy as np
import pytest

from unilateral.fem.condense import condense
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solvers import least_norm as of_least
from unilateral.solvers.least_norm import minimise_linear_plus_norm

S = condense(make_structured_mesh(square(), 1 / 8)).A_3
N = len(S)
NONE = np.zeros(N, dtype=bool)


def bounds(rng, k):
    """Numbers -1 and 0, or 1 and 0, and some without a bound."""
    c = np.where(rng.random((N, k)) < 0.3, rng.choice([-1.0, 1.0], k), 0.0)
    return np.where(rng.random((N, 1)) < 0.1, -np.inf, c)


@pytest.mark.parametrize("force", [0.0, 0.1, 1.0, 10.0, 1e4, 1e100])
@pytest.mark.parametrize("start", ["all", "none", "some"])
def test_v_is_optimal(force, start):
    """The problem is convex: v is best if the gradient is 0 where v > c, and not below 0 where v = c.

    Where v = 0 is best there is no gradient: then no value below 0 is found beside it.
    """
    rng = np.random.default_rng(3)
    c = bounds(rng, 6)
    load = force * rng.random(N) * (rng.random(N) < 0.5) / N
    active = np.isfinite(c) & {"all": True, "none": False, "some": rng.random(c.shape) < 0.5}[start]
    v = minimise_linear_plus_norm(S, load, c, active, NONE)
    assert np.all(v >= c)
    for w, low in zip(v.T, c.T, strict=True):
        norm = np.sqrt(w @ S @ w)
        if norm == 0:
            assert low.max() <= 0
            for beside in np.maximum(rng.standard_normal((50, N)), low):
                assert load @ beside + np.sqrt(beside @ S @ beside) >= 0
            continue
        gradient = load + S @ w / norm
        scale = load.max() + np.sqrt(S.max())
        assert np.abs(gradient[w > low + 1e-9]).max(initial=0) < 1e-9 * scale
        assert gradient.min() > -1e-9 * scale


def test_the_minimum_over_one_unknown_is_the_closed_form():
    """l v + s |v| over v >= c: c where c > 0, 0 where l <= s and c <= 0, and c where l > s."""
    for load, c, expected in ((0.5, 1.0, 1.0), (0.5, -1.0, 0.0), (3.0, -1.0, -1.0), (2.0, 0.0, 0.0)):
        for active in (True, False):
            plus_norm = minimise_linear_plus_norm(
                np.array([[4.0]]), np.array([load]), np.array([[c]]), np.array([[active]]), NONE[:1]
            )
            assert plus_norm == pytest.approx(expected, abs=1e-12), (load, c, active)


def test_sets_that_do_not_settle_leave_the_best_one(monkeypatch):
    """Never worse than a constant, never below c, and not worse after more steps."""
    rng = np.random.default_rng(5)
    c = bounds(rng, 20)
    load = rng.random(N)
    constant = np.ones((N, 1)) * c.max(axis=0)
    values = [of_least._objective(S, load, constant)]
    for steps in range(4):
        monkeypatch.setattr(of_least, "MAX_SET_UPDATES", steps)
        v = minimise_linear_plus_norm(S, load, c, np.isfinite(c) & (rng.random(c.shape) < 0.5), NONE)
        assert np.all(v >= c)
        values.append(of_least._objective(S, load, v))
        assert np.all(values[-1] <= values[0] + 1e-12)
    assert np.any(values[-1] < values[0] - 1e-3)


def test_the_pivoted_matrix_exchanges_v_and_s_v():
    rng = np.random.default_rng(6)
    usual = rng.random(N) < 0.5
    v = rng.standard_normal(N)
    expected = np.where(usual, S @ v, v)
    expected_value = np.where(usual, v, S @ v)
    assert of_least._principal_pivot(S, usual) @ expected == pytest.approx(expected_value, abs=1e-10)
