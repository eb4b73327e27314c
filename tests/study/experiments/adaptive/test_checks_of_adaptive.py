"""The checks of adapted meshes on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table


def make_levels(rate=(NAN,) * 4, share=0.005, index=1.2, asymptotic=1.0):
    """Of five cases on uniform meshes, which are bad, and adapted ones; the first level is not asymptotic."""
    values = {"error_rate": [NAN, *rate], "share": [9, *[share] * 4], "index": [9, *[index] * 4]}
    pair = {name: np.array([[9 * np.ones(5), value]] * 5) for name, value in values.items()}
    pair["asymptotic"] = np.array([[[0.0, *(asymptotic,) * 4]] * 2] * 5)
    variables = {name: (("case", "kind", "level"), value) for name, value in pair.items()}
    cases = ["reentrant", "violates_j", "singular", "thirds", "clamped_270"]
    return table(**variables, kind=["uniform", "adapted"], case=cases)


def make_spectra(lambda_min, shortest_cell):
    """Of five cases on adapted meshes; the certified constant is 1/2."""
    cases = ["reentrant", "violates_j", "singular", "thirds", "step"]
    values = {"lambda_min": lambda_min, "shortest_cell": shortest_cell, "beta_0_certified": [0.5, 0.5]}
    variables = {name: (("case", "kind", "level"), np.array([[value]] * 5)) for name, value in values.items()}
    return table(**variables, kind=["adapted"], case=cases)


ROWS = [
    # lambda_min(S) over its lower bound, min H_i/4, and over min H_i: the part that fails is told.
    ("A.step", make_spectra([0.5, 0.2], [1.0, 0.4]), (2.0, True)),
    ("A.step", make_spectra([0.5, 0.09], [1.0, 0.4]), (0.9, False)),
    ("A.step", make_spectra([0.5, 0.5], [1.0, 0.4]), (1.25, False)),
    # Three pairs at least of asymptotic levels, with algebraic bounds of 1 % at most.
    ("A.rate", make_levels([0.5, 0.48, 0.6, NAN]), (0.48, True)),
    ("A.rate", make_levels([0.5, 0.46, 0.6, NAN], 0.02), (0.46, False)),
    ("A.rate", make_levels([0.5, 0.48, 0.6, NAN], 0.02), r"^the algebraic bound is 0\.02 of an error$"),
    ("A.rate", make_levels([0.5, 0.48, 0.6, NAN], NAN), "^the algebraic bound is nan of an error$"),
    ("A.rate", make_levels([0.5, 0.48, NAN, NAN]), "^reentrant has 2 pairs; violates_j has 2 pairs; "),
    ("A.rate", make_levels([NAN, NAN, NAN, NAN]), "^reentrant has 0 pairs"),
    ("A.rate", make_levels([0.4, NAN, NAN, NAN]), (0.4, False)),
    # How large a bound is counts on asymptotic levels.
    ("A.index", make_levels(index=1.5), (1.5, True)),
    ("A.index", make_levels(asymptotic=0.0), "the largest bound over .* is not known of reentrant"),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
