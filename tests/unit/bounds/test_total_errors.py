"""The theorem in finite dimensions, where all norms are known, and each of its terms.

Functions are vectors, and the form is k K + c M with K = G^T G, which has the constants in its kernel. Some
unknowns are clamped, some have contact, some neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest

from unilateral.bounds.total_errors import ResidualBounds, bound_residual, bound_total_errors
from unilateral.fem.form import Form

N = 7
CLAMPED = np.array([0, 1])
CONTACT = np.array([2, 3])


def dual_norm(A, functional):
    return math.sqrt(max(functional @ np.linalg.solve(A, functional), 0.0))


@dataclass(frozen=True)
class Parts:
    """The residual, as `ResidualParts` has it, but exactly: (q - k grad v, G z) and the functional of rho."""

    space: Space
    form: Form
    misfit: np.ndarray
    remainder_load: np.ndarray

    def _replace(self, s_prime=math.inf, **changes):
        assert np.all(np.isinf(s_prime))
        return replace(self, **changes)

    def functional(self):
        return self.space.G.T @ self.misfit + self.remainder_load

    def dual_norms(self, squares=None):
        A = self.space.matrix(self.form)
        V = self.space.V
        functional = self.functional()
        on_H1 = dual_norm(A, functional) if self.form.c else math.inf
        return on_H1, dual_norm(A[np.ix_(V, V)], functional[V])


class Space:
    """Random K and M, the unknowns V that are not clamped, and Friedrichs' constant."""

    def __init__(self, rng, clamped):
        weights = np.triu(rng.uniform(size=(N, N)), 1)
        self.pairs = np.argwhere(weights)
        self.G = np.zeros((len(self.pairs), N))
        for row, (i, j) in enumerate(self.pairs):
            self.G[row, [i, j]] = np.array([1.0, -1.0]) * math.sqrt(weights[i, j])
        B = rng.normal(size=(N, N))
        self.K = self.G.T @ self.G
        self.M = B @ B.T / N + 0.1 * np.eye(N)
        self.clamped = CLAMPED if clamped else CLAMPED[:0]
        self.V = np.setdiff1d(np.arange(N), self.clamped)
        inner = np.ix_(self.V, self.V)
        if clamped:
            values = np.linalg.eigvals(np.linalg.solve(self.K[inner], self.M[inner]))
            self.friedrichs = math.sqrt(float(values.real.max()))
        else:
            self.friedrichs = math.inf

    def matrix(self, form):
        return form.k * self.K + form.c * self.M


def exact(A, load, u_D, g, clamped):
    """The solution of the variational inequality, by trying all sets in contact, and its multiplier."""
    for number in range(4):
        active = CONTACT[[bool(number & 1), bool(number & 2)]]
        expected = np.concatenate([clamped, active])
        u = np.zeros(N)
        u[clamped] = u_D
        u[active] = g[active - CONTACT[0]]
        remaining = np.setdiff1d(np.arange(N), expected)
        u[remaining] = np.linalg.solve(
            A[np.ix_(remaining, remaining)], load[remaining] - A[np.ix_(remaining, expected)] @ u[expected]
        )
        multiplier = A @ u - load
        if np.all(u[CONTACT] >= g - 1e-10) and np.all(multiplier[CONTACT] >= -1e-10):
            return u, multiplier
    raise AssertionError("one of the sets is the one in contact")


