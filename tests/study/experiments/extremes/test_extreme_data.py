"""Data that are very large or small, and what broke at them in the library, and was mended."""

from contextlib import nullcontext

import numpy as np
import pytest
import sentences
from conftest import exact_errors, load, load_certificate

from study.experiments.extremes import data_axes
from study.experiments.extremes.problem import pose_on_square, wave_contact
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon, square
from unilateral.norms.exact_errors import cell_means, project_case
from unilateral.norms.ritz import ritz_projection
from unilateral.problems import case as cases
from unilateral.problems.case_certificate import certify_case
from unilateral.solvers import uzawa
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.dispatch import run_algorithm
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa_steps import STEP_METHODS


def problem(h=1 / 8, H=1 / 4):
    return pose_on_square(h, H, wave_contact, 1.0)


@pytest.mark.parametrize("size", [1e-290, 1e-165, 1e-155, 1e152, 1e290])
@pytest.mark.parametrize(
    ("method", "H"),
    [("active_set", 1 / 4), ("active_set", 1 / 8), *((step_method, 1 / 4) for step_method in STEP_METHODS)],
)
def test_every_method_scales_with_the_data(method, H, size):
    """H = 1/8 is h, where S is singular: below 1e-160 bound and lambda_H were 0, as the square of g was.

    Squares of 1e200 overflowed in the steps of Barzilai and Borwein, which left NaN; at 1e152 plain steps,
    whose number does not depend on the size, were said to have diverged.
    """
    discrete = problem(H=H)
    operator = discrete.spaces.operator
    offset = discrete.discrete.offset

    def solve_for_size(factor):
        if method == "active_set":
            return solve_by_active_set(operator, factor * offset, factor * 1e-5)
        return uzawa.uzawa(operator, factor * offset, factor * 1e-6, method=method)

    ours = solve_for_size(1.0)
    scaled = solve_for_size(size)
    assert scaled.converged
    difference = np.linalg.norm(operator.D_factor @ (scaled.lambda_H / size - ours.lambda_H))
    assert difference <= ours.bound + scaled.bound / size
    assert uzawa.energy_bound(operator, size * offset, 0 * ours.lambda_H) >= size * discrete.size
    if method == "uzawa":
        assert abs(scaled.iterations - ours.iterations) <= 1
        assert scaled.bound == pytest.approx(size * ours.bound, rel=0.1)
        residual = uzawa.residual_bound(operator, size * offset, scaled.lambda_H, scaled.rho)
        assert residual == pytest.approx(scaled.bound, rel=1e-6)


@pytest.mark.parametrize("method", STEP_METHODS)
@pytest.mark.parametrize("start", [5.1e299, 1e301, 1e308])
def test_a_start_beyond_the_range_is_refused(method, start):
    """They ended after 0 steps with an infinite bound, and at 1e308 nothing was told at all."""
    discrete = problem()
    with pytest.raises(InputError, match=r"is not below 1e\+300; scale the data to about 1, start from"):
        uzawa.uzawa(
            discrete.spaces.operator, discrete.discrete.offset, 1e-6, start=np.full(16, start), method=method
        )
    with pytest.raises(InputError, match="the first residual"):
        run_algorithm(discrete.spaces.operator, discrete.discrete.offset, 1e-6, Stop(), np.full(16, start))
    assert uzawa.uzawa(
        discrete.spaces.operator, discrete.discrete.offset, 1e-6, start=np.full(16, 4.9e299)
    ).converged


@pytest.mark.parametrize(("size", "refused"), [(4.3e300, False), (4.5e300, True), (5e307, True)])
def test_data_beyond_the_range_are_refused(size, refused):
    """From 1e301 on runs ended with an infinite bound; the limit is that of the first residual."""
    discrete = problem()
    assert data_axes.first_residual(discrete) == pytest.approx(1e300 / 4.3748e300, rel=1e-4)
    with pytest.raises(InputError, match="scale the data") if refused else nullcontext():
        assert uzawa.uzawa(discrete.spaces.operator, size * discrete.discrete.offset, 1e-6 * size).converged
    assert solve_by_active_set(
        discrete.spaces.operator, size * discrete.discrete.offset, 1e-6 * size
    ).converged


