"""Uzawa's algorithm: its limits and step counts against theory, its bounds against true errors."""

import math

import numpy as np
import pytest
import sentences
from conftest import condense_structured_mesh
from offsets import OFFSETS, distance, exact, full_contact, middles, operator, partial_contact

from unilateral.errors import InputError
from unilateral.fem.p1 import coupling
from unilateral.fem.spaces import DualOperator, dual_operator
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.uzawa import ContactColumns, energy_bound, predicted_steps, residual_bound, uzawa
from unilateral.solvers.uzawa_steps import STEP_METHODS

SIGMA_1 = math.tanh(1 / (2 * math.sqrt(2))) / math.sqrt(2)
"""First Steklov eigenvalue of -Delta + 1 on the unit square: cosh((x-1/2)/sqrt 2) cosh((y-1/2)/sqrt 2)."""


@pytest.mark.parametrize("method", STEP_METHODS)
@pytest.mark.parametrize("ratio", [2, 3, 4])
@pytest.mark.parametrize("offset", OFFSETS)
def test_every_method_ends_within_its_bound_of_the_active_set_s_multiplier(offset, ratio, method):
    dual_operator = operator(16, ratio)
    offset = OFFSETS[offset](dual_operator)
    expected = solve_by_active_set(dual_operator, offset, 1e-6)
    for tolerance in (1e-2, 1e-6, 1e-12):
        result = uzawa(dual_operator, offset, tolerance, method=method)
        assert result.converged
        assert result.algorithm == method
        assert result.bound <= tolerance
        assert distance(dual_operator, result.lambda_H, expected.lambda_H) <= result.bound + 1e-14


def test_uzawa_ends_within_its_bound_of_the_active_set_s_multiplier_where_beta_is_zero():
    """The energy bound gets to a tenth of a per cent only."""
    dual_operator = operator(8, 1)
    expected = solve_by_active_set(dual_operator, partial_contact(dual_operator), 1e-6)
    result = uzawa(dual_operator, partial_contact(dual_operator), 1e-3)
    assert distance(dual_operator, result.lambda_H, expected.lambda_H) <= expected.bound + result.bound


def test_no_contact_ends_in_zero_from_zero_and_from_above():
    dual_operator = operator(16, 2)
    offset = 0.5 + 0.4 * np.cos(middles(dual_operator))
    for start in (None, np.full(len(offset), 3.0)):
        result = uzawa(dual_operator, offset, 1e-12, start=start)
        assert not result.lambda_H.any()
        assert result.bound == 0


def test_start_at_the_solution_takes_no_step_and_is_left_as_it_was():
    dual_operator = operator(16, 2)
    lambda_H, offset = full_contact(dual_operator)
    result = uzawa(dual_operator, offset, 1e-11, start=lambda_H)
    assert result.iterations == 0
    assert np.allclose(result.lambda_H, lambda_H, rtol=1e-15, atol=0)
    start = np.ones_like(lambda_H)
    assert uzawa(dual_operator, offset, 1e-6, start=start).iterations > 0
    assert (start == 1).all()


def test_iterates_are_those_of_the_paper():
    """Three steps of (5.1)-(5.3) with full solves on all nodes: u^n from lambda^n, clip of the cell mean."""
    spaces = condense_structured_mesh("square", 8)
    partition = partitions.make_uniform_partition(square(), 0.3)
    mesh = spaces.mesh
    B = coupling(spaces.mesh, partition)
    dual = dual_operator(spaces, B, partition.lengths)
    rng = np.random.default_rng(5)
    f = rng.standard_normal(len(mesh.points))
    g = rng.standard_normal(len(dual.H_i))
    rho = 0.4
    offset = B @ spaces.solve(f)[mesh.boundary] / dual.H_i - g
    mu = np.zeros(len(dual.H_i))
    for _ in range(3):
        load = f.copy()
        load[mesh.boundary] += B.T @ mu
        u = spaces.solve(load)
        mu = np.maximum(0, mu - rho * (B @ u[mesh.boundary] / dual.H_i - g))
    with pytest.warns(RuntimeWarning, match="stopped after 3 steps"):
        result = uzawa(dual, offset, 0.0, rho=rho, max_steps=3)
    np.testing.assert_allclose(result.lambda_H, mu, rtol=1e-11, atol=1e-13)
    assert mu.any()


