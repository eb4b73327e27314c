"""The study's stored results: the rates of every case, and what theory says of every single run.

Nothing is solved here. Expected rates and their sources stand in workflow/config/rates.yaml, the levels
that count in the cases' own files. What claims of the ledger say of these scenes is judged there.
"""

from dataclasses import replace
from functools import cache
from math import sqrt, tanh

import numpy as np
import pytest
import yaml
from conftest import ROOT

from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import tables
from unilateral.study.judge import claims, rates

STUDY = yaml.safe_load((ROOT / "workflow/config/study.yaml").read_text())
EXPECTED = yaml.safe_load((ROOT / "workflow/config/rates.yaml").read_text())["rates"]
SCENES = {name: scene for name, scene in STUDY["scenes"].items() if scene.get("judged", True)}
RATIO = real(EXPECTED["judged_ratio"], "study")
SIGMA_1 = tanh(1 / (2 * sqrt(2))) / sqrt(2)  # of the unit square, by separation of variables


@cache
def stored(name):
    try:
        return tables.load(ROOT / "results" / name)
    except InputError as missing:
        return str(missing)


def errors_of(scene, table="errors"):
    found = stored(f"{scene}/{table}.nc")
    if isinstance(found, str):
        pytest.fail(found.replace(str(ROOT) + "/", ""), pytrace=False)
    return found


@pytest.fixture(params=SCENES)
def errors(request):
    return errors_of(request.param)


def runs(table, name):
    """The computed values of a variable."""
    values = table[name].values
    return values[np.isfinite(values)]


@pytest.mark.parametrize("norm", rates.NORMS)
@pytest.mark.parametrize(("scene", "name"), [(s, c) for s in SCENES for c in SCENES[s]["cases"]])
def test_rate(scene, name, norm):
    """Every asymptotic pair reaches the expected rate, and the finest error its bound."""
    declared = case.declared(name)[0]["asymptotic"]
    expected = rates.Expectation.of(EXPECTED, name, norm, declared)
    found = rates.judge(errors_of(scene), name, norm, RATIO, expected)
    unjudged = EXPECTED["cases"][name][norm]["rate"] == "none"
    assert found.verdict in (("not judged",) if unjudged else ("holds", "exact")), (
        f"\n{scene}, {name}, {norm}\n{found}"
    )
    stored_verdict = errors_of(scene, "rates")["verdict"].sel(case=name, norm=norm, h_over_H=RATIO)
    assert stored_verdict.item() == found.verdict


@pytest.mark.parametrize("norm", rates.NORMS)
def test_a_spoilt_table_is_refused(norm):
    """Control: errors of the finest level 10 % larger, and one run marked as not converged."""
    table = errors_of("square")
    expected = rates.Expectation.of(EXPECTED, "natural", norm, case.declared("natural")[0]["asymptotic"])
    worse = table.copy(deep=True)
    for name in ("hm12_error_lower", "hm12_error_upper") if norm == "hm12" else (f"{norm}_error",):
        worse[name][{"mesh": -1}] *= 1.1 if norm == "h1" else 1.3
    assert rates.judge(worse, "natural", norm, RATIO, expected).verdict == "fails"
    unconverged = table.copy(deep=True)
    unconverged["converged"][{"mesh": 3}] = 0.0
    assert "did not converge" in str(rates.judge(unconverged, "natural", norm, RATIO, expected))


def test_the_table_is_complete(errors):
    """All variables, all cases and levels, NaN exactly where H/h is outside the scene's limits."""
    scene = SCENES[errors.attrs["scene"]]
    assert list(errors["case"].values) == scene["cases"]
    assert errors.sizes["mesh"] == scene["mesh"]["levels"]
    np.testing.assert_allclose(errors["H"], [real(H, "study") for H in scene["H"]], rtol=1e-14)
    limits = scene["H_over_h"]
    H_over_h = 1 / errors["h_over_H"].values * (1 + 1e-12)
    inside = H_over_h >= real(limits["min"], "study")
    if "max" in limits:
        inside &= H_over_h <= real(limits["max"], "study") * (1 + 2e-12)
    for name in ("h1_error", "algebraic_bound", "converged", "operator_applications", "balance"):
        values = errors[name].transpose("mesh", "partition", "case").values
        assert np.array_equal(np.isfinite(values).all(axis=-1), inside), name
        assert np.array_equal(np.isfinite(values).any(axis=-1), inside), name
    assert np.all(
        (errors["algorithm"] != "").transpose("mesh", "partition", "case").values == inside[..., None]
    )
    for name, variable in errors.variables.items():
        assert variable.attrs.get("units") or name == "case", name


