"""The family of the sharpness study: its places, its certificates, one member solved by itself."""

import math
from dataclasses import replace
from fractions import Fraction as R
from functools import cache
from itertools import product

import numpy as np
import pytest
import sentences
import xarray as xr
from conftest import condense_structured_mesh, couple_structured_mesh, exact_errors

from study.experiments.sharpness import surfaces
from study.experiments.sharpness.measure import (
    CONTACT_LENGTH,
    TRANSITION_CELL_START,
    T,
    family_cases,
    family_on_partition,
    measure,
    transition_positions,
)
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.formulas.exact_numbers import pos
from unilateral.formulas.expression import ZERO
from unilateral.formulas.formula import substitute
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means, project_case
from unilateral.problems.case import ExactSolution
from unilateral.problems.case_certificate import certify_case
from unilateral.problems.polar_atoms import make_harmonic_atom
from unilateral.solvers.stop import Stop

SQUARE = find_polygon("square")
LEVELS = [R(1, 2**k) for k in range(3, 8)]


def thetas(points, H):
    """Positions inside their cells of size H, from 0 to 1, exactly."""
    return [x / H % 1 for x in points]


@pytest.mark.parametrize("H", LEVELS)
def test_transitions_are_at_the_same_theta_on_every_level(H):
    """In the cell that begins at START; and so are those where the cutoff ends."""
    expected = [R(2 * k + 1, 16) for k in range(8)]
    computed = transition_positions(H, 8)
    assert thetas(computed, H) == expected
    assert thetas([x + CONTACT_LENGTH for x in computed], H) == expected
    assert all(TRANSITION_CELL_START < x < TRANSITION_CELL_START + H for x in computed)
    assert thetas([R(1, 3)], H) != thetas([R(1, 3)], H / 2)


def test_a_size_without_a_cell_at_the_start_is_refused():
    with sentences.raises(InputError):
        transition_positions(R(1, 6), 8)


def make_family_member(alpha, gamma, position, j, jj):
    declared = {"hypotheses": {"j": j, "jj": jj, "jjj": True}}
    return replace(family_cases(SQUARE, position, alpha, [gamma])[0], declaration=declared)


FAMILY = list(product([R(-1, 4), R(1, 20), R(7, 4)], [R(1, 10), R(1, 2), R(1), R(5, 2)]))


@pytest.mark.parametrize(
    "position",
    [
        transition_positions(LEVELS[0], 8)[0],
        transition_positions(LEVELS[0], 8)[-1],
        transition_positions(LEVELS[-1], 8)[2],
    ],
)
@pytest.mark.parametrize(("alpha", "gamma"), FAMILY)
def test_members_have_a_certificate(alpha, gamma, position):
    """(j) fails for alpha < 0; (jj) there, by the trace r^(1 + alpha), and for gamma < 1."""
    case = make_family_member(alpha, gamma, position, alpha > 0, alpha > 0 and gamma >= 1)
    known_case = certify_case(case)
    np.testing.assert_allclose(
        known_case.contact, [(0, float(position), float(position + CONTACT_LENGTH))], rtol=0, atol=1e-14
    )
    assert known_case.max_multiplier > 0
    table = surfaces.tabulate_surfaces(made_up([float(alpha)], [float(gamma)]))
    assert [bool(table[name].item()) for name in ("j", "jj")] == [
        known_case.hypotheses[name] for name in ("j", "jj")
    ]


def test_a_wrong_claim_of_a_hypothesis_is_noticed():
    """Control."""
    with sentences.raises(InputError):
        certify_case(make_family_member(R(1, 2), R(1, 2), R(2, 5), True, True))


def test_a_member_with_contact_in_its_gap_is_refused():
    """Control: lambda begins an eighth before the gap ends."""
    case = make_family_member(R(1, 2), R(1), R(2, 5), True, True)
    shifted_case = replace(case, gaps=(substitute(case.gaps[0], {"t": T - R(1, 8)}, "gap"), *case.gaps[1:]))
    with sentences.raises(InputError):
        certify_case(shifted_case)


EXPONENTS = [(-1 / 4, 1 / 2), (1 / 20, 5 / 2), (1 / 2, 1.0), (9 / 10, 1 / 10), (5 / 4, 3 / 2), (7 / 4, 1 / 2)]


