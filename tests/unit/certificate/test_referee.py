"""Traps that a hostile reader of certificate/check.py found, and its numbers computed in another way."""

import importlib.util

import pytest
from conftest import ROOT

CHECKER = ROOT / "certificate/check.py"
specification = importlib.util.spec_from_file_location("check_read_by_referee", CHECKER)
check = importlib.util.module_from_spec(specification)
specification.loader.exec_module(check)


def square():
    """u = g = (x^2 + y^2)/2 on the unit square, in contact all around.

    v interpolates u, p = grad u, and v + y = u at the boundary.
    """
    g = [[2, 0, "1/2"], [0, 2, "1/2"]]
    return {
        "format": "unilateral certificate 1",
        "problem": {
            "k": "1",
            "c": "1",
            "f": [[0, 0, "-2"], *g],
            "polygon": [["0", "0"], ["1", "0"], ["1", "1"], ["0", "1"]],
            "sides": [{"contact": g}, {"contact": g}, {"contact": g}, {"contact": g}],
        },
        "mesh": {"boundary": [[0], [0], [0], [0]], "inside": [], "triangles": [[0, 1, 2], [0, 2, 3]]},
        "v": [0, 0.5, 1, 0.5],
        "flux": [1, 1, 0, 0, 0, 0, 1, 1, 0, 0],
        "trace": [0, 0.5, 1, 0.5, 0.125, 0.625, 0.625, 0.125],
    }


def refusal(certificate):
    with pytest.raises(check.Refused) as caught:
        check.Certificate(certificate).bounds()
    return str(caught.value)


def test_the_square_is_proved():
    """u - v = (x^2 - x + y^2 - y)/2, so |u - v|_1^2 = 1/6 and ||u - v||^2 = 11/360, by hand."""
    X, L = check.Certificate(square()).bounds()
    assert (1 / 6 + 11 / 360) ** 0.5 < X < 1
    assert 0 < L < 1


def test_another_format_is_refused():
    assert "format" in refusal(square() | {"format": "unilateral certificate 2"})


def test_two_conditions_on_one_side_do_not_make_up_for_a_side_without():
    certificate = square()
    g = certificate["problem"]["sides"][0]["contact"]
    certificate["problem"]["sides"] = [{"contact": g, "free": []}, {}, {"contact": g}, {"contact": g}]
    assert "one condition" in refusal(certificate)
