"""The record for programs: what is relative is rounded up, what is unknown is no number, norms have names."""

import math
from fractions import Fraction

import pytest

import unilateral as ul
from unilateral.solution import record
from unilateral.solution.bounds import Bounds, relative_bound

pytestmark = pytest.mark.usefixtures("shared_cases")

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(("bound", "size"), [(1.0, 3.0), (0.1, 0.3), (2.0, 7e-300), (1.0, 1.0), (0.0, 1.0)])
def test_a_relative_bound_is_rounded_up(bound, size):
    """In rational arithmetic: never below the quotient, and above it by two units at most."""
    fraction = Fraction(relative_bound(bound, size))
    exact = Fraction(bound) / Fraction(size)
    assert exact < fraction <= exact * (1 + Fraction(2, 2**52)) + Fraction(5e-324)


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan])
def test_nothing_is_relative_to_what_may_be_0(size):
    assert math.isnan(relative_bound(0.5, size))


def test_bounds_print_no_part_that_is_not_known():
    known_bounds = Bounds(0.5, math.nan, 0.0)
    assert repr(known_bounds) == "Bounds: ||u - u_h||_1 at most 0.5, guaranteed"


def test_bounds_are_printed_in_the_norm_of_the_problem(clamped_solution):
    """That of u is k^(1/2) |.|_1 if c = 0."""
    assert repr(clamped_solution.bounds).startswith("Bounds: k^(1/2) |u - u_h|_1 at most ")
    other_solution = ul.solve("natural", h=1 / 8, H=1 / 4)
    assert repr(other_solution.bounds).startswith("Bounds: ||u - u_h||_1 at most ")


@pytest.fixture(scope="module")
def clamped_solution():
    """k = 2, c = 0, clamped on the left."""
    problem = ul.Problem(SQUARE, -1, [None, -1, None, None], [0, 2], k=2, c=0, u={3: 0})
    return ul.solve(problem, h=1 / 8, H=1 / 4)


def test_norms_are_named_with_their_coefficients(clamped_solution):
    norms = clamped_solution.certificate()["norms"]
    assert norms["h1"] == "k^(1/2) |v|_1 = k^(1/2) ||grad v||_0"
    assert norms["hm12"].endswith("over v that vanish on clamped sides")
    other_norms = ul.solve("natural", h=1 / 8, H=1 / 4).certificate()["norms"]
    assert other_norms["h1"].startswith("||v||_1 = (k ||grad v||_0^2 + c ||v||_0^2)")
    assert "clamped" not in other_norms["hm12"]


def test_the_algebraic_error_of_lambda_is_divided_by_beta_or_unknown(clamped_solution, monkeypatch):
    """On large meshes beta takes too long, and where it may be 0 nothing is known."""
    certificate = clamped_solution.certificate()
    assert 0 < certificate["beta"] < 1
    assert certificate["hm12_algebraic_bound"] == certificate["algebraic_bound"] / certificate["beta"]
    monkeypatch.setattr(record, "MAX_NODES_FOR_BETA", 10)
    unknown = clamped_solution.certificate()
    assert math.isnan(unknown["beta"])
    assert math.isnan(unknown["hm12_algebraic_bound"])


@pytest.mark.parametrize(("norm", "field"), [("h1", "h1_bound"), ("hm12", "hm12_bound")])
def test_the_total_bound_is_that_of_the_norm_that_was_asked_for(norm, field):
    certificate = ul.solve("natural", accuracy=0.5, norm=norm).certificate()
    assert certificate["norm"] == norm
    assert certificate["total_bound"] == certificate[field]
    assert certificate["h1_bound"] != certificate["hm12_bound"]
