"""Each rounding term of multigrid's bounds, on spaces of three hats with numbers made by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from unilateral.arrays import Array
from unilateral.discrete.multilevel import MultilevelProblem
from unilateral.fem import residual_rounding
from unilateral.fem.residual_rounding import UNIT_ROUNDOFF, Rounded
from unilateral.solvers import multigrid_bounds
from unilateral.solvers.multigrid_bounds import functional_norm_lower_bound, shift_to_feasible

A = sp.csr_array(np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]))
ROOMY = 1 + 1e-6
"""Bounds may be larger than the numbers of the examples by this."""


def grid(B: Array, inside: list[int], d: Array) -> SimpleNamespace:
    """No load; one hat inside each cell."""
    stub = SimpleNamespace(A=A, row_sums=A.sum(axis=1), nodal_weights=A.sum(axis=1))
    cells = SimpleNamespace(B=sp.csr_array(B), inner_node=np.array(inside))
    return SimpleNamespace(hierarchy=stub, cells=cells, load=np.zeros(3), d=d)


def norm_of_w(monkeypatch: pytest.MonkeyPatch, gap: Rounded, lambda_H: Array, B: Array, u: Array) -> float:
    """The second part of `shift_to_feasible` for gaps that are known like that."""
    monkeypatch.setattr(residual_rounding, "gap_with_rounding", lambda *_: gap)
    inside = np.flatnonzero(B.any(axis=0)).tolist()
    return shift_to_feasible(grid(B, inside, np.zeros(len(B))), u, lambda_H)[1]


MIDDLE = np.array([[0.0, 1.0, 0.0]])
HAT = np.sqrt(3.0)
"""The norm of the hat in the middle."""


@pytest.mark.parametrize(
    ("value", "lambda_H", "expected"),
    [(0.1, 0.0, 0.5), (0.3, 0.0, 0.0), (0.3, 1.0, 0.8), (-0.1, 0.0, 0.6)],
)
def test_a_gap_that_may_be_below_0_counts_by_its_doubt(monkeypatch, value, lambda_H, expected):
    """Known up to 1/4, for w and for v. Without contact none is needed above 1/4; with it w is the gap."""
    gap = Rounded(np.array([value]), np.array([0.25]))
    norm = norm_of_w(monkeypatch, gap, np.array([lambda_H]), MIDDLE, np.zeros(3))
    assert expected * HAT <= norm * (1 + 1e-15) <= ROOMY * expected * HAT + 1e-12


def test_gaps_are_divided_by_the_integral_of_the_hat(monkeypatch):
    """Of 1/2: w is twice the gap, and so is its doubt."""
    gap = Rounded(np.array([-1.0]), np.array([0.25]))
    norm = norm_of_w(monkeypatch, gap, np.zeros(1), 0.5 * MIDDLE, np.zeros(3))
    assert 2 * (1 + 2 * 0.25) * HAT <= norm * (1 + 1e-15) <= ROOMY * 3 * HAT


def test_doubts_of_neighbours_may_have_opposite_signs(monkeypatch):
    """||(d, -d, 0)||^2 = d^2 (2 + 2 + 3), where (d, d, 0) has 3 d^2."""
    gap = Rounded(np.zeros(2), np.ones(2))
    B = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    norm = norm_of_w(monkeypatch, gap, np.zeros(2), B, np.zeros(3))
    assert 2 * np.sqrt(7) <= norm * (1 + 1e-15) <= ROOMY * 2 * np.sqrt(7)


def test_the_rounding_of_v_is_a_doubt(monkeypatch):
    """u = 1 less a fifth of half a unit in the last place is 1 again: v is off by w, which counts twice."""
    small = 0.2 * UNIT_ROUNDOFF
    u = np.array([0.0, 1.0, 0.0])
    gap = Rounded(np.array([small]), np.zeros(1))
    assert 1.0 - small == 1.0
    assert norm_of_w(monkeypatch, gap, np.ones(1), MIDDLE, u) >= (small + 2 * small) * HAT
    none = norm_of_w(monkeypatch, Rounded(np.zeros(1), np.zeros(1)), np.ones(1), MIDDLE, 0 * u)
    assert none == 0


def test_a_lower_bound_of_a_norm_counts_the_rounding_of_A_v_against_it(monkeypatch):
    """As if a quarter of A v was computed, the rest was its doubt: R . v over half of ||v|| is no bound."""
    R = np.array([1.0, -2.0, 0.5])
    v = np.linalg.solve(A.toarray(), R)
    stub = SimpleNamespace(A=A, row_sums=A.sum(axis=1), nodal_weights=np.full(3, 0.25))
    expected = A @ v / np.abs(R).max()
    monkeypatch.setattr(multigrid_bounds, "_solve_by_cycles", lambda _, R: np.linalg.solve(A.toarray(), R))
    doubt = 0.75 * np.abs(expected)
    monkeypatch.setattr(
        residual_rounding, "product_with_rounding", lambda *_: Rounded(0.25 * expected, doubt)
    )
    # what `nodal_weights` are to fulfil
    assert np.linalg.eigvalsh(np.diag(stub.nodal_weights) - 4 * A.toarray())[-1] <= 0
    assert 0 < functional_norm_lower_bound(stub, R) <= np.sqrt(R @ v)


def test_a_lower_bound_is_rounded_down(monkeypatch):
    """By SLACK, of which twice as large a one halves it; rounding of A v is next to nothing here."""
    R = np.array([1.0, -2.0, 0.5])
    stub = SimpleNamespace(A=A, row_sums=A.sum(axis=1), nodal_weights=A.sum(axis=1))
    monkeypatch.setattr(multigrid_bounds, "_solve_by_cycles", lambda _, R: np.linalg.solve(A.toarray(), R))
    before = functional_norm_lower_bound(stub, R)
    monkeypatch.setattr(multigrid_bounds, "NORM_ROUNDING_FACTOR", 2 * multigrid_bounds.NORM_ROUNDING_FACTOR)
    assert functional_norm_lower_bound(stub, R) == pytest.approx(before / 2, rel=1e-9)


def test_the_sum_of_the_lift_and_the_solution_is_rounded():
    """e_i = +-UNIT |u_i| has e . A e <= k sum A_ii e_i^2, k entries to a row; by all signs."""
    u = np.array([3.0, -1.0, 2.0])
    finest = SimpleNamespace(hierarchy=SimpleNamespace(A=A))
    problem = SimpleNamespace(dirichlet_lift=np.ones(3), multigrid=SimpleNamespace(finest=finest))
    lift_rounding = MultilevelProblem._bound_lift_rounding(problem, u)
    for signs in np.ndindex(2, 2, 2):
        e = UNIT_ROUNDOFF * u * (2 * np.array(signs) - 1)
        assert np.sqrt(e @ (A @ e)) <= lift_rounding
    assert MultilevelProblem._bound_lift_rounding(SimpleNamespace(dirichlet_lift=np.zeros(3)), u) == 0
