"""The active-set solver against an interior-point code (clarabel) and the KKT conditions."""

import math

import numpy as np
import pytest
from conftest import interior_point
from offsets import OFFSETS, middles, operator

from unilateral.solvers.active_set import solve_by_active_set


@pytest.fixture(params=[("square", 2), ("square", 1), ("square", 0.5), ("lshape", 2), ("lshape", 0.5)])
def any_operator(request):
    polygon, ratio = request.param
    return operator(8, ratio, polygon)


@pytest.fixture(params=OFFSETS)
def offset(request, any_operator):
    return OFFSETS[request.param](any_operator)


def test_u_equals_that_of_an_interior_point_code(any_operator, offset):
    """||u - u'||_1 <= 1e-8 of the size of the solution: clarabel's accuracy."""
    expected = interior_point(any_operator, offset)
    result = solve_by_active_set(any_operator, offset, 1e-6)
    assert result.converged
    size = max(1.0, float(np.linalg.norm(expected)))
    assert np.linalg.norm(any_operator.D_factor @ result.lambda_H - expected) <= 1e-8 * size


def test_comparison_notices_a_sign_error_and_a_lost_cell(any_operator):
    offset = OFFSETS["partial contact"](any_operator)
    expected = interior_point(any_operator, offset)
    lambda_H = solve_by_active_set(any_operator, offset, 1e-6).lambda_H
    values = np.where(lambda_H == lambda_H.max(), 0, lambda_H)
    for wrong in (-lambda_H, values):
        assert np.linalg.norm(any_operator.D_factor @ wrong - expected) > 1e-3


def test_kkt_conditions_hold_to_rounding(any_operator, offset):
    """lambda >= 0, F >= 0, lambda F = 0 on every cell; 1e-12 of the data's size for m <= 128 cells."""
    result = solve_by_active_set(any_operator, offset, 1e-6)
    assert result.lambda_H.min() >= 0
    violation = np.minimum(result.lambda_H, any_operator.gap(result.lambda_H, offset))
    assert np.abs(violation).max() < 1e-12 * np.abs(offset).max()


def test_contact_is_what_the_offsets_say():
    """In full contact lambda_H is 2 + sin 3s by construction, unique as beta > 0."""
    dual_operator = operator(8, 2)
    full = solve_by_active_set(dual_operator, OFFSETS["full contact"](dual_operator), 1e-6).lambda_H
    np.testing.assert_allclose(full, 2 + np.sin(3 * middles(dual_operator)), rtol=1e-12)
    loaded = {
        name: np.count_nonzero(solve_by_active_set(dual_operator, make(dual_operator), 1e-6).lambda_H)
        for name, make in OFFSETS.items()
    }
    assert loaded["no contact"] == 0
    assert 0 < loaded["partial contact"] < 16


@pytest.mark.parametrize(("ratio", "applications"), [(2, 2), (0.5, 1)])
def test_the_bound_takes_one_product_with_D_for_u_and_one_for_its_energy(ratio, applications):
    """Where beta is 0 the energy bound takes that for u alone."""
    dual_operator = operator(8, ratio)
    assert (
        solve_by_active_set(
            dual_operator, OFFSETS["partial contact"](dual_operator), 1e-5
        ).operator_applications
        == applications
    )


def test_a_solver_that_gives_up_is_reported(monkeypatch):
    def give_up(*_, **__):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr("scipy.optimize.nnls", give_up)
    dual_operator = operator(8, 0.5)
    with pytest.warns(RuntimeWarning, match="active_set .* above the tolerance"):
        result = solve_by_active_set(dual_operator, OFFSETS["partial contact"](dual_operator), 1e-6)
    assert not result.converged
    assert not result.lambda_H.any()
    assert result.bound > 0.1


def test_a_tolerance_below_rounding_is_reported():
    dual_operator = operator(8, 2)
    with pytest.warns(RuntimeWarning, match="above the tolerance"):
        result = solve_by_active_set(dual_operator, OFFSETS["full contact"](dual_operator), 0.0)
    assert not result.converged
    assert 0 < result.bound < 1e-10
    assert result.algorithm == "active_set"
    assert math.isnan(result.iterations)
