"""Floors from synthetic errors whose law is known, and what a law of another form does to the fit."""

import numpy as np
import pytest
import sentences
import xarray as xr

from study.experiments.scenes.floors import fit_cases, fit_floor
from unilateral.errors import InputError

SIZES = [a.ravel() for a in np.meshgrid(2.0 ** -np.arange(3, 9), 2.0 ** -np.arange(2, 9), indexing="ij")]


def law(C1, C2, s):
    h, H = SIZES
    return np.sqrt((C1 * h) ** 2 + (C2 * H**s) ** 2)


@pytest.mark.parametrize(
    ("C1", "C2", "s"), [(1.0, 1.0, 1.5), (0.3, 2.0, 1.25), (2.0, 0.05, 1.0), (1e-3, 1e-2, 2.0)]
)
def test_an_exact_law_is_found(C1, C2, s):
    """To 1e-6: the square root of round-off, as a minimum of squares is known."""
    floor = fit_floor(*SIZES, law(C1, C2, s))
    assert (floor.C1, floor.C2, floor.s) == pytest.approx((C1, C2, s), rel=1e-6)
    assert floor.s_uncertainty < 1e-6
    assert floor.residual < 1e-6
    assert floor.pairs == 42


def test_the_uncertainty_is_that_of_repeated_noise():
    """2 % of noise, 200 times: s spreads over the fits as each of them states, to 20 %.

    200 samples know a standard deviation to 5 %, and each states it from 39 degrees of freedom.
    """
    random = np.random.default_rng(1)
    exact = law(0.3, 2.0, 1.25)
    floors = [fit_floor(*SIZES, exact * np.exp(0.02 * random.standard_normal(42))) for _ in range(200)]
    stated = np.median([fit.s_uncertainty for fit in floors])
    observed = np.std([fit.s for fit in floors])
    assert observed == pytest.approx(stated, rel=0.2)
    assert np.mean([fit.s for fit in floors]) == pytest.approx(1.25, abs=4 * observed / np.sqrt(200))


def test_another_law_leaves_a_residual():
    """Control: a sum of three powers, whose H^(1/2) no s near 3/2 can follow."""
    h, H = SIZES
    floor = fit_floor(h, H, np.sqrt(h**2 + H**3 + 0.01 * H))
    assert floor.residual > 0.1
    assert abs(floor.s - 1.5) > 0.1


@pytest.mark.parametrize("retained", [slice(0, 3), slice(0, 7), slice(0, 42, 7)])
def test_too_few_sizes_are_refused(retained):
    """Three errors; one h; one H."""
    h, H = SIZES
    with sentences.raises(InputError):
        fit_floor(h[retained], H[retained], law(1, 1, 1)[retained])


def table():
    """A case with an exact law, but wrong on coarse levels and unknown on a pair; one with lambda = 0."""
    h = 2.0 ** -np.arange(3, 9)
    H = 2.0 ** -np.arange(2, 9)
    error = law(0.3, 2.0, 1.25).reshape(6, 7).copy()
    error[0] *= 3
    error[:, 0] *= 3
    error[-1, -1] = np.nan
    return xr.Dataset(
        {
            "h1_error": (("case", "mesh", "partition"), np.stack([error, 0.3 * h[:, None] + 0 * error])),
            "projection_error": (("case", "partition"), np.stack([H, 0 * H])),
            "u_norm": (("case", "mesh"), np.ones((2, 6))),
        },
        coords={"case": ["made_up", "no_contact"], "h": ("mesh", h), "H": ("partition", H)},
    )


def test_only_asymptotic_sizes_count_and_lambda_must_not_be_0():
    cases = fit_cases(table(), {"made_up": 1 / 16, "no_contact": 1 / 16}, 1 / 2)
    assert list(cases["case"].values) == ["made_up"]
    row = cases.sel(case="made_up")
    assert [float(row[name]) for name in ("C1", "C2", "s")] == pytest.approx([0.3, 2.0, 1.25], rel=1e-6)
    assert int(row["pairs"]) == 5 * 6 - 1
    assert float(row["start"]) == 1 / 16
    wrong = fit_cases(table(), {"made_up": 1 / 8, "no_contact": 1 / 8}, 1 / 2).sel(case="made_up")
    assert abs(float(wrong["s"]) - 1.25) > 0.1
