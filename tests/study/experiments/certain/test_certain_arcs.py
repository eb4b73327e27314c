"""What is certain of contact on tiny meshes, and by hand on arcs that are made up."""

import numpy as np
import pytest
from conftest import load

from study.experiments.certain import measure as certain
from study.experiments.certain.measure import ExactContact
from unilateral.bounds.certain_contact import CertainArc, Verdict

TOUCHES, FREE, UNDECIDED = Verdict
CONTACT = [ExactContact(0, 0.5, 0.75)]
ARCS = [
    CertainArc(0, 0.0, 0.375, FREE),
    CertainArc(0, 0.375, 0.5625, UNDECIDED),
    CertainArc(0, 0.5625, 0.625, TOUCHES),
    CertainArc(0, 0.625, 0.875, UNDECIDED),
    CertainArc(0, 0.875, 1.0, FREE),
    CertainArc(1, 0.0, 1.0, FREE),
]


def change_arc(number, **fields):
    return [arc._replace(**fields) if i == number else arc for i, arc in enumerate(ARCS)]


@pytest.mark.parametrize(
    ("arcs", "number"),
    [
        (ARCS, 0),
        # an end of contact belongs to the contact set
        (change_arc(0, end=0.5), 1),
        (change_arc(0, end=0.4999), 0),
        (change_arc(5, verdict=TOUCHES), 1),
        (change_arc(4, verdict=TOUCHES), 1),
        (change_arc(3, verdict=TOUCHES), 0),
        (change_arc(2, verdict=FREE), 1),
    ],
)
def test_arcs_contradict_where_free_ones_meet_contact_and_others_do_not(arcs, number):
    assert certain.count_contradictions(arcs, CONTACT) == number


def find_distances(arcs):
    case = load("thirds")  # the square's sides are 1 long
    return [certain.find_proved_distance(arcs, place) for place in certain.list_beside_ends(case, CONTACT)]


def test_distances_are_those_to_the_nearest_arcs_that_are_proved():
    """Beside 0.5 and 0.75, to free arcs and to the far ends of touching ones; else to the next end."""
    assert find_distances(ARCS) == [0.125, 0.125, 0.125, 0.1875]
    assert find_distances([]) == [0.5, 0.25, 0.25, 0.25]


@pytest.mark.parametrize(
    ("name", "orders"),
    [("natural", [0.67, 0.67]), ("thirds", [0.67, 0.67, 0.67, 0.2]), ("clamped", [0.33, 0.25] * 2)],
)
def test_orders_follow_from_the_exponents_that_a_case_declares(name, orders):
    """Gaps (1/2 - t)^(3/2) and (1/3 - t)^3, lambda like r^(1/2) and r^3, and at the cutoff's end like r^4."""
    case = load(name)
    beside = certain.list_beside_ends(case, certain.find_contact(case))
    assert [certain.expect_order(case, place) for place in beside] == orders


def test_a_level_has_what_users_get(tmp_path):
    """On a coarse mesh; its control, a u_h that is too high, contradicts."""
    level = certain.measure(load("thirds"), 1 / 32)
    assert float(level["undecided_share"]) == pytest.approx(float(level["undecided_length"]) / 4)
    assert float(level["contradictions"]) == 0 < float(level["contradictions_of_raised"])
    assert np.all(level["proved_distance"] < 0.5)
