"""The stored study of graded meshes: what theory says of every run. Nothing is solved here."""

import numpy as np
from conftest import config, read_stored_table

from study.ledger import claims
from unilateral.formulas.formula import parse_real

STUDY = config("study")["graded"]
GIVEN = [
    (case, parse_real(kappa, ""))
    for scene in STUDY["scenes"]
    for case in scene["cases"]
    for kappa in scene["kappas"]
]
EXPONENTS = {"reentrant_full": 2 / 3, "obtuse_0.9": 10 / 9, "obtuse_0.75": 4 / 3}
"""pi/omega for the angles 3 pi/2, 9 pi/10 and 3 pi/4."""


def test_the_table_is_complete():
    """Every case without grading, and with kappa < 2 pi/(3 omega), from where on 3/2 is the order."""
    errors = read_stored_table("graded/errors")
    computed = list(zip(errors["case"].values.tolist(), errors["kappa"].values.tolist(), strict=True))
    assert computed == GIVEN
    np.testing.assert_allclose(errors["exponent"], [EXPONENTS[case] for case, _ in GIVEN], rtol=1e-12)
    for case, exponent in EXPONENTS.items():
        kappas = [kappa for name, kappa in GIVEN if name == case]
        assert kappas[0] == 1
        assert kappas[-1] < 2 / 3 * exponent < kappas[-2] or case == "obtuse_0.75"
    assert set(errors["level"].values) == set(range(4))
    assert errors.drop_vars(["hm12_error_lower", "hm12_error_upper", "beta_lower"]).notnull().all()


def test_all_is_solved_and_in_full_contact():
    """To a hundredth of D; what quadrature adds to the square of ||u - u_h||_1 does not count."""
    errors = read_stored_table("graded/errors")
    assert np.all(errors["converged"] == 1)
    assert np.all(errors["algebraic_bound"] <= 0.01 * errors["discrete_error"])
    assert np.all(
        errors["quadrature_share"] * errors["h1_error"] ** 2 <= 1e-3 * errors["singular_error"] ** 2
    )
    assert np.all(errors["least_multiplier"] > 0)


def test_meshes_are_shape_regular_and_stable():
    """By hand the node nearest to the vertex is at the part 2^(-1/kappa) of its cell."""
    errors = read_stored_table("graded/errors")
    assert np.all(errors["least_angle"] > 10)
    first = np.broadcast_to(2 ** (-1 / errors["kappa"].values[:, None]), errors["delta"].shape)
    np.testing.assert_allclose(errors["delta"], first, rtol=1e-9)
    expected = errors["beta_lower"].notnull()
    assert np.all(expected.sum("level") >= 3)
    assert np.all((errors["beta_lower"] > 0.5).where(expected, True))


def test_the_dual_norm_is_known_to_one_percent_and_not_below_the_discrete_one():
    errors = read_stored_table("graded/errors")
    expected = errors["hm12_error_lower"].notnull()
    lower = errors["hm12_error_lower"].where(expected, 1.0)
    upper = errors["hm12_error_upper"].where(expected, 1.0)
    minimum = errors["discrete_error"].where(expected, 1.0)
    assert np.all((minimum <= lower) & (lower <= upper) & (upper <= 1.01 * lower))


def test_the_order_of_u_is_one_where_kappa_is_below_the_exponent():
    """||u - u_h||_1 on the finest pair, to the tolerance of rates.yaml and what half a level changes."""
    errors = read_stored_table("graded/errors")
    rates = np.log2(errors["h1_error"].values[:, -2] / errors["h1_error"].values[:, -1])
    fine = errors["kappa"].values < errors["exponent"].values
    assert fine.sum() > 5
    assert np.all(rates[fine] > 1 - 2 * config("rates")["rates"]["norms"]["h1"]["tolerance"])


def test_adapted_meshes_keep_the_limit_and_their_errors_count():
    table = read_stored_table("graded/adapted")
    assert table["case"].values.tolist() == list(EXPONENTS)
    assert float(table["unknowns"].max()) <= STUDY["adapted"]
    share = (table["algebraic_bound"] / table["discrete_error"]).max()
    assert float(share) <= 0.01
    for name in ("h1_error", "discrete_error"):
        for case in table["case"].values:
            assert np.all(np.diff(table[name].sel(case=case).dropna("level")) < 0)


def test_claims_have_the_tolerance_of_the_dual_norm():
    tolerance = config("rates")["rates"]["norms"]["hm12"]["tolerance"]
    for name in ("A.G", "A.Gs", "A.Gt"):
        assert claims.find_claim(name).parameters["tolerance"] == tolerance
