"""Bounds at the ends of the range of data, of polygons and of k and c: known solutions, nothing lost."""

from __future__ import annotations

import math
import warnings
from functools import cache

import numpy as np
import pytest
import sentences
import sympy
from known_solutions import h1_errors
from symbolic import X

import unilateral as ul
from unilateral.arrays import Array
from unilateral.bounds import flux_residuals, residual_norm
from unilateral.bounds.residual_norm import underflow_allowance
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.geometry.mesh import Mesh
from unilateral.problems import data_checks
from unilateral.problems.data_checks import MAX_DATA_SIZE, MIN_DATA_SIZE


def square(length: float) -> list[list[float]]:
    return [[0, 0], [length, 0], [length, length], [0, length]]


def problem(name: str, u: str, length: float = 1.0, k: float = 1.0, c: float = 1.0) -> ul.Problem:
    """u = U(x / L) times a number: known, with contact on both ends of the square, or none."""
    t = f"(x*{1 / length!r})"
    kc = {"k": repr(k), "c": repr(c)}
    second = f"{k!r}*({1 / length!r})**2"
    first = f"{c!r}"
    if name == "constant":
        return ul.Problem(square(length), f"{u}*{first}", g=f"-{u}", **kc)
    if name == "cosine":
        return ul.Problem(square(length), f"{u}*({first} + pi**2*{second})*cos(pi*{t})", g=f"-2*{u}", **kc)
    ends = f"{u}/4"
    f = f"{u}*({first}*({t} - 1/2)**2 - 2*{second})"
    return ul.Problem(square(length), f, g=[None, ends, None, ends], free_sides=[0, 2], **kc)


U = {"constant": sympy.S.One, "cosine": sympy.cos(sympy.pi * X), "contact": (X - 1 / 2) ** 2}


def relative_error(mesh: Mesh, u_h: Array, form: Form, name: str, size: float) -> float:
    """The energy norm of u - u_h over the size of u."""
    u = U[name].subs(X, X / float(mesh.points.max()))
    return float(h1_errors(u, mesh, [u_h / size], k=form.k, c=form.c)[0])


def bounds(solution: ul.Solution) -> list[float]:
    """The cheap and the sharp bound of u, and those of lambda."""
    pair = solution.bounds, solution.sharp_bounds
    assert all(pair)
    return [number for item in pair if item for number in (item.u, item.multiplier)]


def has_valid_bounds(solution: ul.Solution, name: str, size: float) -> bool:
    solved = solution.solved
    error = relative_error(solved.mesh, solved.u_h, solved.form, name, size)
    return 0 < error <= min(bounds(solution)[::2]) / size < math.inf


@cache
def solution(name: str, size: float) -> ul.Solution:
    """The solution for data times a number."""
    return ul.solve(problem(name, repr(size)), h=1 / 16, H=1 / 8, stop=ul.Stop(algorithm="active_set"))


@pytest.mark.parametrize("name", U)
@pytest.mark.parametrize("power", [-463, -300, 300, 460])
def test_data_times_a_power_of_two_have_the_same_bounds_times_that(name: str, power: int) -> None:
    """But for those of numbers written as decimals, and for what is added as squares may vanish."""
    size = 2.0**power
    first = solution(name, 1.0)
    scaled = solution(name, size)
    missing = underflow_allowance(scaled.solved.mesh, scaled.solved.form)
    np.testing.assert_allclose(
        np.array(bounds(scaled)) / size, bounds(first), rtol=1e-6, atol=2 * missing / size
    )
    assert has_valid_bounds(scaled, name, size)


def test_data_beyond_are_refused() -> None:
    """2^-463 and 2^460 are within, by less than a factor of 2^10."""
    assert MIN_DATA_SIZE < 2.0**-463 < 2**10 * MIN_DATA_SIZE
    assert 2.0**460 < MAX_DATA_SIZE < 2.0**470
    for size in (0.9 * MIN_DATA_SIZE, 1.1 * MAX_DATA_SIZE):
        with sentences.raises(InputError):
            problem("constant", repr(size))