def test_steklov_s_eigenvalue_is_approached_from_above_and_bounds_s():
    """That of V_h, and lambda_max(S) <= 1 / sigma_1: errors of second order are divided by 4 with h."""
    above = [condense_structured_mesh("square", n).sigma_1 - SIGMA_1 for n in (8, 16, 32)]
    below = [1 / SIGMA_1 - operator(n, 2).lambda_max for n in (8, 16, 32)]
    for misses in (above, below):
        assert min(misses) > 0
        np.testing.assert_allclose(np.divide(misses[:-1], misses[1:]), 4, rtol=0.1)
    assert above[-1] < 1e-3 * SIGMA_1
    assert below[-1] < 1e-3


def test_above_the_limit_the_clip_leaves_a_bounded_cycle():
    """Unclipped, the first mode's error would grow by 1.05 a step, to 1.05^2000 = 1e42."""
    dual_operator = operator(16, 2)
    lambda_H, offset = full_contact(dual_operator)
    sizes = []
    for steps in (2000, 2001, 4000, 4001):
        with pytest.warns(RuntimeWarning):
            mu = uzawa(dual_operator, offset, 1e-10, rho=2.05 * SIGMA_1, max_steps=steps).lambda_H
        sizes.append(distance(dual_operator, mu, lambda_H))
    assert (
        0.1 * distance(dual_operator, lambda_H, 0 * lambda_H)
        < max(sizes)
        < 10 * distance(dual_operator, lambda_H, 0 * lambda_H)
    )


@pytest.mark.parametrize(
    ("method", "share"), [("uzawa", 1.9), ("nesterov", 1), ("barzilai_borwein", 1), ("newton", 1)]
)
def test_the_default_step_is_a_share_of_one_over_lambda_max(method, share):
    """1/lambda_max(S) is that of the theory of projected gradients with momentum (Nesterov 1983).

    Plain steps converge below 2/lambda_max(S); a twentieth less leaves half the steps of 1/lambda_max(S).
    """
    dual_operator = operator(8, 2)
    assert uzawa(
        dual_operator, partial_contact(dual_operator), 1e-8, method=method
    ).rho * dual_operator.lambda_max == pytest.approx(share)


@pytest.mark.parametrize("ratio", [2, 4])
def test_steps_stay_below_the_contraction_estimate(ratio):
    """||R_n||_0 <= q^n ||R_0||_0, and the bound is at most 1 + rho (lambda_min lambda_max)^{1/2} times its
    second term: one step more than predicted for a tolerance smaller by that factor."""
    dual_operator = operator(16, ratio)
    for offset in (partial_contact(dual_operator), full_contact(dual_operator)[1]):
        result = uzawa(dual_operator, offset, 1e-9)
        factor = 1 + result.rho * math.sqrt(dual_operator.lambda_min * dual_operator.lambda_max)
        bound0 = residual_bound(dual_operator, offset, np.zeros(len(offset)), result.rho)
        assert result.iterations <= predicted_steps(dual_operator, result.rho, bound0, 1e-9 / factor) + 1


def test_slowest_mode_takes_the_predicted_number_of_steps():
    """In full contact an error along the lowest eigenvector of S shrinks by exactly q a step."""
    dual_operator = operator(16, 2)
    lambda_H, offset = full_contact(dual_operator)
    mode = np.linalg.eigh(dual_operator.S)[1][:, 0] / np.sqrt(dual_operator.H_i)
    start = lambda_H + 1e-2 * mode
    bound0 = residual_bound(dual_operator, offset, start, 1.9 / dual_operator.lambda_max)
    result = uzawa(dual_operator, offset, 1e-6, start=start)
    assert result.iterations == pytest.approx(predicted_steps(dual_operator, result.rho, bound0, 1e-6), abs=2)


@pytest.mark.parametrize(
    ("rho", "bound0", "tolerance", "steps"),
    [
        (1 / 8, 1.0, 1 / 8, 3.0),
        (1 / 4, 1.0, 1 / 8, 1.0),
        (3 / 8, 1.0, 1 / 8, 3.0),
        (1 / 2, 1.0, 1 / 8, math.inf),
        (0.6, 1.0, 1 / 8, math.inf),
        (1 / 8, 1e-9, 1e-8, 0.0),
        (1 / 8, 1.0, 0.0, math.inf),
    ],
)
def test_predicted_steps_are_those_of_a_geometric_sequence(rho, bound0, tolerance, steps):
    """The error shrinks by |1 - 4 rho| a step: three times a half are an eighth; none is left, or all."""
    dual_operator = DualOperator(np.eye(3), np.full(3, 0.25), 1.0)
    assert predicted_steps(dual_operator, rho, bound0, tolerance) == steps
    assert predicted_steps(operator(8, 1), 0.1, 1.0, 1e-8) == math.inf


