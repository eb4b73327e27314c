"""An accuracy of a force: the interval about it is narrow enough, and the search is judged by it."""

from dataclasses import replace

import pytest
import sentences
from hand_made import exact_forces

import unilateral as ul
from unilateral.adaptive.goal import Goal
from unilateral.adaptive.level import contradict, is_limited_by_data, judge_for_goal
from unilateral.adaptive.loop import search

SEAL = {
    "polygon": [(0, 0), (2, 0), (2, 1), (0, 1)],
    "f": -6,
    "g": ["-0.1 - x/4", None, None, None],
    "free_sides": [1, 2],
    "u": {3: 0},
    "c": 0,
}
"""- int f = 12 is the sum of the force on side 0 and of the reaction on side 3."""


def half_width(force):
    return (force.upper - force.lower) / 2


@pytest.mark.parametrize("sides", [None, [0]])
def test_a_known_force_lies_in_an_interval_that_is_as_narrow_as_asked(sides):
    """The integral of the exact lambda over all sides, or over side 0, which is a quarter of the boundary."""
    s = ul.solve("natural", accuracy=0.03, norm="force", sides=sides)
    exact = exact_forces(s.problem.exact, s.partition)
    force = s.force(sides=sides)
    assert s.certified
    assert force.lower <= exact[0 if sides is None else 1] <= force.upper
    assert 0 < half_width(force) <= 0.03 * force.lower
    assert s.search.best.total == half_width(force)


def test_a_reaction_has_an_accuracy_too():
    """Of the other one the sum of both is known."""
    problem = ul.Problem(**SEAL)
    reaction = ul.solve(problem, accuracy=0.01, norm="force", sides=[3]).force(sides=[3])
    force = ul.solve(problem, accuracy=0.01, norm="force").force()
    assert reaction.lower + force.lower <= 12 <= reaction.upper + force.upper
    assert half_width(reaction) <= 0.01 * reaction.lower
    assert half_width(force) <= 0.01 * force.lower


def test_an_accuracy_may_be_that_of_the_force_itself():
    problem = ul.Problem(**SEAL)
    s = ul.solve(problem, accuracy=0.5, norm="force", sides=[0], absolute=True)
    assert s.certified
    assert half_width(s.force(sides=[0])) <= 0.5
    # 0.5 is no more than a tenth of the force
    assert s.mesh.n_nodes >= ul.solve(problem, accuracy=0.2, norm="force", sides=[0]).mesh.n_nodes


def test_a_force_without_an_upper_bound_ends_the_search():
    """u = g at the vertex, where no bound separates a force from a reaction (Proposition S16 (b))."""
    problem = ul.Problem(**SEAL | {"g": ["-x/4", None, None, None]})
    with pytest.warns(ul.SolutionWarning, match="so the force has no upper bound"):
        s = ul.solve(problem, accuracy=0.1, norm="force", sides=[0])
    assert s.mesh.n_nodes < 40_000
    # the sum of both is known
    assert ul.solve(problem, accuracy=0.1, norm="force", sides=[0, 3]).certified


def last_level(**changes):
    """The last level of a search for the force on side 0 of SEAL."""
    goal = Goal(**{"accuracy": 0.2, "norm": "force", "sharp": True, "sides": (0,)} | changes)
    return search(ul.Problem(**SEAL), goal).best


def test_what_is_not_narrow_enough_is_not_certified():
    """Control: the same level, for an accuracy just below and just above its interval's half-width."""
    level = last_level()
    ratio = half_width(level.force) / level.force.lower
    for factor, certified in ((1.001, True), (0.999, False)):
        assert judge_for_goal(level, replace(level.goal, accuracy=factor * ratio)).certified is certified


def test_what_is_unknown_of_the_data_counts_by_the_width_that_it_causes():
    """The remainder of lambda's bound has the same part in the interval as in that bound."""
    level = last_level()
    weight = half_width(level.force) / level.bound.lambda_
    for factor, limited in ((0.99, False), (1.01, True)):
        remainder = factor * level.target / weight
        bound = replace(level.bound, irreducible_remainder=remainder)
        assert is_limited_by_data(replace(level, bound=bound)) is limited


def test_forces_that_are_apart_contradict_each_other():
    level = last_level()
    width = 2 * half_width(level.force)
    for shift, apart in ((0.9, False), (1.1, True)):
        lower = level.force.lower + shift * width
        shifted = replace(level, force=level.force._replace(lower=lower, upper=lower + width))
        assert contradict(level, shifted) is apart


@pytest.mark.parametrize(
    "changes",
    [
        {"norm": "h1", "sides": [0]},
        {"norm": "force", "sides": [1]},
        {"norm": "force", "sides": [7]},
        {"norm": "force", "sides": [0], "accuracy": None, "h": 0.1, "H": 0.2},
    ],
    ids=["norm", "free", "number", "sizes"],
)
def test_what_does_not_fit_a_force_is_refused(changes):
    with sentences.raises(ul.InputError):
        ul.solve(ul.Problem(**SEAL), **{"accuracy": 0.1} | changes)
