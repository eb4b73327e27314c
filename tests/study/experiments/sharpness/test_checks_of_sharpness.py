"""The checks of single transitions on made-up tables, by hand; see made_up.py."""

import math
from functools import partial

import numpy as np
import pytest
from made_up import INF, NAN, observes, table

from study.experiments.sharpness import checks as exponents


def surfaces():
    """Rates on three pairs over alpha and gamma, where 1 is predicted; of consistency alpha + gamma + 1 is.

    On the last two pairs 1 is missed by 1/8 at (1/4, 1.5) and by 1/16 at (1/2, 1.5), by 1/2 for alpha = 0,
    and by 3/4 for gamma < 1; the consistency term's rate by 1/4 at one place. On the first one all are 0.
    """
    alpha = np.array([0, 0.25, 0.5])
    gamma = np.array([0.1, 0.25, 0.5, 1.5, 2.5])
    rate = np.ones((1, 3, 3, 5))
    rate[..., :3] = 0.25
    rate[:, :, 0] = 0.5
    rate[:, 0] = 0.0
    rate[0, 1, 1, 3] = 0.875
    rate[0, 2, 2, 3] = 0.9375
    predicted = alpha[:, None] + gamma + 1
    terms = np.stack([0 * predicted, predicted, predicted])
    terms[2, 1, 1] -= 0.25
    return table(
        rate=(("norm", "pair", "alpha", "gamma"), np.tile(rate, (3, 1, 1, 1))),
        predicted=(("norm", "alpha"), np.ones((3, 3))),
        consistency_rate=(("pair", "alpha", "gamma"), terms),
        consistency_predicted=(("alpha", "gamma"), predicted),
        **{"norm": ["h1", "hm12", "l2"], "alpha": alpha, "gamma": gamma},
    )


def powers(*changed, gamma=1.0, **variables):
    """Errors H^(1 + alpha) over alpha = -1/4, 1/4, 1/2 and gamma = 1/10, 1, and `changed` ones.

    Those are factors by places (level, alpha, gamma). Predicted is 1 + alpha, left by the proof half that of
    gamma more.
    """
    H = 0.5 ** np.arange(2, 6)
    alpha = np.array([-0.25, 0.25, 0.5])
    gammas = np.array([0.1, gamma])
    error = np.tile(H[:, None, None] ** (1 + alpha[:, None]), (1, 1, 2))
    for place, factor in changed:
        error[place] *= factor
    remaining = 0.5 * (1 + alpha[:, None] + gammas)
    fields = {"error": (("norm", "level", "alpha", "gamma"), np.stack([error, error]))}
    fields |= {"predicted": (("norm", "alpha"), np.stack([1 + alpha, 1 + alpha]))}
    fields |= {"left_by_proof": (("norm", "alpha", "gamma"), np.stack([remaining, remaining]))}
    return table(**fields, **variables, norm=["hm12", "discrete"], alpha=alpha, gamma=gammas, H=("level", H))


LOWER = (np.s_[-1, 1, 0], 2**0.75)
"""Over three pairs the rate is lower by 1/4 at alpha = 1/4, gamma = 1/10."""
HELD = (np.s_[:2, 1, 1], 0.5)
"""On the coarser levels; so the rate at gamma = 1 is lower at a pair, that of the largest error is not."""
UNKNOWN = (-1, NAN)
AT_HALF = (np.s_[-1, 2], 0.5)
LEAST = partial(exponents.theorem_4, table="t", tolerances={"hm12": 0.1})
MOST = partial(exponents.theorem_4_sharpness, table="t", largest={"hm12": 2.0}, tolerance=0.1)
BELOW = partial(exponents.theorem_4_sharpness, table="t", largest={"hm12": 0.25}, tolerance=0.1)


def make_positions(place, held_cells=()):
    """Errors of 1 but for one of 1.5; all cells at gamma = 1, with alpha < 0, on the first level are held."""
    error = np.ones((4, 3, 2, 2))
    has = np.zeros((4, 3, 2, 2))
    error[place] = 1.5
    has[:, :, 1] = 1.0
    has[:, 0] = 1.0
    has[0] = 1.0
    if held_cells:
        has[held_cells] = 1.0
    fields = {"l2_error": (("level", "alpha", "gamma", "position"), error), "held": has}
    return table(**fields, alpha=[-0.25, 0.25, 0.5], gamma=[0.1, 1.0])