@pytest.mark.parametrize("ratio", [1, 2, 4])
def test_bounds_are_never_below_the_true_error(ratio):
    """Random multipliers near and far from the solution; 1e-13 for the rounding of the reference."""
    dual_operator = operator(8, ratio)
    rng = np.random.default_rng(6)
    for offset in (
        partial_contact(dual_operator),
        full_contact(dual_operator)[1],
        -1 - rng.uniform(size=len(dual_operator.H_i)),
    ):
        lambda_H = exact(dual_operator, offset)
        for size in 10.0 ** np.arange(1, -9, -1):
            mu = np.maximum(0, lambda_H + size * rng.standard_normal(len(lambda_H)))
            error = distance(dual_operator, mu, lambda_H)
            assert energy_bound(dual_operator, offset, mu) >= error - 1e-13
            for rho in (0.1, 1.0, 1.9):
                assert (
                    residual_bound(dual_operator, offset, mu, rho / dual_operator.lambda_max) >= error - 1e-13
                )


def test_energy_bound_is_an_equality_at_zero_gap():
    """With F(0) = 0: lambda_H = 0, c = 0, and the identity reads bound^2 = 2 ||mu||^2_{-1/2,h}."""
    dual_operator = operator(8, 2)
    mu = np.ones(len(dual_operator.H_i))
    assert dual_operator.gap(mu, 0 * mu).min() > 0
    bound = energy_bound(dual_operator, 0 * mu, mu)
    assert bound == pytest.approx(math.sqrt(2) * distance(dual_operator, mu, 0 * mu), rel=1e-13)


@pytest.mark.parametrize("polygon", ["square", "lshape"])
@pytest.mark.parametrize("a", [1.0, 1e-3])
def test_a_lift_by_a_constant_has_the_norm_of_that(polygon, a):
    """f = 0, g = a and mu = 0: u(mu) = 0, v = a, and the bound is a |Omega|^{1/2}; the true error is not 0.

    That is ||lambda_H||_{-1/2,h}. v = a is feasible, so that it is not larger.
    """
    dual_operator = operator(8, 2, polygon)
    offset = np.full(len(dual_operator.H_i), -a)
    area = {"square": 1.0, "lshape": 3.0}[polygon]
    bound = energy_bound(dual_operator, offset, 0 * offset)
    assert bound == pytest.approx(a * np.sqrt(area), rel=1e-12)
    assert 0.5 * bound < distance(dual_operator, exact(dual_operator, offset), 0 * offset) <= bound


def test_residual_bound_is_sharp_along_uzawas_iterates():
    """Its index on a run in partial contact stays below 5 down to 1e-12."""
    dual_operator = operator(16, 2)
    offset = partial_contact(dual_operator)
    lambda_H = exact(dual_operator, offset)
    for tolerance in 10.0 ** np.arange(-1, -13, -1):
        result = uzawa(dual_operator, offset, tolerance)
        assert 1 <= result.bound / distance(dual_operator, result.lambda_H, lambda_H) < 5


@pytest.mark.parametrize("method", ["uzawa", "nesterov"])
def test_bound_belongs_to_the_returned_multiplier(method):
    dual_operator = operator(16, 2)
    offset = partial_contact(dual_operator)
    for steps in (0, 1, 7, 50):
        with pytest.warns(RuntimeWarning, match=f"stopped after {steps} steps"):
            result = uzawa(dual_operator, offset, 1e-10, max_steps=steps, method=method)
        assert not result.converged
        assert result.iterations == steps
        assert result.bound == pytest.approx(
            residual_bound(dual_operator, offset, result.lambda_H, result.rho), rel=1e-9
        )