@pytest.mark.parametrize("size", [1e-310, 1e-320])
def test_data_that_have_lost_digits_are_refused(size):
    """At 1e-315 a multiplier 1e-6 off was told of as exact; data that are 0 are another matter."""
    discrete = problem()
    for solver in (uzawa.uzawa, solve_by_active_set):
        with pytest.raises(InputError, match="has lost digits of double precision; scale the data"):
            solver(discrete.spaces.operator, size * discrete.discrete.offset, 1e-6 * size)
        assert solver(discrete.spaces.operator, 1e-307 * discrete.discrete.offset, 1e-312).converged
        assert solver(discrete.spaces.operator, 0 * discrete.discrete.offset, 0.0).converged


@pytest.fixture
def scaled_case(case_like):
    """The catalogue's case with u and g multiplied by a factor."""

    def scale_case(name, factor):
        declaration = cases.read_case_declaration(name)[0]
        gap = declaration["gap"]
        keys = [(atom, "formula" if atom["atom"] == "smooth" else "times") for atom in declaration["u"]]
        for fields, key in [*keys, (gap, "elsewhere"), *((side, "formula") for side in gap.get("sides", []))]:
            fields[key] = f"({factor})*({fields.get(key, 1)})"
        return case_like(name, u=declaration["u"], gap=gap)

    return scale_case


@pytest.mark.parametrize("factor", ["1e-150", "1e-13", "1e13", "1e150"])
@pytest.mark.parametrize("name", ["thirds", "full_contact", "no_contact"])
def test_cases_of_any_size_are_certified_and_solved_alike(name, factor, scaled_case):
    """At 1e-13 lambda counted as 0, at 1e13 round-off of a flux as negative; contact was said to vanish."""
    case = scaled_case(name, factor)
    spaces = problem(h=1 / 16, H=1 / 8).spaces
    assert certify_case(case).contact == load_certificate(name).contact
    steps = []
    errors = []
    for item in (case, load(name)):
        discrete = discretise_case(spaces, project_case(item, spaces))
        solution = solve_condensed_problem(discrete, beta=0.5)
        steps.append(solution.result.iterations)
        errors.append(exact_errors(discrete, solution).h1)
        assert cell_means(item, spaces.partition).lambda_is_zero == (name == "no_contact")
    assert steps[0] == steps[1]
    assert errors[0] == pytest.approx(float(factor) * errors[1], rel=1e-9)


def test_a_small_negative_multiplier_is_noticed(case_like):
    """u = -1e-13 (x^2 + y^2)/2 has lambda = -1e-13 on two sides, which passed as round-off."""
    u = [{"atom": "smooth", "formula": "-1e-13*(x**2 + y**2)/2"}]
    with pytest.raises(InputError, match="lambda = du/dn < 0"):
        certify_case(case_like("no_contact", u=u, gap={"elsewhere": "1e-13"}))


@pytest.mark.parametrize("factor", ["1e-170", "1e160"])
def test_cases_whose_errors_have_no_square_are_refused(factor, scaled_case):
    """Their errors were printed as 0, or the tolerance was infinite."""
    case = scaled_case("full_contact", factor)
    with sentences.raises(InputError, case.name):
        ritz_projection(case, problem().spaces.condensed)


def test_a_polygon_far_away_is_refused_before_its_nodes_move():
    """At 1e14 a third of a per cent of an edge was lost, and nothing said."""
    far = Polygon(square().vertices + 1e8, "square")
    assert meshes.make_unstructured_mesh(far, 1 / 8).h == pytest.approx(1 / 8, rel=1e-7)
    for distance in (1e10, 1e14):
        with pytest.raises(InputError, match=r"coordinates as large as .* are rounded by .* to the origin"):
            meshes.make_unstructured_mesh(Polygon(square().vertices + distance, "square"), 1 / 8)
