"""Truncated V-cycles, against dense matrices."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from nested import Nested, refined
from scipy.linalg import eigh

from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.solvers.truncated import Truncated

CASES = ["nothing", "a strip", "islands", "the boundary"]


@cache
def nested() -> Nested:
    return refined(structured(named("lshape"), 1), 3)


def fixed(case: str) -> np.ndarray:
    boundary = nested().levels[-1].boundary.astype(np.intp)
    chosen = {"nothing": slice(0), "a strip": slice(9, 16), "islands": slice(0, None, 3)}
    return np.sort(boundary[chosen.get(case, slice(None))])


def truncated_products(case: str) -> list[np.ndarray]:
    """(T P)^T A (T P) and so on, from the finest level down."""
    levels = nested().levels
    S, found = levels[-1].A.toarray(), []
    S[fixed(case)] = 0
    S[:, fixed(case)] = 0
    for level in levels[:0:-1]:
        P = level.P.toarray()
        S = P.T @ S @ P
        found.append(S)
    return found


@pytest.mark.parametrize("case", CASES)
def test_matrices_are_those_of_the_truncated_functions(case: str) -> None:
    cycle = Truncated(nested().levels, fixed(case))
    cut_away = 0
    for S, found, level in zip(
        truncated_products(case), cycle.matrices[::-1], nested().levels[-2::-1], strict=True
    ):
        gone = np.diag(S) < 1e-12
        expected = S + np.diag(np.where(gone, level.A.diagonal(), 0))
        assert np.abs(found.toarray() - expected).max() < 1e-13
        cut_away += np.count_nonzero(gone)
    # Hats of corners with a single triangle.
    assert (cut_away > 0) == (case == "the boundary")


def test_the_levels_matrices_stay_as_they_are() -> None:
    before = [level.A.data.copy() for level in nested().levels]
    Truncated(nested().levels, fixed("the boundary"))
    assert all(
        np.array_equal(level.A.data, data) for level, data in zip(nested().levels, before, strict=True)
    )


def correction(case: str) -> np.ndarray:
    """T P C P^T T (n, n)."""
    cycle, n = Truncated(nested().levels, fixed(case)), nested().levels[-1].n
    columns = []
    for r in np.eye(n):
        z = np.zeros(n)
        cycle.correct(z, r)
        columns.append(z)
    return np.column_stack(columns)


@pytest.mark.parametrize("case", CASES)
def test_corrections_are_symmetric_and_never_too_long(case: str) -> None:
    C, A = correction(case), nested().levels[-1].A.toarray()
    assert np.abs(C - C.T).max() < 1e-13
    assert np.abs(C[fixed(case)]).max(initial=0) == 0
    # Of C A, in exact arithmetic between 0 and 1; the others belong to what coarse functions do not reach.
    values = eigh(A @ C @ A, A, eigvals_only=True)
    assert values[0] > -1e-12
    assert 0.9 < values[-1] < 1 + 1e-12


def test_a_correction_starts_from_z() -> None:
    cycle, A = Truncated(nested().levels, fixed("islands")), nested().levels[-1].A
    rng = np.random.default_rng(1)
    z, r = rng.standard_normal((2, A.shape[0]))
    expected, found = np.zeros_like(z), z.copy()
    cycle.correct(expected, r - A @ z)
    cycle.correct(found, r)
    assert np.allclose(found, z + expected)
    assert not np.allclose(found, z)