def test_singular_operator_falls_back_to_the_energy_bound():
    dual_operator = operator(8, 1)
    offset = partial_contact(dual_operator)
    assert residual_bound(dual_operator, offset, np.zeros(len(offset)), 0.1) == math.inf
    with pytest.warns(RuntimeWarning, match="uzawa stopped after 200 steps"):
        result = uzawa(dual_operator, offset, 1e-6, max_steps=200)
    assert result.bound == pytest.approx(energy_bound(dual_operator, offset, result.lambda_H), rel=1e-9)
    assert uzawa(dual_operator, offset, 2 * result.bound).converged
    assert uzawa(dual_operator, np.abs(offset), 1e-12).bound == 0


def test_operator_applications_count_steps_and_bounds():
    dual_operator = operator(16, 2)
    result = uzawa(dual_operator, partial_contact(dual_operator), 1e-8)
    assert result.iterations + 2 <= result.operator_applications <= 1.3 * result.iterations + 2


def test_a_product_reads_the_columns_in_contact_only():
    """From one set to a part of it, to another one of the same size, to none and to all."""
    S = operator(16, 2).S
    apply = ContactColumns(S)
    out = np.empty(len(S))
    for chosen in (slice(0, 8), slice(2, 6), slice(10, 14), slice(0), slice(None)):
        y = np.zeros(len(S))
        y[chosen] = 1.0
        apply(y, out)
        np.testing.assert_allclose(out, S[:, chosen].sum(axis=1), rtol=1e-14, atol=1e-15)
        np.testing.assert_array_equal(apply.columns, S[chosen])
        apply.columns = selected = 2 * apply.columns
        apply(y, out)
        assert apply.columns is selected
        np.testing.assert_allclose(out, 2 * S[:, chosen].sum(axis=1), rtol=1e-14, atol=1e-15)


def test_tolerance_below_rounding_ends_by_the_step_limit():
    dual_operator = operator(8, 2)
    with pytest.warns(RuntimeWarning, match="stopped after 3000 steps"):
        result = uzawa(dual_operator, partial_contact(dual_operator), 1e-30, max_steps=3000)
    assert not result.converged
    assert result.bound < 1e-13


@pytest.mark.parametrize("rho", [1e3, 1e30, 1e150])
@pytest.mark.parametrize("method", ["uzawa", "nesterov"])
def test_absurd_rho_ends_unconverged_and_finite(rho, method):
    dual_operator = operator(8, 2)
    with pytest.warns(RuntimeWarning, match="above the tolerance"):
        result = uzawa(
            dual_operator, full_contact(dual_operator)[1], 1e-8, rho=rho, max_steps=500, method=method
        )
    assert not result.converged
    assert np.isfinite(result.lambda_H).all()
    assert not math.isnan(result.bound)


@pytest.mark.parametrize("method", ["uzawa", "nesterov"])
def test_a_rho_beyond_the_range_is_refused(method):
    dual_operator = operator(8, 2)
    with sentences.raises(InputError):
        uzawa(dual_operator, full_contact(dual_operator)[1], 1e-8, rho=1e300, method=method)


@pytest.mark.parametrize("rho", [1e-150, 1e-200, 1e-300])
def test_a_tiny_rho_gives_no_false_guarantee(rho):
    """The residual is proportional to rho; its square would underflow to 0 and the bound with it."""
    dual_operator = operator(8, 2)
    offset = full_contact(dual_operator)[1]
    with pytest.warns(RuntimeWarning, match="above the tolerance"):
        result = uzawa(dual_operator, offset, 1e-8, rho=rho, max_steps=5)
    assert (
        result.bound
        >= distance(dual_operator, result.lambda_H, uzawa(dual_operator, offset, 1e-10).lambda_H) - 1e-10
    )


@pytest.mark.parametrize(
    "arguments",
    [
        {"rho": 0.0},
        {"rho": -1.0},
        {"rho": math.inf},
        {"rho": math.nan},
        {"offset": np.full(16, math.inf)},
        {"offset": np.full(16, math.nan)},
        {"tolerance": -1.0},
        {"tolerance": math.nan},
    ],
)
def test_bad_input_is_refused(arguments):
    """What has to do with the method alone, only by that."""
    dual_operator = operator(8, 2)
    all_arguments = {"offset": np.ones(16), "tolerance": 1e-8, **arguments}
    with sentences.raises(InputError):
        uzawa(dual_operator, **all_arguments)
    if "rho" not in all_arguments:
        with sentences.raises(InputError):
            solve_by_active_set(dual_operator, **all_arguments)
