"""The checks of adapted meshes on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table


def on_levels(rate=(NAN,) * 4, share=0.005, index=1.2, asymptotic=1.0):
    """Of five cases on uniform meshes, which are bad, and adapted ones; the first level is not asymptotic."""
    values = {"error_rate": [NAN, *rate], "share": [9, *[share] * 4], "index": [9, *[index] * 4]}
    both = {name: np.array([[9 * np.ones(5), of]] * 5) for name, of in values.items()}
    both["asymptotic"] = np.array([[[0.0, *(asymptotic,) * 4]] * 2] * 5)
    given = {name: (("case", "kind", "level"), each) for name, each in both.items()}
    cases = ["reentrant", "violates_j", "singular", "thirds", "clamped_270"]
    return table(**given, kind=["uniform", "adapted"], case=cases)


ROWS = [
    # Three pairs at least of asymptotic levels, with algebraic bounds of 1 % at most.
    ("A.rate", on_levels([0.5, 0.48, 0.6, NAN]), (0.48, True)),
    ("A.rate", on_levels([0.5, 0.46, 0.6, NAN], 0.02), (0.46, False)),
    ("A.rate", on_levels([0.5, 0.48, 0.6, NAN], 0.02), r"^the algebraic bound is 0\.02 of an error$"),
    ("A.rate", on_levels([0.5, 0.48, 0.6, NAN], NAN), "^the algebraic bound is nan of an error$"),
    ("A.rate", on_levels([0.5, 0.48, NAN, NAN]), "^reentrant has 2 pairs; violates_j has 2 pairs; "),
    ("A.rate", on_levels([NAN, NAN, NAN, NAN]), "^reentrant has 0 pairs"),
    ("A.rate", on_levels([0.4, NAN, NAN, NAN]), (0.4, False)),
    # How large a bound is counts on asymptotic levels.
    ("A.index", on_levels(index=1.5), (1.5, True)),
    ("A.index", on_levels(asymptotic=0.0), "the largest bound over .* is not known of reentrant"),
]


@pytest.mark.parametrize(("check", "given", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, given, expected):
    observes(check, given, expected)