class Trial:
    """A random problem with u_h and v near its solution, and both residuals."""

    def __init__(self, seed, clamped):
        rng = np.random.default_rng(seed)
        space = Space(rng, clamped)
        c = 0.0 if clamped and rng.random() < 0.4 else 10 ** rng.uniform(-4, 4)
        self.form = Form(10 ** rng.uniform(-2, 2), c, (0,) * clamped, friedrichs=space.friedrichs)
        A = space.matrix(self.form)
        load = rng.normal(size=N)
        u_D = rng.normal(size=len(space.clamped))
        g = 0.5 * rng.normal(size=2)
        self.u, self.multiplier = exact(A, load, u_D, g, space.clamped)
        self.space = space
        self.A = A

        # q.n on clamped sides and in contact, sigma >= 0 there; q is that of a third function, or of u_h = v
        near = 10 ** rng.uniform(-6, 1)
        self.sigma = np.zeros(N)
        self.sigma[space.clamped] = self.multiplier[space.clamped] + near * rng.normal(
            size=len(space.clamped)
        )
        self.sigma[CONTACT] = np.abs(self.multiplier[CONTACT] + near * rng.normal(size=2))
        q = self.form.k * space.G @ (self.u + near * rng.normal(size=N))
        same = rng.random() < 0.3

        def lift_v(v, extra):
            """v, moved to u_D, and to g and above."""
            v = v + extra
            v[space.clamped] = u_D
            v[CONTACT] = np.maximum(v[CONTACT], g)
            return v

        def residual(v):
            misfit = q - self.form.k * space.G @ v
            remainder_load = load + self.sigma - space.G.T @ q - self.form.c * space.M @ v
            return Parts(space, self.form, misfit, remainder_load)

        v = lift_v(self.u, near * 10 ** rng.uniform(-3, 0) * rng.normal(size=N))
        self.u_h = v if same else self.u + near * rng.normal(size=N)
        feasible = lift_v(self.u_h, 0.1 * near * rng.normal(size=N) * (not same and rng.random() < 0.5))
        if same:
            q = self.form.k * space.G @ v
            self.sigma[CONTACT] *= v[CONTACT] <= g
        slack = float(self.sigma[CONTACT] @ (feasible[CONTACT] - g))
        slack_of_v = float(self.sigma[CONTACT] @ (v[CONTACT] - g))
        y = feasible - self.u_h
        y_D = np.where(np.isin(np.arange(N), space.clamped), y, 0.0)
        self.v_residual_parts = residual(v)
        self.u_residual = bound_residual(residual(self.u_h), 0.0, slack)
        self.v_residual = bound_residual(self.v_residual_parts, 0.0, slack_of_v)
        self.D = math.sqrt(y @ A @ y)
        self.D_clamped = math.sqrt(y_D @ A @ y_D)
        self.gap = float((v[CONTACT] - g).min())
        self.v = v

    def bounds(self, **changes):
        arguments = {
            "u_residual": self.u_residual,
            "v_residual": self.v_residual,
            "D": self.D,
            "D_clamped": self.D_clamped,
        }
        arguments |= changes
        return bound_total_errors(1.0, **arguments, sigma_distance=0.0)

    def errors(self):
        """X, Y on V, the norm of j in N, and the largest gamma <lambda, w>."""
        V = self.space.V
        e = self.u - self.u_h
        j = self.multiplier - self.sigma
        Y = dual_norm(self.A[np.ix_(V, V)], j[V])
        N_norm = self.form._replace(c=max(self.form.c, self.form.k / self.form.friedrichs**2))
        E = dual_norm(self.space.matrix(N_norm), j)
        return math.sqrt(e @ self.A @ e), Y, E, self.gap * float(self.multiplier[CONTACT].sum())


@pytest.fixture(scope="module")
def trials():
    return [Trial(seed, clamped) for seed in range(400) for clamped in (False, True)]


def violations(trials, bounds=Trial.bounds):
    """(4,) how often u, lambda_, fluxes and product are below the error, by more than rounding."""
    values = np.zeros(4, dtype=int)
    for trial in trials:
        result = bounds(trial)
        energy = 1 + trial.u @ trial.A @ trial.u
        stated = np.array([result.u, result.lambda_, result.reaction_bound, result.gamma_force_bound])
        rounding = 1e-9 * np.array([math.sqrt(energy)] * 3 + [energy])
        values += trial.errors() > stated + rounding
    return values


def test_no_error_is_larger_than_its_bound(trials):
    """Nor is any bound infinite, c = 0 or not."""
    assert not violations(trials).any()
    assert all(np.all(np.isfinite(trial.bounds())) for trial in trials)


