"""Work at neighbouring sizes, counted by hand, and cliffs that the claim sees."""

import pytest

from study.experiments.extremes.neighbours import SOURCES, count_work, survey_neighbours
from study.ledger import claims
from unilateral.bounds import source_ancestors
from unilateral.geometry.polygon import square
from unilateral.problems.build import make_problem
from unilateral.solution import sizes
from unilateral.solution.solver import Solver


def judge_claim(table):
    """What the claim of the ledger observes of that table."""
    return claims.find_claim("X.cost").measure({"extremes/neighbours": table})


def test_work_is_that_of_all_applications_and_of_polynomials():
    """h = 1/8 is halved once from 1/4, and 1 is enclosed on the 32 triangles there, by 15 coefficients."""
    solution = Solver(make_problem(square(), f="1", g="-x*y/9"), h=1 / 8, H=1 / 4)().solved
    assert count_work("1", 1 / 8) == solution.result.operator_applications * 9**2 + 32 * 15


def test_a_survey_has_all_points():
    table = survey_neighbours({"neighbours": ["1/8", "1/9"]})
    assert dict(table.sizes) == {"case": 2, "mesh": 2}
    assert table["h"].values.tolist() == [1 / 8, 1 / 9]
    expected = count_work(SOURCES["smooth f"], 1 / 9) / 81
    assert table["work"].sel(case="smooth f").values[1] == pytest.approx(expected)


def test_neighbours_on_both_sides_of_a_power_of_2_take_the_same_work():
    assert judge_claim(survey_neighbours({"neighbours": ["1/255", "1/256", "1/257"]})).holds


CLIFF = {"neighbours": ["1/256", "1/257"]}
"""Two neighbours, between which controls put a cliff."""


def test_a_size_without_levels_is_seen(monkeypatch):
    """257 is odd: such a mesh has no coarse ones."""
    monkeypatch.setattr(sizes, "choose_halvings", lambda *_: 0)
    assert judge_claim(survey_neighbours(CLIFF)).observed > 100


def test_f_that_is_looked_at_everywhere_is_seen(monkeypatch):
    """On each of the triangles after six halvings; 256 has six from 4, and the other one or two."""
    monkeypatch.setattr(source_ancestors, "max_halvings_now", lambda _: 5)
    assert judge_claim(survey_neighbours(CLIFF)).observed > 1.5