@pytest.mark.parametrize("size", [2.0**-560, 2.0**-900])
def test_squares_that_vanish_are_bounded(size: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were such data not refused, and as they may be on a part of the polygon. Control: nothing is added."""
    monkeypatch.setattr(data_checks, "MIN_DATA_SIZE", 0.0)

    def solve_small_cosine() -> ul.Solution:
        posed_problem = problem("cosine", repr(size))
        return ul.solve(posed_problem, h=1 / 8, H=1 / 4, stop=ul.Stop(algorithm="active_set"))

    assert has_valid_bounds(solve_small_cosine(), "cosine", size)
    monkeypatch.setattr(flux_residuals, "UNDERFLOW", 0.0)
    monkeypatch.setattr(residual_norm, "UNDERFLOW", 0.0)
    monkeypatch.setattr(residual_norm, "QUOTIENT_UNDERFLOW", 0.0)
    assert not has_valid_bounds(solve_small_cosine(), "cosine", size)


def test_bounds_are_as_small_as_f_beside_a_large_obstacle_that_is_not_touched() -> None:
    """u is as small as f; so are the bounds, though not the algebraic one's sizes, u - g and g."""
    size = 2.0**-400
    problem = ul.Problem(square(1), f"{size!r}*(1 + pi**2)*cos(pi*x)", g="-1")
    solution = ul.solve(problem, h=1 / 16, H=1 / 8)
    assert has_valid_bounds(solution, "cosine", size)
    assert max(bounds(solution)) < size
    assert solution.solved.result.bound < 0.01 * size


@pytest.mark.parametrize("algorithm", ["auto", "multigrid"])
@pytest.mark.parametrize("name", U)
@pytest.mark.parametrize("length", [1e-8, 1e-2, 1e4, 1e8])
def test_errors_are_bounded_on_polygons_of_all_sizes(length: float, name: str, algorithm: str) -> None:
    """Those that are too small to be condensed to the boundary are refused there.

    A constant has no error but rounding, which hides multigrid's stop.
    """
    sizes = {"h": length / 8, "H": length / 4, "stop": ul.Stop(algorithm=algorithm)}
    if length < 1e-3 and algorithm == "auto":
        with sentences.raises(InputError):
            ul.solve(problem(name, "1", length), **sizes)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ul.SolutionWarning)
        solution = ul.solve(problem(name, "1", length), **sizes)
    assert has_valid_bounds(solution, name, 1.0)
    assert solution.converged or (name, algorithm) == ("constant", "multigrid")


@pytest.mark.parametrize("size", [1e-100, 1e95])
@pytest.mark.parametrize("algorithm", ["uzawa", "active_set"])
def test_errors_are_bounded_for_the_largest_polygons_and_data(algorithm: str, size: float) -> None:
    """Where the integral of f has a square beyond the range; the active set may give up, and says so."""
    length = 1e20
    stop = ul.Stop(algorithm=algorithm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ul.SolutionWarning)
        solution = ul.solve(problem("contact", repr(size), length), h=length / 8, H=length / 4, stop=stop)
    assert has_valid_bounds(solution, "contact", size)
    assert solution.converged or algorithm == "active_set"


@pytest.mark.parametrize("name", U)
@pytest.mark.parametrize(
    ("k", "c"), [(1e-12, 1e-12), (1e-12, 1.0), (1.0, 1e12), (1.0, 1e-4), (1e12, 1e6), (1e12, 1e12)]
)
def test_errors_are_bounded_for_coefficients_of_all_sizes(k: float, c: float, name: str) -> None:
    """One of the two is nothing beside the other, or both are large or small."""
    solution = ul.solve(problem(name, "1", k=k, c=c), h=1 / 8, H=1 / 4)
    assert has_valid_bounds(solution, name, 1.0)
