"""The consistency term of (4.16): off the transitions' cells, as predicted at one, and its table."""

import numpy as np
import pytest
import sentences
from conftest import CANTOR, config, home, load, load_certificate

from study.experiments.estimates.consistency_figure import Transition, first_transition, leading_term
from unilateral.errors import InputError
from unilateral.geometry.partition import from_points, make_shifted_partition, make_uniform_partition
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.exact_errors import cell_means
from unilateral.problems import case as cases

SQUARE = find_polygon("square")
LSHAPE = find_polygon("lshape")
REGULAR = ("smooth", "natural", "thirds", "vertex", "borderline_0.1", "violates_jj", "singular", "rough")
DRAWN = config("figures")["figures"]["consistency"]["cases"]
ZERO = 1e-15


@pytest.mark.parametrize("polygon", ["square", "lshape"])
@pytest.mark.parametrize("name", sorted(set(cases.case_names()) - set(CANTOR)))
def test_transitions_as_declared_are_the_ends_of_contact_as_it_is_found(name, polygon):
    """The certificate looks at the gap's values between singular points."""
    if (
        polygon not in cases.read_case_declaration(name)[0]["polygons"]
        and cases.read_case_declaration(name)[0]["polygons"] != "any"
    ):
        polygon = home(name).name
    case = load(name, polygon)
    starts = case.polygon.starts
    lengths = case.polygon.lengths
    ends = [
        starts[i] + t * lengths[i]
        for i, *pair in load_certificate(name, polygon).contact
        for t in pair
        if 0 < t < 1
    ]
    np.testing.assert_allclose(np.sort(case.transitions()), np.unique(ends), rtol=1e-14)


PARTITIONS = {
    "uniform": make_uniform_partition(SQUARE, 1 / 16),
    "shifted": make_shifted_partition(SQUARE, 1 / 16, 0.3),
    "random": from_points(
        SQUARE, np.unique(np.concatenate([range(5), 4 * np.random.default_rng(5).random(60)]))
    ),
}


@pytest.mark.parametrize("name", REGULAR)
@pytest.mark.parametrize("cells", PARTITIONS)
def test_off_the_transitions_cells_the_term_is_0(name, cells):
    """And on them it is not: 1e-13 lies below the smallest, that of smooth and vertex, like H^7."""
    means = cell_means(load(name), PARTITIONS[cells])
    assert abs(means.consistency_elsewhere) <= ZERO
    assert np.all(np.abs(means.consistency_terms[~means.has_transition]) <= ZERO)
    inside = means.has_transition.any()
    assert (means.consistency > 1e-13) == inside, (means.consistency, inside)


def test_a_term_off_the_declared_transitions_is_seen(case_like):
    """Control: thirds, with a gap that closes at 5/12 only, where lambda is positive already.

    The first cell of (1/3, 5/12) holds no kink of the gap.
    """
    gap = cases.read_case_declaration("thirds")[0]["gap"]
    gap["sides"][0]["formula"] = "pos(5/12 - t, 3/2) + pos(4/5*(t - 7/12), 3/2)"
    means = cell_means(case_like("thirds", gap=gap), make_uniform_partition(SQUARE, 1 / 16))
    assert np.flatnonzero(means.has_transition).tolist() == [6, 9]
    assert means.consistency_terms[5] > 1e-5
    assert means.consistency_elsewhere == pytest.approx(means.consistency_terms[5], rel=1e-9)


def test_cells_with_a_point_inside_are_found_and_not_those_with_one_at_an_end():
    """By hand: 0.1 and 0.2 are in cell 0, 2.9 in cell 11, 3.99 in cell 15; the others are ends."""
    cells = make_uniform_partition(SQUARE, 1 / 4)
    inside = cells.has_inside(np.array([0.1, 0.2, 0.5, 1.0, 2.9, 3.99, 4.0, 0.0]))
    assert np.flatnonzero(inside).tolist() == [0, 11, 15]
    assert not cells.has_inside(np.array([])).any()


@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize("m", [64, 128, 256])
def test_totals_are_those_predicted_at_the_first_transition(name, m):
    """lambda is s^alpha (1 - (s/R)^2)^4, R = 1/4, s <= H: relative 4 (H/R)^2. The other one adds less.

    At its end 1 - (s/R)^2 <= 2 H/R, to the fourth power, beside a gap with the same gamma and a factor
    below 1; s^alpha is about R^alpha there, against H^alpha: relative 16 (H/R)^(4 - alpha), for alpha <= 1/2.
    """
    case = load(name)
    cells = make_uniform_partition(SQUARE, 1 / m)
    transition = first_transition(case)
    predicted, _ = leading_term(transition, cells)
    size = 4 / m
    room = 4 * size**2 + 16 * size ** (4 - transition.alpha)
    assert cell_means(case, cells).consistency == pytest.approx(predicted, rel=room)


def test_other_exponents_would_be_seen():
    """Control."""
    cells = make_uniform_partition(SQUARE, 1 / 256)
    consistency = cell_means(load("thirds"), make_uniform_partition(SQUARE, 1 / 256)).consistency
    for alpha, gamma in ((1.5, 0.5), (0.45, 1.5), (0.5, 1.45)):
        assert leading_term(Transition(0, 1 / 3, alpha, gamma), cells)[0] != pytest.approx(
            consistency, rel=0.05
        )


def test_the_prediction_grows_with_the_side():
    """lambda and u - g are functions of s in side lengths: twice the side, twice the term at the same H/L."""
    transition = Transition(4, 1 / 3, 0.5, 1.5)  # a side of length 2
    large, theta = leading_term(transition, make_uniform_partition(LSHAPE, 1 / 8))
    small, same = leading_term(transition._replace(side=0), make_uniform_partition(SQUARE, 1 / 16))
    assert theta == pytest.approx(same, rel=1e-12)
    assert large == pytest.approx(2 * small, rel=1e-12)


@pytest.mark.parametrize(("name", "alpha", "gamma"), [("thirds", 0.5, 1.5), ("singular", -0.25, 1.0)])
def test_the_first_transition_is_the_declared_one(name, alpha, gamma):
    transition = first_transition(load(name))
    assert transition == pytest.approx(Transition(0, 1 / 3, alpha, gamma), rel=1e-12)
    assert transition.term_order == pytest.approx(alpha + gamma + 1)


def test_a_case_without_a_harmonic_atom_has_no_prediction():
    with sentences.raises(InputError):
        first_transition(load("smooth"))
