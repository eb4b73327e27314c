"""The scene `deep`: a level against the same problem condensed to the boundary; the table of all levels."""

import numpy as np
import pytest
from conftest import discrete, load

from unilateral.discrete.condensed import solve
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.deep import measure as deep


@pytest.fixture(scope="module")
def levels():
    return [deep.level([load("natural"), load("thirds")], 1 / n, 2, Stop()) for n in (16, 32)]


@pytest.mark.parametrize("name", ["natural", "thirds"])
def test_errors_are_those_of_the_condensed_problem(levels, name):
    """Another solver and, by the split, another way to the error; u is off by its algebraic bound at most.

    Control: the error on the other level is half or twice as large.
    """
    condensed = discrete(name, 32, 16)
    solution = solve(condensed, Stop())
    found, other = (of.sel(case=name).squeeze() for of in reversed(levels))
    apart = abs(float(found["h1_error"]) - solution.errors.h1)
    within = float(found["algebraic_bound"]) + solution.result.bound
    assert apart <= within < abs(float(other["h1_error"]) - solution.errors.h1)
    ritz, means = condensed.exact.ritz, condensed.exact.means
    assert float(found["interpolation_error"]) == pytest.approx(ritz.interpolation_error, rel=1e-9)
    assert float(found["projection_error"]) == pytest.approx(means.projection_error, rel=1e-9)


def test_bounds_of_the_dual_norm_are_in_order(levels):
    """Both enclose one number, which is not 0."""
    for of in levels:
        assert np.all(of["hm12_error_lower"] <= of["hm12_error_upper"])
        assert np.all(of["hm12_error_lower"] > 0)


def test_the_table_has_each_level_with_its_own_partition(levels):
    table = deep.diagonal(levels)
    runs = tables.along_ratio(table, 1 / 2)
    assert runs["h"].values.tolist() == [1 / 16, 1 / 32]
    assert runs["H"].values.tolist() == [1 / 8, 1 / 16]
    errors = table["h1_error"].sel(case="natural").values
    assert np.isfinite(errors).tolist() == [[True, False], [False, True]]
    assert errors[1, 1] == float(levels[1]["h1_error"].sel(case="natural").squeeze())