def test_the_longest_edge_is_hardly_longer_than_the_longest_boundary_edge(errors):
    """By a factor of the square's diagonal at most, as the paper says."""
    assert np.all(errors["diameter"] <= np.sqrt(2) * errors["h"] * (1 + 1e-12))
    assert not np.all(errors["diameter"] <= errors["h"])


def test_every_run_converged_within_its_tolerance(errors):
    assert np.all(runs(errors, "converged") == 1)
    assert np.all(runs(errors, "algebraic_bound") <= runs(errors, "tolerance"))


def test_plain_uzawa_ran_wherever_beta_is_positive(errors):
    """beta > 0 is seen in lambda_min(S); where it is 0 the active set ran, and lambda is not judged."""
    singular = (errors["lambda_min"] <= 1e-12 * errors["lambda_max"]).broadcast_like(errors["h1_error"])
    solved = np.isfinite(errors["h1_error"])
    expected = np.where(solved, np.where(singular, "active_set", "uzawa"), "")
    assert np.array_equal(errors["algorithm"].transpose(*singular.dims).values, expected)
    judged = solved & ~singular
    for name in ("hm12_error_lower", "hm12_best", "hm12_discrete"):
        assert np.array_equal(np.isfinite(errors[name]), judged), name
    in_L2 = errors["case"] != "rough"  # whose lambda is like s^(-0.95)
    for name in ("hm12_error_upper", "l2_error"):
        assert np.array_equal(np.isfinite(errors[name]), judged & in_L2), name


def test_beta_vanishes_on_structured_squares_where_theory_says():
    """At H = h, with the kernel (-1)^e/|e|, and where T_H has more cells than the mesh boundary vertices."""
    table = errors_of("square")
    singular = (table["lambda_min"] <= 1e-12 * table["lambda_max"]).values
    solved = np.isfinite(table["lambda_min"].values)
    assert np.array_equal(singular[solved], (table["h_over_H"].values >= 1 - 1e-12)[solved])
    assert singular[solved].any()
    assert not singular[solved].all()


def test_the_step_limit_of_the_square_is_nearly_reached():
    """On the finest meshes, more nearly than claim 5.2c says."""
    assert runs(errors_of("square"), "lambda_max").max() >= (1 - 1e-4) / SIGMA_1


def test_the_global_balance_of_every_run(errors):
    """int u_h = int f + int lambda_H, the equation tested with v = 1; relative to u where that is large."""
    scale = np.maximum(1, errors["u_norm"].max("mesh"))
    assert np.all(runs(errors.assign(share=errors["balance"] / scale), "share") <= 1e-10)


ELSEWHERE = [
    (name, scene)
    for name in ("4.6", "F.norm", "F.share")
    for scene in SCENES
    if scene not in claims.find(name).parameters["scenes"]
]


@pytest.mark.parametrize(("name", "scene"), ELSEWHERE)
def test_claims_of_every_run_are_true_of_the_scenes_that_they_do_not_name(name, scene):
    """By the claim's own check, with its own number; the ledger's controls are those of the check."""
    claim = claims.find(name)
    claim = replace(claim, parameters={**claim.parameters, "scenes": [scene]})
    judgement = claims.judge(claims.Results(ROOT / "results"), [claim])[0]
    assert judgement.holds, "\n" + claims.explanation(judgement)


def test_the_exact_split_of_smooth_runs(errors):
    """||u-u_h||^2 = ||u-z_h||^2 + ||lambda-lambda_H||^2_{-1/2,h}, to round-off where data are smooth."""
    share = errors["quadrature_share"]
    smooth = errors["case"].isin(["full_contact", "no_contact"])
    absolute = (share * errors["h1_error"] ** 2 / errors["u_norm"] ** 2).where(smooth, 0)
    assert float(absolute.max()) <= 1e-10


def test_the_upper_bound_is_not_below_the_discrete_norm(errors):
    """V_h is conforming: its supremum is a lower bound of the norm, found without the reference spaces."""
    assert not np.any(errors["hm12_error_upper"] < errors["hm12_discrete"])


