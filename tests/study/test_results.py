"""The study's stored results: the rates of every case, and what theory says of every single run.

Nothing is solved here. Expected rates and their sources stand in workflow/config/rates.yaml, the levels
that count in the cases' own files. What claims of the ledger say of these scenes is judged there.
"""

import json
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from conftest import RESULTS, ROOT, config, read_stored_table

from study import rates
from study.ledger import claims, listing
from study.ledger.results import Results
from study.scenes import has_clamped_sides
from study.tables import VARIABLES
from unilateral.formulas.formula import parse_real
from unilateral.problems import case

EXPECTED = config("rates")["rates"]
SCENES = {name: scene for name, scene in config("study")["scenes"].items() if scene.get("judged", True)}
RATIO = parse_real(EXPECTED["judged_ratio"], "study")


@pytest.fixture(params=SCENES)
def scene(request):
    return request.param


@pytest.fixture
def errors(scene):
    return read_stored_table(f"{scene}/errors")


def test_a_scene_s_table_tells_its_parameters(errors, scene):
    """Those of the configuration, whose defaults are filled in; a value that was changed since is told."""
    document = json.loads(errors.attrs["parameters"])
    declared = SCENES[scene]
    assert {name: document[f"scenes.{scene}"][name] for name in declared} == declared
    assert document["stop"] == config("study")["stop"]


def runs(table, name):
    """The computed values of a variable."""
    values = table[name].values
    return values[np.isfinite(values)]


def judge_stored_errors(table, name, norm):
    expected = rates.Expectation.read(EXPECTED, name, norm, case.read_case_declaration(name)[0]["asymptotic"])
    return rates.judge_errors(table, name, norm, RATIO, expected)


@pytest.mark.parametrize("norm", rates.ERROR_NORMS)
@pytest.mark.parametrize(("scene", "name"), [(s, c) for s in SCENES for c in SCENES[s]["cases"]])
def test_every_asymptotic_pair_reaches_the_expected_rate(scene, name, norm):
    """Every asymptotic pair reaches the expected rate, and the finest error its bound."""
    verdict = judge_stored_errors(read_stored_table(f"{scene}/errors"), name, norm)
    unjudged = EXPECTED["cases"][name][norm]["rate"] == "none"
    allowed = ("not judged",) if unjudged else ("holds", "exact")
    assert verdict.verdict in allowed, f"\n{scene}, {name}, {norm}\n{verdict}"
    stored_verdict = read_stored_table(f"{scene}/rates")["verdict"].sel(case=name, norm=norm, h_over_H=RATIO)
    assert stored_verdict.item() == verdict.verdict


def test_no_multiplier_is_0_where_contact_at_the_re_entrant_vertex_is_judged():
    """So the problem is linear there. Control: reentrant, which has a gap at the vertex, has such cells."""
    multipliers = read_stored_table("corners/solutions")["lambda_H"]
    assert runs(multipliers.sel(case=["reentrant_full"]).to_dataset(), "lambda_H").min() > 0
    assert runs(multipliers.sel(case=["reentrant"]).to_dataset(), "lambda_H").min() == 0


@pytest.mark.parametrize("norm", ["hm12", "l2"])
def test_a_multiplier_at_a_wide_angle_misses_the_bound_of_quasi_optimality(norm):
    """On the finest level, which is why the cases at vertices are held against another bound."""
    rates_there = EXPECTED["cases"]["obtuse_0.9"][norm]
    assert rates_there["judged_by"] == "ritz_bound"
    usual = {name: value for name, value in rates_there.items() if name != "judged_by"}
    study = EXPECTED | {"cases": {"obtuse_0.9": {norm: usual}}}
    expected = rates.Expectation.read(
        study, "obtuse_0.9", norm, case.read_case_declaration("obtuse_0.9")[0]["asymptotic"]
    )
    errors = rates.judge_errors(read_stored_table("obtuse/errors"), "obtuse_0.9", norm, RATIO, expected)
    assert (
        [reason for reason in errors.reasons if "is above its bound" in reason] == list(errors.reasons) != []
    )


@pytest.mark.parametrize("norm", rates.ERROR_NORMS)
def test_a_spoilt_table_is_refused(norm):
    """Control: errors of the finest level 10 % larger, and one run marked as not converged."""
    worse = read_stored_table("square/errors").copy(deep=True)
    unconverged = read_stored_table("square/errors").copy(deep=True)
    for name in ("hm12_error_lower", "hm12_error_upper") if norm == "hm12" else (f"{norm}_error",):
        worse[name][{"mesh": -1}] *= 1.1 if norm == "h1" else 1.3
    assert judge_stored_errors(worse, "natural", norm).verdict == "fails"
    unconverged["converged"][{"mesh": 3}] = 0.0
    assert "did not converge" in str(judge_stored_errors(unconverged, "natural", norm))


