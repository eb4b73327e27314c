"""The data of the report's page on which a case, a norm and h/H are chosen, by hand."""

import numpy as np
import xarray as xr
from pages import study_errors

from study.documents import curves


def make_fitted_rates():
    """Rates 1 of two pairs at h/H = 1/2, of which the first counts; nothing is known of the other one."""
    dims = ("case", "norm", "h_over_H")
    missing_values = np.full((1, 3, 1, 3), np.nan)
    pairs = {name: missing_values.copy() for name in ("h_coarse", "h_fine", "rate", "asymptotic")}
    for name, values in zip(pairs, ([0.5, 0.25], [0.25, 0.125], [1, 1], [1, 0]), strict=True):
        pairs[name][..., :2] = values
    first = np.ones((1, 3, 1))
    columns = {name: ((*dims, "pair"), values) for name, values in pairs.items()}
    columns |= {"proved": (dims, first), "expected": (dims, 1.5 * first)}
    columns |= {"verdict": (dims, np.full((1, 3, 1), "holds")), "why": (dims, np.full((1, 3, 1), ""))}
    return xr.Dataset(columns, {"case": ["made_up"], "norm": [*curves.ERROR_NORMS], "h_over_H": [0.5]})


def test_curves_hold_the_numbers_of_the_tables():
    """By hand: 10 h + H at H = 2 h is 12 h; on one mesh the bounds are twice and thrice the errors."""
    errors = study_errors()
    over = {"total_index_u": 2.0, "local_index_u": 3.0, "total_index_lambda": 2.0, "local_index_lambda": 3.0}
    totals = xr.Dataset(
        {name: (("case", "mesh"), [[value]]) for name, value in over.items()} | {"H": ("mesh", [0.5])},
        {"case": ["made_up"], "h": ("mesh", [0.25])},
    )
    u, lambda_curve, in_l2 = curves.collect_curves("scene", errors, make_fitted_rates(), totals)
    assert [
        (record["norm"], record["ratio"], record["scene"], record["case"])
        for record in (u, lambda_curve, in_l2)
    ] == [(norm, "1/2", "scene", "made_up") for norm in curves.ERROR_NORMS]
    assert [level["error"] for level in u["levels"]] == [6, 3, 1.5]
    bounds = [(level.get("sharp"), level.get("cheap")) for level in u["levels"]]
    assert bounds == [(None, None), (6, 9), (None, None)]
    assert u["pairs"] == [
        {"coarse": 0.5, "fine": 0.25, "rate": 1, "counts": True},
        {"coarse": 0.25, "fine": 0.125, "rate": 1, "counts": False},
    ]
    assert (u["proved"], u["expected"], u["observed"]) == (1, 1.5, "1.00 of 1.5 (1 pair)")
    assert not u["exact"]
    level = lambda_curve["levels"][1]
    upper = 3 * np.sqrt(2 - 0.8**2)
    assert (level["lower"], level["error"]) == (2.4, 3)
    for name, exact in {"upper": upper, "sharp": 2 * upper, "cheap": 3 * upper}.items():
        assert exact <= level[name] < 1.001 * exact
    assert not any("sharp" in level for level in in_l2["levels"])
    without = curves.collect_curves("scene", errors, make_fitted_rates(), None)[0]
    assert not any("sharp" in level for level in without["levels"])