def consistency_of_power(a, c, theta):
    """The consistency term of one transition, at theta of a cell with H = 1/16, the gap before it."""
    alpha = R(a).limit_denominator(20)
    gamma = R(c).limit_denominator(20)
    place = R(theta).limit_denominator(20)
    position = R(3, 8) + place / 16
    gaps = (pos(position - T, gamma), *[ZERO] * 3)
    case = ExactSolution(
        "no cutoff", {}, SQUARE, (make_harmonic_atom(SQUARE, 0, float(position), alpha),), gaps
    )
    return cell_means(case, partitions.make_uniform_partition(SQUARE, 1 / 16)).consistency


def formula(a, c, theta):
    """H times the means over the cell of s_+^a and s_-^c, H = 1/16."""
    return (1 / 16) ** (a + c + 1) * theta ** (c + 1) * (1 - theta) ** (a + 1) / ((a + 1) * (c + 1))


@pytest.mark.parametrize("theta", [0.1, 1 / 3, 0.5, 0.9])
@pytest.mark.parametrize(("a", "c"), EXPONENTS)
def test_the_consistency_term_of_one_transition_is_its_closed_form(a, c, theta):
    """1e-10: the transition is known to 1e-16, of a cell of size H to 1e-15, powers to a few times that."""
    assert consistency_of_power(a, c, theta) == pytest.approx(formula(a, c, theta), rel=1e-10)


def test_the_consistency_term_knows_from_which_end_theta_is_measured():
    """Control: and which exponent belongs to which side."""
    term = consistency_of_power(0.5, 1.5, 0.1)
    assert term != pytest.approx(formula(0.5, 1.5, 0.9), rel=0.1)
    assert term != pytest.approx(formula(1.5, 0.5, 0.1), rel=0.1)


AT = transition_positions(R(1, 4), 2)
ALPHAS = [R(1, 20), R(1, 2)]
GAMMAS = [R(1), R(5, 2)]


@cache
def measure_family():
    spaces = condense_structured_mesh("square", 8)
    cells = partitions.make_uniform_partition(SQUARE, 1 / 4)
    return measure(spaces, family_on_partition(cells, AT, (ALPHAS, GAMMAS)), Stop())