def test_the_table_is_complete(scene, errors):
    """All cases and levels, NaN exactly where H/h is outside the scene's limits."""
    declared = SCENES[scene]
    assert list(errors["case"].values) == declared["cases"]
    assert errors.sizes["mesh"] == declared["mesh"]["levels"]
    np.testing.assert_allclose(errors["H"], [parse_real(H, "study") for H in declared["H"]], rtol=1e-14)
    limits = declared["H_over_h"]
    H_over_h = 1 / errors["h_over_H"].values
    inside = H_over_h >= parse_real(limits["min"], "study") * (1 - 1e-12)
    if "max" in limits:
        inside &= H_over_h <= parse_real(limits["max"], "study") * (1 + 1e-12)
    balance = [] if has_clamped_sides(declared["cases"][0]) else ["balance"]
    for name in ("h1_error", "algebraic_bound", "converged", "operator_applications", "algorithm", *balance):
        values = errors[name].transpose("mesh", "partition", "case").values
        expected = values != "" if name == "algorithm" else np.isfinite(values)
        assert np.array_equal(expected, np.broadcast_to(inside[..., None], expected.shape)), name


LABELS = {"case", "norm", "kind", "axis", "variant"}
"""Coordinates that are names, and have no unit."""


def test_every_variable_of_a_table_is_described_and_every_description_is_of_one():
    files = [*RESULTS.rglob("*.nc"), ROOT / "benchmarks/results.nc"]
    written = set()
    for file in files:
        with netCDF4.Dataset(file) as table:
            written |= {*table.variables}
    assert len(files) > 50
    assert written - LABELS == VARIABLES.keys()


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
    in_L2 = judged & (errors["case"] != "rough")  # whose lambda is like s^(-0.95)
    expected_value = dict.fromkeys(("hm12_error_lower", "hm12_best", "discrete_error"), judged)
    for name, where in (expected_value | {"hm12_error_upper": in_L2, "l2_error": in_L2}).items():
        assert np.array_equal(np.isfinite(errors[name]), where), name


def test_every_run_is_balanced_globally(errors):
    """int u_h = int f + int lambda_H, the equation tested with v = 1; relative to u where that is large.

    Beside clamped sides there is no such v.
    """
    if has_clamped_sides(errors["case"].values[0]):
        assert errors["balance"].isnull().all()
        return
    scale = np.maximum(1, errors["u_norm"].max("mesh"))
    assert np.all(runs(errors.assign(share=errors["balance"] / scale), "share") <= 1e-10)


ELSEWHERE = [
    (name, scene)
    for name in ("4.6", "F.norm", "F.share")
    for scene in SCENES
    if scene not in claims.find_claim(name).parameters["scenes"]
]


@pytest.mark.parametrize(("name", "elsewhere"), ELSEWHERE)
def test_claims_of_every_run_are_true_of_the_scenes_that_they_do_not_name(name, elsewhere):
    """By the claim's own check, with its own number; the ledger's controls are those of the check."""
    claim = claims.find_claim(name)
    claim = replace(claim, parameters={**claim.parameters, "scenes": [elsewhere]})
    judgement = claims.judge_all(Results(RESULTS), [claim])[0]
    assert judgement.holds, "\n" + listing.explain_claim(judgement)


def test_smooth_runs_split_exactly(errors):
    """||u-u_h||^2 = ||u-z_h||^2 + ||lambda-lambda_H||^2_{-1/2,h}, to round-off where data are smooth."""
    smooth = errors["case"].isin(["full_contact", "no_contact"])
    absolute = errors["quadrature_share"] * errors["h1_error"] ** 2 / errors["u_norm"] ** 2
    assert float(absolute.where(smooth, 0).max()) <= 1e-10


def test_the_upper_bound_is_not_below_the_discrete_norm(errors):
    """V_h is conforming: its supremum is a lower bound of the norm, found without the reference spaces."""
    assert not np.any(errors["hm12_error_upper"] < errors["discrete_error"])


def test_an_upper_bound_a_thousandth_lower_would_be_below_it():
    """Control."""
    table = read_stored_table("square/errors")
    assert np.any(
        (0.999 * table["hm12_error_upper"] < table["discrete_error"]) & (table["discrete_error"] > 1e-10)
    )


def test_beta_is_known_to_half_a_percent_at_most_1_and_does_not_fall_on_refinement(scene, errors):
    """It is 0 from h = H on. V_h is contained in its refinement; each beta is known between bounds only."""
    table = read_stored_table(f"{scene}/infsup")
    lower = table["beta_lower"].values
    upper = table["beta_upper"].values
    known_finite = np.isfinite(lower)
    positive = upper > 0
    assert known_finite.any()
    assert np.all((lower <= upper) & (upper <= 1) | ~known_finite)
    assert np.all(upper[known_finite & positive] <= 1.005 * lower[known_finite & positive])
    assert np.array_equal(positive[known_finite], (errors["h_over_H"].values < 1 - 1e-12)[known_finite])
    assert np.all((lower[:-1] <= upper[1:]) | ~known_finite[:-1] | ~known_finite[1:])


def test_the_discrete_norm_is_a_part_of_the_true_one(scene):
    """Their ratio is at most 1, by bounds that do not know of V_h."""
    lower = read_stored_table(f"{scene}/infsup")["norm_ratio_lower"].values
    upper = read_stored_table(f"{scene}/infsup")["norm_ratio_upper"].values
    known_finite = np.isfinite(lower)
    assert np.all((lower <= upper)[known_finite])
    assert np.all(lower[known_finite] <= 1)


def test_the_error_is_not_below_that_of_the_ritz_projection(errors):
    assert not np.any(errors["h1_error"] < errors["ritz_error"] * (1 - 1e-4))
    assert not np.any(errors["ritz_error"] > errors["interpolation_error"] * (1 + 1e-4))
