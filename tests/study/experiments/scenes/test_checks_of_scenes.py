"""The checks of rates on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table


def rates_table(*rates, verdict="holds", why="", cases=("full_contact", "natural")):
    """Rates (case, pair) in every norm, all 0 at another h/H; 0.5 is proved and 0.75 expected.

    The first pair is not asymptotic. All rates hold but those of the last case, which have that verdict.
    """
    position = ("case", "norm", "h_over_H")
    shape = (len(rates), 3, 2)
    rate = np.zeros((*shape, len(rates[0])))
    rate[..., 0, :] = np.array(rates)[:, None]
    verdicts = np.full(shape, "holds", dtype="<U10")
    verdicts[-1] = verdict
    return table(
        **{"verdict": (position, verdicts), "why": (position, np.full(shape, why))},
        **{"proved": (position, np.full(shape, 0.5)), "expected": (position, np.full(shape, 0.75))},
        rate=((*position, "pair"), rate),
        asymptotic=((*position, "pair"), np.ones(rate.shape) * (np.arange(rate.shape[-1]) > 0)),
        **{
            "case": list(cases[: len(rates)]),
            "norm": ["h1", "hm12", "l2"],
            "h_over_H": ("h_over_H", [0.5, 0.25]),
        },
    )


FAST = [0.1, 1.0, 0.9]
RISING = [0.1, 0.8, 1.1]
LOW = [0.1, 0.3, 1.1]
VERTICES = ["obtuse_0.9", "reentrant_full"]
REGULAR = ["singular", "reentrant"]
LAST = [[1.0, 8, 5, 1], [9, 2, 9, 1]]
"""Over the last two pairs from 8 to 1 and from 2 to 1: 2^3 and 2^1 over a factor of 4."""


ROWS = [
    # The smallest rate on asymptotic pairs at the judged ratio, against 0.5 less 0.1. Exact errors have none.
    # A rate that is not judged to hold is no evidence, unless it is slow, as it then is for the claim too.
    ("4.13", rates_table(FAST, RISING), (0.8, True)),
    ("4.13", rates_table(FAST, RISING, verdict="exact"), (0.9, True)),
    (
        "4.13",
        rates_table(FAST, RISING, verdict="fails", why="it did not"),
        "^square, natural, l2: it did not;",
    ),
    ("4.13", rates_table(FAST, RISING, verdict="not judged"), "^square, natural, l2: not judged; unstr"),
    ("4.13", rates_table(FAST, LOW, verdict="not judged"), (0.3, False)),
    ("4.13", rates_table(FAST, verdict="exact"), "there is no rate: all errors are 0"),
    # No faster rate is looked for on the finest pair that there is.
    ("4.11s", rates_table([9.0, 1.0, 1.02, NAN], [9.0, 1.1, 0.7, 0.9]), (1.02, True)),
    # On the finest pair no rate is far above the expected one, 0.75; in tolerances of 0.1.
    ("T.Vs", rates_table([9.0, 0.1, 0.8, NAN], [9.0, 1.1, 0.1, 0.7], cases=VERTICES), (0.5, True)),
    ("T.Vs", rates_table([9.0, 0.1, 1.0, NAN]), "there is nothing"),
    # Rates that fail are compared with the expected ones, too, 0.75; in tolerances of 0.1.
    ("S.13", rates_table([0.0, 0.8], [0.0, 0.4], verdict="fails"), (-3.5, False)),
    ("S.13", rates_table([0.0, 0.8], [0.0, 0.4], verdict="not judged"), (0.5, True)),
    ("S.13", rates_table(FAST, RISING, verdict="fails"), "^square, natural, l2: fails"),
    # Against the order of regularity, 0.75 and 2/3, over 0.03 in H^1 and 0.1 in the dual norm.
    ("T.R", rates_table(RISING, FAST, cases=REGULAR), (0.5, True)),
    ("T.R", rates_table(FAST, LOW, cases=REGULAR), ((0.3 - 2 / 3) / 0.03, False)),
    ("T.R", rates_table(RISING, FAST, verdict="fails", cases=REGULAR), "^irregular, reentrant, h1: fails"),
    # Over the last factor of 4.
    ("3.6", table(ritz_error=LAST, case=["reentrant", "violates_j"]), 1.5),
    ("4.14", table(interpolation_error=LAST, case=["thirds", "natural"]), 0.5),
    ("4.14", table(interpolation_error=LAST, case=["thirds", "rough"]), 1.5),
    ("4.16b", table(consistency=LAST, case=["rough", "thirds"]), 0.5),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
