"""The stored errors of other methods' multipliers, beside those of the scene `square`. Nothing is solved."""

import numpy as np
from conftest import config, read_stored_table

from study import tables
from unilateral.formulas.formula import parse_real

STUDY = config("study")["multipliers"]


def test_the_table_is_complete_and_solved():
    errors = read_stored_table("multipliers/errors")
    assert errors["case"].values.tolist() == STUDY["scenes"][0]["cases"]
    np.testing.assert_array_equal(errors["h"], [parse_real(h, "") for h in STUDY["h"]])
    assert errors.notnull().all()
    assert np.all(errors["algebraic_bound"] < 1e-6 * errors["hm12_error_lower"])


def test_bounds_are_near_each_other():
    """Rates over a factor of 4 are then known to ln(1.05)/ln 4 = 0.035, below the tolerance of 0.1."""
    errors = read_stored_table("multipliers/errors")
    index = errors["hm12_error_upper"] / errors["hm12_error_lower"]
    assert float(index.min()) >= 1
    assert float(index.max()) < 1.05


def test_the_method_of_1980_has_the_errors_of_the_scene():
    """Those have an algebraic error of up to 1 %, and the mean of other bounds. Control: those at H = 4h."""
    errors = read_stored_table("multipliers/errors")
    scene = read_stored_table("square/errors").sel(case=errors["case"].values)
    for norm in ("hm12", "l2"):
        expected = tables.error_in_norm(tables.select_ratio(scene, 1 / 2), norm).values
        computed = tables.error_in_norm(errors, norm).transpose("case", "scheme", "mesh")
        np.testing.assert_allclose(computed.sel(scheme="P0, H = 2h"), expected, rtol=0.02)
        assert np.all(computed.sel(scheme="P0, H = 4h")[:, -1] > 1.5 * expected[:, -1])
