"""Infinitely many transitions on cells of many sizes: runs one by one, and the consistency term."""

from dataclasses import replace
from fractions import Fraction as Q
from itertools import pairwise

import numpy as np
import pytest
import sentences
from conftest import exact_errors, load
from scipy.integrate import quad
from scipy.special import beta

from study.experiments.cells.measure import alternating_cases, measure
from unilateral.discrete.condensed import discretise, discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.problems.case_certificate import certify_case
from unilateral.solvers.stop import Stop

STOP = Stop(fraction=0.01, max_steps=200_000, algorithm="nesterov")
CASES = [load("cantor_2"), load("violates_jj_jjj")]
MESH = make_structured_mesh(square(), 1 / 8)


@pytest.fixture(scope="module")
def table():
    return measure(MESH, CASES, [1, 1 / 2], 2, STOP)


def test_errors_are_those_of_the_cases_solved_one_by_one(table):
    """D by the split: the square of ||u - u_h||_1 less that of ||u - z_h||_1.

    To 2 %, for the algebraic errors of both may be 1 % of it. The table has u from its first case, and here
    it is that of the second one.
    """
    np.testing.assert_allclose(table["H"], [[1, 1 / 2], [1 / 2, 1 / 4]])
    original = discretise(CASES[1].problem, MESH, make_uniform_partition(square(), 1 / 4))
    for k, case in enumerate(CASES):
        exact = CaseProjections(replace(original.exact.ritz, case=case), cell_means(case, original.partition))
        discrete = discretise_case(original.spaces, exact)
        solution = solve_condensed_problem(discrete, STOP)
        h1 = exact_errors(discrete, solution).h1
        row = table.isel(case=k, start=1, level=1)
        split = np.sqrt(h1**2 - float(table["ritz_error"]) ** 2)
        assert float(row["discrete_error"]) == pytest.approx(split, rel=0.02)
        assert float(row["consistency"]) == pytest.approx(discrete.exact.cell_means.consistency, rel=1e-12)
    assert np.all(table["converged"] == 1)
    assert np.all(table["algebraic_bound"] <= 0.01 * table["discrete_error"])


def integrals(family, power, n, carried):
    """(n,) integrals over n cells of s^power bumps: of lambda (carried 0) or of the gap (1)."""
    values = np.zeros(n)
    ends = np.arange(n + 1) / n
    for a, b in ((float(a), float(b)) for a, b in family.sort_intervals()[carried]):
        shapes = (
            lambda t, a=a, b=b: (t - a) ** power * (1 - ((t - a) / (b - a)) ** 2) ** 4,
            lambda t, a=a, b=b: ((t - a) * (b - t) / (b - a)) ** power,
        )
        cuts = [a, *ends[(ends > a) & (ends < b)], b]
        for low, high in pairwise(cuts):
            values[int((low + high) / 2 * n)] += quad(shapes[carried], low, high, epsabs=0, limit=200)[0]
    return values


@pytest.mark.parametrize(("name", "gamma"), [("cantor_2", 2), ("violates_jj_jjj", 1 / 2)])
def test_the_consistency_term_is_that_by_a_sum_over_intervals(name, gamma):
    """Of the intervals one by one, by adaptive quadrature. The first and the last of 8 cells are off the set.

    What is left carries a hundredth of a gap: 128 pieces, each with 0.01/3^(gamma + 1) of the integral of one
    of the sixth generation's 32 gaps. Control: the sum for another exponent is not within 1 %.
    """
    n = 8
    case = load(name)
    atom = case.atoms[0]
    flux = integrals(atom.cantor_set, float(atom.alpha), n, 0)
    expected = n * flux @ integrals(atom.cantor_set, gamma, n, 1)
    consistency = cell_means(case, make_uniform_partition(square(), 1 / n)).consistency
    assert expected * (1 - 1e-7) <= consistency <= 1.01 * expected
    assert not expected <= n * flux @ integrals(atom.cantor_set, gamma + 0.1, n, 1) <= 1.01 * expected


@pytest.mark.parametrize("gamma", [Q(1, 2), Q(3, 2)])
def test_contact_and_a_gap_alternate(gamma):
    """On each cell between 1/4 and 3/4; by hand the integrals are those of Beta functions, with l = H/2.

    Of lambda l^(alpha+1) B((alpha+1)/2, 5)/2, of the gap l^(gamma+1) B(gamma+1, gamma+1). Control: cells
    that keep both apart.
    """
    (case,) = alternating_cases(square(), Q(1, 8), Q(1, 2), [gamma])
    declared = {"hypotheses": {"j": True, "jj": gamma >= 1, "jjj": True}}
    known_case = certify_case(replace(case, declaration=declared))
    np.testing.assert_allclose(
        known_case.contact, [(0, k / 8, k / 8 + 1 / 16) for k in range(2, 6)], rtol=0, atol=1e-14
    )
    flux = (1 / 16) ** 1.5 * beta(0.75, 5) / 2
    gap = (1 / 16) ** float(gamma + 1) * beta(float(gamma + 1), float(gamma + 1))
    expected = 4 * flux * gap * 8
    assert cell_means(case, make_uniform_partition(square(), 1 / 8)).consistency == pytest.approx(
        expected, rel=1e-10
    )
    assert cell_means(case, make_uniform_partition(square(), 1 / 16)).consistency < 1e-12 * expected


def test_cases_with_another_u_are_refused():
    with sentences.raises(InputError):
        measure(MESH, [load("cantor_2"), load("thirds")], [1 / 2], 3, STOP)