RELEASED = partial(exponents.free_position_errors, table="t", norms=["l2"], at_most=1.5)
TAKEN = math.log2((1 + math.log(32)) / (1 + math.log(16)))
"""What the logarithm takes from a rate of t at alpha = 1/2 on the last pair."""


def t_rates(*last):
    return powers(t_rate=(("pair", "alpha"), np.array([[0, 0, 0], *last])))


def ritz(nu):
    """Errors h^2 over the last factor of 4, with that exponent of a case; and what they exceed by."""
    h = 0.5 ** np.arange(1, 6)
    power = {0.25: 0, 0.5: 1}.get(nu, 0.5)
    selected = power * math.log((1 + math.log(32)) / (1 + math.log(8))) / math.log(4)
    check = partial(exponents.proposition_3, scenes=["a"], exponents={"c": nu, "e": 1.0}, tolerance=0.1)
    ritz_table = table(ritz_boundary_error=[[9, 9, *h[2:] ** 2]], case=["c"], h=h)
    return check, ritz_table, 2 - min(2, 1.5 + nu) + selected


ROWS = [
    # Surfaces are judged on their two finest pairs, from an alpha on, at some gammas.
    ("S.hm12", surfaces(), (-0.125, False)),
    ("S.l2", surfaces(), (-0.125, False)),
    ("S.jj", surfaces(), (-0.75, False)),
    # Rates of the consistency term may not be lower either.
    ("S.16", surfaces(), 0.25),
    # D over all levels, for alpha > 0: what is between the ends does not count.
    ("T.H", powers(), 0.0),
    ("T.H", powers(LOWER), -0.25),
    ("T.H", powers((np.s_[:, 0], 9)), 0.0),
    ("T.H", powers((np.s_[1:3], 9)), 0.0),
    ("T.H", powers(UNKNOWN), "not known"),
    # D is compared with the other proof where both are apart: at gamma = 1 by 1/8 and 1/4, at 1.1 by 0.075
    # and 0.2, at 1.2 by 0.025 and 0.15, at 1/10 by 0.575 and 0.7.
    ("T.A", powers(), (0.25, True)),
    ("T.A", powers(gamma=1.1), (0.2, True)),
    ("T.A", powers(gamma=1.2), (0.575, True)),
    ("T.A", powers(LOWER), (0.25, True)),
    ("T.A", powers(LOWER, LOWER), (0.075, False)),
    # The largest error over gamma is judged, on the last two pairs or on the last one.
    *[(LEAST, powers(*changed), (0.0, True)) for changed in ([], [HELD], [AT_HALF])],
    (LEAST, powers((np.s_[-1, 1, 1], 2**0.25)), (-2.5, False)),
    (LEAST, powers((np.s_[:2], 0.5)), (-10.0, False)),
    (LEAST, powers(UNKNOWN), "not known"),
    *[(MOST, powers(*changed), 0.0) for changed in ([], [HELD], [(np.s_[-1, 1, 1], 2**0.25)])],
    (MOST, powers((np.s_[:2], 0.5)), 0.0),
    (MOST, powers(AT_HALF), 1.0),
    (MOST, powers(UNKNOWN), "not known"),
    (BELOW, powers(AT_HALF), (0.0, True)),
    # Errors at single positions are compared with those of the smallest gamma, on the last two levels and for
    # alpha > 0. There no cell may be held.
    *[(RELEASED, make_positions(place), 1.5) for place in ((2, 1, 1, 0), (3, 2, 1, 1))],
    *[(RELEASED, make_positions(place), 1.0) for place in ((1, 1, 1, 0), (3, 0, 1, 0))],
    (RELEASED, make_positions((2, 1, 1, 0), held_cells=(2, 1, 0, 1)), (1.0, False)),
    # t may lack its logarithm at alpha = 1/2, at 1/4 nothing; the first pair does not count.
    ("T.t", t_rates([0, 1.125, 1.5], [0, 1.25, 1.5]), (-0.125, False)),
    ("T.t", t_rates([0, 2, 1.5], [0, 1.25, 1.25]), min(0, TAKEN - 0.25)),
    # So may the Ritz projection; 3/2 + nu is expected of it, and 2 at most.
    *[ritz(nu) for nu in (0.25, 0.5, 0.9, INF)],
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