@pytest.mark.parametrize(("a", "c", "k"), [(0, 0, 1), (1, 0, 0), (1, 1, 1)])
def test_a_measurement_is_the_solve_of_its_member(a, c, k):
    """By the same arithmetic, so rtol leaves room for the order of sums; the dual norm without its forms."""
    spaces = couple_structured_mesh("square", 8, 4)
    case = family_cases(SQUARE, AT[k], ALPHAS[a], GAMMAS)[c]
    discrete = discretise_case(spaces, project_case(case, spaces))
    row = measure_family().isel(alpha=a, gamma=c, position=k)
    solution = solve_condensed_problem(discrete, beta=float(row["beta_lower"]))
    errors = exact_errors(discrete, solution)
    expected = {
        "h1_error": errors.h1,
        "l2_error": errors.l2,
        "discrete_error": errors.hm12_discrete,
        "ritz_means": discrete.exact.ritz_means_norm(spaces),
        "held": float(solution.lambda_H[math.floor(4 * AT[k])] > 0),
        "consistency": discrete.exact.cell_means.consistency,
        "algebraic_bound": solution.result.bound,
        "converged": 1.0,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(row[name], value, rtol=1e-9, err_msg=name)
    family = [family_cases(SQUARE, x, alpha, GAMMAS)[0] for alpha in ALPHAS for x in AT]
    lower, upper = build_dual_norm(spaces.partition, family).bound_error(case, solution.lambda_H[None])
    np.testing.assert_allclose(row["hm12_error_lower"], max(lower[0], errors.hm12_discrete), rtol=1e-8)
    np.testing.assert_allclose(row["hm12_error_upper"], upper[0], rtol=1e-8)
    other_row = measure_family().isel(alpha=a, gamma=c, position=1 - k)
    assert abs(float(other_row["h1_error"]) / errors.h1 - 1) > 1e-4


def test_what_depends_on_u_is_found_once_for_all_gaps(monkeypatch):
    """Of 4 u with 2 gaps each: their flux is for the means, the load, and two parts of the dual norm."""
    names = []
    trace_flux_and_gap = ExactSolution.trace_flux_and_gap
    monkeypatch.setattr(
        ExactSolution,
        "trace_flux_and_gap",
        lambda *arguments: names.append(arguments[0].name) or trace_flux_and_gap(*arguments),
    )
    measure_family.__wrapped__()
    assert len(names) == 4 * len(ALPHAS) * len(AT)


def made_up(alphas, gammas):
    """Errors H^alpha in H1 and H^gamma in L2, those in H^{-1/2} between bounds, D like H^(alpha + gamma).

    ||Pi_H(u - z_h)||_0 is like H^(1/2 + alpha). 2 positions, 4 levels.
    """
    H = np.array([1 / 4, 1 / 8, 1 / 16, 1 / 32])
    position = np.array([0.6, 0.8])
    dims = ("level", "alpha", "gamma", "position")
    h, a, c, p = np.ix_(H, alphas, gammas, position)
    zero = 0 * (h + a + c + p)
    values = {
        "h1_error": p * h**a + zero,
        "l2_error": p * h**c + zero,
        "hm12_error_lower": 0.6 * p * h + zero,
        "hm12_error_upper": 0.8 * p * h + zero,
        "discrete_error": p * h ** (a + c) + zero,
        "ritz_means": p * h ** (a + 0.5) + zero,
        "held": (p > 0.7) + zero,
        "consistency": p**2 * h ** (a + c + 1) + zero,
        "algebraic_bound": 1e-3 * h**2 * p + zero,
        "converged": 1 + zero,
    }
    table = {name: (dims, value) for name, value in values.items()}
    per_level = {"beta_lower": ("level", np.full(4, 0.5)), "lambda_min": ("level", np.full(4, 0.25))}
    sizes = {"h": ("level", H / 2), "H": ("level", H)}
    return xr.Dataset(table | per_level, coords={"alpha": alphas, "gamma": gammas} | sizes)


def test_rates_are_those_of_errors_that_follow_a_law():
    """Positions have the errors 0.6 and 0.8 of one law: their r.m.s. mean is 0.5^(1/2) of it."""
    alphas = [0.25, 0.75]
    gammas = [0.5, 1.5, 2.5]
    errors = made_up(alphas, gammas)
    computed = surfaces.tabulate_surfaces(errors)
    pair = computed["alpha"] + computed["gamma"]
    for norm, expected in (
        ("h1", computed["alpha"]),
        ("hm12", 1.0),
        ("l2", computed["gamma"]),
        ("discrete", pair),
    ):
        rate = computed["rate"].sel(norm=norm)
        np.testing.assert_allclose(rate, (xr.zeros_like(rate) + expected).transpose(*rate.dims), rtol=1e-12)
    np.testing.assert_allclose(computed["error"].sel(norm="h1", level=3, alpha=0.25), 0.5**0.5 / 32**0.25)
    np.testing.assert_allclose(computed["error"].sel(norm="hm12", level=3), 0.5 / 32)
    over_all = surfaces.overall_rate(computed, "discrete").transpose("alpha", "gamma")
    np.testing.assert_allclose(over_all, np.add.outer(alphas, gammas), rtol=1e-12)
    np.testing.assert_allclose(computed["t"].sel(level=3), 0.5**0.5 / 32 ** np.array(alphas), rtol=1e-12)
    np.testing.assert_allclose(computed["t_rate"].isel(pair=1), alphas, rtol=1e-12)
    assert np.all(computed["held"] == 0.5)
    np.testing.assert_allclose(computed["uncertainty"], 0, rtol=0, atol=1e-12)
    predicted = computed["consistency_predicted"]
    np.testing.assert_allclose(computed["consistency_rate"].isel(pair=1), predicted, rtol=1e-12)
    np.testing.assert_allclose(predicted, np.add.outer(alphas, gammas) + 1, rtol=1e-14)
    spoilt = errors.assign(h1_error=errors["h1_error"].where(errors["H"] > 0.04, 1.5 * errors["h1_error"]))
    again = surfaces.tabulate_surfaces(spoilt).sel(norm="h1")
    np.testing.assert_allclose(again["uncertainty"], np.log2(1.5), rtol=1e-12)


def test_shares_are_the_bound_in_the_norm_over_the_error_s_lower_bound():
    """H = 1/4: 1e-3/16 of p, over p H^alpha; over beta = 1/2 and 0.6 p H; over 0.5 and p H^gamma.

    Of D it is the bound itself, over p H^(3/2).
    """
    row = surfaces.tabulate_surfaces(made_up([0.5], [1.0]))["share"].isel(level=0)
    expected = [1e-3 / 16 / 0.5, 1e-3 / 16 / 0.5 / (0.6 / 4), 1e-3 / 16 / 0.5 / 0.25, 1e-3 / 16 / 0.125]
    np.testing.assert_allclose(row.values.ravel(), expected, rtol=1e-12)


def test_one_position_without_convergence_counts():
    errors = made_up([0.5], [1.0, 2.0])
    errors["converged"][{"level": 2, "gamma": 1, "position": 0}] = 0.0
    converged = surfaces.tabulate_surfaces(errors)["converged"].values
    assert np.argwhere(converged == 0).tolist() == [[2, 0, 1]]


@pytest.mark.parametrize(
    ("norm", "alpha", "gamma", "best", "remaining"),
    [
        ("h1", 0.5, 0.5, 1.0, 1.0),
        ("h1", -0.25, 0.5, 0.75, 0.625),
        ("h1", 0.1, 0.5, 1.0, 0.8),
        ("hm12", 0.5, 1.0, 1.5, 1.25),
        ("hm12", 1.25, 2.5, 1.5, 1.5),
        ("l2", 0.25, 2.5, 0.75, 0.75),
        ("l2", 0.25, 0.5, 0.75, 0.375),
        ("l2", 1.75, 0.5, 1.0, 1.0),
        ("discrete", 0.25, 0.1, 1.25, 0.675),
        ("discrete", 0.9, 2.5, 1.5, 1.5),
    ],
)
def test_predicted_rates_are_those_of_best_approximation_and_of_the_proof(
    norm, alpha, gamma, best, remaining
):
    """By hand: P1 and P0 on s_+^alpha; half of alpha + gamma + 1, and 1/2 less in L2."""
    assert float(surfaces.predicted_rate(norm, alpha)) == pytest.approx(best, rel=1e-14)
    assert float(surfaces.proof_rate(norm, alpha, gamma)) == pytest.approx(remaining, rel=1e-14)


def judge_rates(table):
    """Whether all rates of lambda in L2 reach min(1, alpha + 1/2) less the study's tolerance."""
    return bool((table["rate"].sel(norm="l2") >= 1 - 0.1).all())


def test_a_fixed_transition_fakes_rates_and_the_average_does_not():
    """alpha = 1/2, gamma = 1 on three levels, with the transition at 1/3 and at 8 places of its cell.

    At 1/3 theta is 1/3 and 2/3 in turn: the consistency term jumps by 2^(gamma - alpha), either way.
    0.15 is room for the cutoff: at H = 1/16 it takes up to 4 (H/R)^2 = 25 % of lambda in the cell.
    Two pairs of levels need a mesh with h = 1/128, which takes seconds.
    """
    levels = []
    for H in LEVELS[1:4]:
        cells = partitions.make_uniform_partition(SQUARE, float(H))
        family = family_on_partition(cells, [R(1, 3), *transition_positions(H, 8)], ([R(1, 2)], [R(1)]))
        levels.append(measure(condense_structured_mesh("square", int(2 / H)), family, Stop()))
    errors = surfaces.join_sharpness_levels(levels)
    third = surfaces.tabulate_surfaces(errors.isel(position=[0]))
    average = surfaces.tabulate_surfaces(errors.isel(position=slice(1, None)))
    jump = third["consistency_rate"].values.ravel() - 2.5
    np.testing.assert_allclose(np.abs(jump), 0.5, rtol=0, atol=0.15)
    assert jump[0] * jump[1] < 0
    np.testing.assert_allclose(average["consistency_rate"].values.ravel(), 2.5, rtol=0, atol=0.15)
    assert judge_rates(average)
    assert not judge_rates(third)