def drop_slack(trial):
    return trial.bounds(
        u_residual=trial.u_residual._replace(B=0.0), v_residual=trial.v_residual._replace(B=0.0)
    )


@pytest.mark.parametrize(
    ("bounds", "wrong"),
    [
        (drop_slack, [True, True, True, True]),
        (lambda trial: trial.bounds(D=0.0), [True, True, True, False]),
        (lambda trial: trial.bounds(D_clamped=0.0), [True, False, False, False]),
    ],
    ids=["B", "D", "D_D"],
)
def test_no_term_can_be_left_out(trials, bounds, wrong):
    """Controls: the product belongs to v, which has no D; D_D lowers what is taken from X only."""
    assert np.array_equal(violations(trials, bounds) > 0, wrong)


@pytest.mark.parametrize(("field", "wrong"), [(True, False), (False, True)])
def test_of_a_part_of_v_the_norm_is_enough(trials, field, wrong):
    """v is a function without a residual on V, plus one of which the norm is known, or not even that."""

    def bounds(trial):
        original = trial.v_residual_parts
        V = trial.space.V
        w = np.zeros(N)
        w[V] = -np.linalg.solve(trial.A[np.ix_(V, V)], original.functional()[V])
        misfit = original.misfit + trial.form.k * trial.space.G @ w
        components = replace(
            original, misfit=misfit, remainder_load=original.remainder_load + trial.form.c * trial.space.M @ w
        )
        missing = field * math.sqrt(w @ trial.A @ w)
        return trial.bounds(v_residual=bound_residual(components, missing, trial.v_residual.B))

    assert violations(trials, bounds).any() == wrong


def test_all_bounds_grow_on_the_exact_mesh(trials):
    """Norms by the growth, products by its square; and lambda_H - sigma counts for lambda_H."""
    trial = trials[1]
    before = np.array(trial.bounds())
    grown = bound_total_errors(
        1.5, trial.u_residual, trial.v_residual, trial.D, trial.D_clamped, sigma_distance=0.0
    )
    assert np.array(grown) == pytest.approx(before * [1.5, 1.5, 1.5, 1.5, 2.25])
    after = bound_total_errors(
        1.5, trial.u_residual, trial.v_residual, trial.D, trial.D_clamped, sigma_distance=2.0
    )
    assert np.array(after) == pytest.approx(before * [1.5, 1.5, 1.5, 1.5, 2.25] + [0, 3, 3, 0, 0])


@pytest.mark.parametrize("field", ["S_1", "S"])
def test_without_a_useful_v_the_multiplier_is_bounded_by_that_of_u(field):
    """Y <= D + (S^2 + 2 B + D^2)^{1/2}: 2 + 7 for S = 3, B = 18, D = 2, on H^1 or on V."""
    useless = ResidualBounds(*[math.inf] * 5, missing_norm=0.0, B=0.0)
    u = useless._replace(**{field: 3.0}, B=18.0)
    errors = bound_total_errors(1.0, u, useless, D=2.0, D_clamped=0.0, sigma_distance=0.0)
    assert errors.lambda_ == pytest.approx(9, rel=1e-8)


def test_a_small_residual_is_not_lost_beside_y():
    """X^2 = S^2 + D^2 - (D - eta)^2 with 50 digits: D = 1, S = 1e-6, eta from 1e-3 to 1e-15."""
    for eta in (1e-3, 1e-9, 1e-12, 1e-15):
        u = ResidualBounds(1e-6, 1e-6, math.inf, math.inf, math.inf, missing_norm=0.0, B=0.0)
        v = u._replace(S_1=eta, S=eta)
        X = bound_total_errors(1.0, u, v, D=1.0, D_clamped=0.0, sigma_distance=0.0).u
        with mpmath.workdps(50):
            exact = mpmath.sqrt(mpmath.mpf(1e-6) ** 2 + 1 - (1 - mpmath.mpf(eta)) ** 2)
            assert exact <= X <= exact * (1 + 1e-8)