def test_an_upper_bound_a_thousandth_lower_would_be_below_it():
    """Control."""
    table = errors_of("square")
    known = table["hm12_discrete"] > 1e-10
    assert np.any((0.999 * table["hm12_error_upper"] < table["hm12_discrete"]) & known)


def both_bounds(errors):
    """The bounds of the errors in the dual norm that have both."""
    lower, upper = (errors[f"hm12_error_{bound}"].values for bound in ("lower", "upper"))
    return lower[np.isfinite(upper)], upper[np.isfinite(upper)]


def test_most_bounds_of_the_dual_norm_are_close_and_none_cross(errors):
    """The median of upper / lower - 1 is at most 1.5 % where the error is not 0."""
    lower, upper = both_bounds(errors)
    assert np.all(lower <= upper)
    zero = 1e-12 * errors["u_norm"].max().item()
    assert np.median(upper[upper > zero] / lower[upper > zero] - 1) <= 0.015


def test_the_shortcut_is_no_bound_of_the_dual_norm(errors):
    """Control: H^{1/2} ||lambda - lambda_H||_0 would lie outside the bounds in most runs."""
    shortcut = runs(errors.assign(shortcut=np.sqrt(errors["H"]) * errors["l2_error"]), "shortcut")
    lower, upper = both_bounds(errors)
    some = upper > 1e-10
    outside = (shortcut < lower) | (shortcut > upper)
    assert np.mean(outside[some]) > 0.9


def infsup_of(scene):
    return errors_of(scene, "infsup")


@pytest.mark.parametrize("scene", SCENES)
def test_beta_is_known_to_half_a_percent_and_at_most_1(scene):
    table = infsup_of(scene)
    lower, upper = table["beta_lower"].values, table["beta_upper"].values
    known = np.isfinite(lower)
    assert known.any()
    assert np.all(lower[known] <= upper[known])
    assert np.all(upper[known] <= 1)
    positive = known & (upper > 0)
    assert np.all(upper[positive] <= 1.005 * lower[positive])
    h_over_H = errors_of(scene)["h_over_H"].values
    assert np.array_equal(positive[known], (h_over_H < 1 - 1e-12)[known])


@pytest.mark.parametrize("scene", SCENES)
def test_beta_does_not_fall_when_the_mesh_is_refined(scene):
    """V_h is contained in its refinement; each beta is known between bounds only."""
    table = infsup_of(scene)
    coarse, fine = table["beta_lower"].values[:-1], table["beta_upper"].values[1:]
    assert np.all((coarse <= fine) | np.isnan(coarse) | np.isnan(fine))


@pytest.mark.parametrize("scene", SCENES)
def test_the_discrete_norm_is_a_part_of_the_true_one(scene):
    """Their ratio is at most 1, by bounds that do not know of V_h."""
    table = infsup_of(scene)
    lower, upper = table["norm_ratio_lower"].values, table["norm_ratio_upper"].values
    known = np.isfinite(lower)
    assert np.all(lower[known] <= upper[known])
    assert np.all(lower[known] <= 1)


def test_the_error_is_not_below_that_of_the_ritz_projection(errors):
    assert not np.any(errors["h1_error"] < errors["ritz_error"] * (1 - 1e-4))
    assert not np.any(errors["ritz_error"] > errors["interpolation_error"] * (1 + 1e-4))


def test_plain_steps_grow_like_1_over_H():
    """lambda_min(S) ~ H at a fixed ratio, so steps ~ ln(1/tolerance)/H."""
    table = errors_of("square").sel(case="full_contact")
    i = np.arange(table.sizes["mesh"])
    steps = table["iterations"].values[i, i]
    tolerance = table["tolerance"].values[i, i]
    growth = steps[1:] / steps[:-1]
    theory = 2 * np.log(1 / tolerance[1:]) / np.log(1 / tolerance[:-1])
    np.testing.assert_allclose(growth, theory, rtol=0.15)


def test_no_contact_needs_no_step():
    for scene in [name for name, scene in SCENES.items() if "no_contact" in scene["cases"]]:
        table = errors_of(scene).sel(case="no_contact")
        plain = table["algorithm"] == "uzawa"
        assert np.all(table["iterations"].values[plain.values] == 0)
        assert np.all(table["l2_error"].values[plain.values] <= 1e-12)
