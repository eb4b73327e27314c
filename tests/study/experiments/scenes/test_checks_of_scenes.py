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


ALL_ORDERS = (
    *("full_contact", "natural", "no_contact", "smooth", "thirds", "vertex", "violates_jj"),
    *("borderline_0.25", "borderline_0.1", "borderline_0.05", "obtuse_0.75", "obtuse_0.9"),
)


def l2_table(errors, algebraic=0.0, least_multiplier=1.0, asymptotic=(0.0, 1.0, 1.0, 1.0), cases=ALL_ORDERS):
    """The same errors of u in L2 of all cases on five meshes, and the pairs of levels that are judged."""
    n = len(cases)
    sizes = 0.5 ** np.arange(5)
    position = ("case", "norm", "h_over_H")
    pairs = {"asymptotic": asymptotic, "h_coarse": sizes[:-1], "h_fine": sizes[1:]}
    runs = {
        "u_l2_error": errors,
        "algebraic_bound": algebraic * np.array(errors),
        "least_multiplier": np.full(5, least_multiplier),
    }
    return table(
        **{name: ((*position, "pair"), np.full((n, 1, 1, 4), value)) for name, value in pairs.items()},
        **{name: (("case", "mesh"), np.full((n, 5), value)) for name, value in runs.items()},
        **{"case": list(cases), "norm": ["hm12"], "h_over_H": ("h_over_H", [0.5]), "h": sizes},
    )


def fixed_cells(D):
    """D on three meshes, on cells of 16 edges and of 8, where it falls fast; the distance of lambda is 1."""
    cases = ["full_contact", "natural", "smooth", "thirds"]
    values = np.array([[[d, 0.01**level] for level, d in enumerate(D)]] * 4)
    sizes = {"H": [1.0, 0.5], "h": ("mesh", [0.25, 0.125, 0.0625])}
    return table(discrete_error=values, hm12_best=np.ones(values.shape), **sizes, case=cases)


FOURTHS = 0.25 ** np.arange(5)
LATE = FOURTHS * [9, 1, 1, 1, 1]
SLOW = FOURTHS * [1, 1, 1, 1, 2]
CONTACT = ("full_contact", "obtuse_0.75", "obtuse_0.9")
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
    # In L2 the worst case is that of order 2, no_contact, or of full contact: by hand the rate 2, and 1.
    ("T.L2", l2_table(FOURTHS), (0.0, True)),
    ("T.L2", l2_table(LATE), (0.0, True)),
    ("T.L2", l2_table(SLOW), (-10.0, False)),
    ("T.L2", l2_table(FOURTHS, algebraic=0.011), "^square, borderline_0.05: a guaranteed algebraic error is"),
    ("T.L2", l2_table(FOURTHS, asymptotic=(0, 0, 1, 1)), "^square, borderline_0.05: there are fewer than 3"),
    (
        "T.L2",
        l2_table(FOURTHS, cases=CONTACT),
        "^borderline_0.05 is in no scene; .*; violates_jj is in no sc",
    ),
    ("T.L2c", l2_table(FOURTHS), (0.0, True)),
    ("T.L2c", l2_table(SLOW, least_multiplier=0.0), (-10.0, False)),
    ("T.L2c", l2_table(FOURTHS, least_multiplier=0.0), "^square, full_contact: a multiplier is 0;"),
    # At fixed H the rate of D in h alone on the finest pair, where 16 edges are in a cell there.
    ("T.fix", fixed_cells([9.0, 1.0, 1.0]), (0.0, True)),
    ("T.fix", fixed_cells([9.0, 2.0, 1.0]), (1.0, False)),
    ("T.fix", fixed_cells([9.0, 0.5, 0.5]), (0.5, False)),
    # Over the last factor of 4.
    ("3.6", table(ritz_error=LAST, case=["reentrant", "violates_j"]), 1.5),
    ("4.14", table(interpolation_error=LAST, case=["thirds", "natural"]), 0.5),
    ("4.14", table(interpolation_error=LAST, case=["thirds", "rough"]), 1.5),
    ("4.16b", table(consistency=LAST, case=["rough", "thirds"]), 0.5),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
